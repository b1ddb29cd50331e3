"""The scalar environments of tracking with many mechanisms."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, ClassVar

from rj_gym.core.env import TaskEnv
from rj_gym.core.episodes import EpisodeBuffer
from rj_gym.core.settings import Settings
from rj_gym.core.task import Task
from rj_gym.many.config import ManyMechanismsConfig, ManyMechanismsInSpaceConfig
from rj_gym.many.designs import DrawnDesign
from rj_gym.many.episodes import ManyEpisodeBuffer
from rj_gym.many.task import ManyPlanarTask, ManySpatialTask
from rj_gym.tracking.env import PitchYawEnv, RollingJointEnv


class ManyDesignsEnv(TaskEnv):
    """What environments with many mechanisms share."""

    buffer: ClassVar[type[EpisodeBuffer]] = ManyEpisodeBuffer

    @property
    def designs(self) -> list[DrawnDesign | None]:
        """The design of the episode, alone in a list."""
        return list(self._buffer.designs)  # type: ignore[attr-defined]


class ManyMechanismsEnv(ManyDesignsEnv, RollingJointEnv):
    """Bring the tip to a target with a mechanism that every episode draws: as RollingJointEnv, with these differences.

    A mechanism is a design of a space (`mechanisms`): by default a chain of 3 to 8 links with two tendons, whose
    contact surfaces are drawn. N is the most links (8), n the number of the episode's mechanism, L its own length.

    ## Observation space
    `Box(low, high, (entries,), float32)`; values are clipped to the bounds. `env.unwrapped.task.entries()` lists
    them. First come the entries of RollingJointEnv with N links, in units of the
    episode's own mechanism: links n to N - 1, which are not there, have 0, and commands are relative to its own neutral
    lengths. Then its design, the same in every step:

    | Entries | Meaning | Unit | Low | High |
    |---|---|---|---|---|
    | length | L | 100 mm | 0 | 32 |
    | link k is there | 1 if k < n, else 0, k = 1 ... N - 1 | 1 | 0 | 1 |
    | link k height | distance of its surfaces at s = 0 | L | 0 | 1 |
    | joint k left, middle, right convexity | relative curvature of the surfaces of joint k, below link k, at 1/4, 1/2, 3/4 of their range | 0.1 /mm | -5 | 5 |
    | link k hole j | where tendon j enters link k, across the link | 20 mm | -5 | 5 |

    They come link by link; all of links that are not there are 0. Where holes are not on surfaces, of designs around a
    mechanism, there are "hole j x" and "hole j y", along the link, in place of "hole j".

    ## Start
    As RollingJointEnv; before that the mechanism is drawn, uniformly among the numbered designs of `mechanisms`.
    `reset(options=...)` fixes it by "design", a number, or by "mechanism", a chain of 3 to 8 links with two tendons.

    ## Info
    As RollingJointEnv; `sampled` has `design`, its number (-1: given by its options), and `n_links`, and no surface_offsets.

    ## Arguments
    As RollingJointEnv, with ManyMechanismsConfig: `mechanisms={"space": {...}, "links": (3, 8), "designs": (0, 256)}`, and
    neither `mechanism` nor friction, randomised surfaces or stiffnesses, terms.

    ## Version history
    * v0: first version.
    """  # noqa: E501

    settings: ClassVar[type[Settings]] = ManyMechanismsConfig
    task_class: ClassVar[Callable[[Any], Task]] = ManyPlanarTask


class ManyMechanismsInSpaceEnv(ManyDesignsEnv, PitchYawEnv):
    """Bring the tip to a target with a mechanism in space that every episode draws: as PitchYawEnv, except as follows.

    A mechanism is a design of a space (`mechanisms`): by default a tube of 3 to 8 links with four tendons, whose contact
    surfaces, heights and holes, and the plane of every joint, are drawn. N is the most links (8), n the number of the
    episode's mechanism, L its own length.

    ## Observation space
    `Box(low, high, (entries,), float32)`; values are clipped to the bounds. `env.unwrapped.task.entries()` lists
    them. First come the entries of PitchYawEnv, in units of the episode's own mechanism: commands are relative to its
    own neutral lengths. Then its design, the same in every step:

    | Entries | Meaning | Unit | Low | High |
    |---|---|---|---|---|
    | length | L | 100 mm | 0 | 32 |
    | link k is there | 1 if k < n, else 0, k = 1 ... N - 1 | 1 | 0 | 1 |
    | link k height | distance of its origin from that of the link below, at rest | L | 0 | 1 |
    | joint k left, middle, right convexity | relative curvature of the surfaces of joint k, below link k, at 1/4, 1/2, 3/4 of their range; 5 of a hinge | 0.1 /mm | -5 | 5 |
    | joint k axis x, joint k axis y | the axis of the joint, in the frame of the link below | 1 | -1 | 1 |
    | joint k stiffness | of its torsion spring | 10 N mm/rad | 0 | 5 |
    | link k hole j x, y, z | where tendon j enters link k, 0 where it ends before | 5 mm | -5 | 5 |

    They come link by link; all of links that are not there are 0.

    ## Start
    As PitchYawEnv, with a payload up to 1 N and a target that the tip can reach under it; before that the mechanism is
    drawn, uniformly among the numbered designs of `mechanisms`. `reset(options=...)` fixes it by "design", a number, or
    by "mechanism", a SpatialChain of 3 to 8 links with four tendons.

    ## Info
    As PitchYawEnv; `sampled` has `design`, its number (-1: given by its options), and `n_links`, and no numbers of single
    joints.

    ## Arguments
    As PitchYawEnv, with ManyMechanismsInSpaceConfig: `mechanisms={"space": {...}, "links": (3, 8), "designs": (0, 256)}`,
    and neither `mechanism` nor friction, randomised weights or stiffnesses, terms.

    ## Version history
    * v0: first version.
    """  # noqa: E501

    settings: ClassVar[type[Settings]] = ManyMechanismsInSpaceConfig
    task_class: ClassVar[Callable[[Any], Task]] = ManySpatialTask
