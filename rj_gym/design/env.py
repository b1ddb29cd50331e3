"""The scalar environments of the design tasks."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, ClassVar

from rj_gym.core.env import TaskEnv
from rj_gym.core.episodes import EpisodeBuffer
from rj_gym.core.settings import Settings
from rj_gym.core.task import Task
from rj_gym.design.codesign import CoDesignTask
from rj_gym.design.codesign_episodes import CoDesignEpisodeBuffer
from rj_gym.design.config import CoDesignConfig, DesignConfig
from rj_gym.design.episodes import DesignEpisodeBuffer
from rj_gym.design.task import DesignTask


class CurvatureDesignEnv(TaskEnv):
    """Change the contact surfaces of a chain, step by step, until it bends into given shapes: inverse design.

    A design is a vector of d numbers in [-1, 1], a point of a `rollingjoint.design.DesignSpace`: by default the
    curvatures at five knots of the child and of the parent surface that all joints share, d = 10. It is judged in K
    cases (3), each a pair of tendon tensions and a force on the tip. The targets are the shapes of a hidden design in
    these cases, so that an error of 0 is possible. n links, of which n - 1 move; m tendons (2); q = 5 margins; length
    L = n times the middle link height (100 mm). Designs may be of any design space, around any mechanism: in space
    vectors have a z, too, and with other than two tendons there are m + 1 cases.

    ## Action space
    `Box(-1, 1, (d,), float32)`: change of the design vector in units of `action_scale` (0.25). Values beyond [-1, 1]
    are clipped, and so is the design at its box.

    ## Observation space
    `Box(low, high, (entries,), float32)`; values are clipped to the bounds. `rj_gym.design_observation_entries` lists
    them.

    | Entries | Meaning | Unit | Low | High |
    |---|---|---|---|---|
    | (names of the design space) | the design vector | half range | -1 | 1 |
    | rolling margin, clearance margin, radius margin, holes margin, thickness margin | valid: 0 or more | 1 | -1 | 1 |
    | case k error | root mean square distance of the links from their targets, k = 0 ... K - 1 | 10 mm | 0 | 5 |
    | error | the same over all cases | 10 mm | 0 | 5 |
    | case k link i x deviation, case k link i y deviation | target minus origin of moving link i | 10 mm | -5 | 5 |
    | case k link i x target, case k link i y target | where its origin should be | L | -2 | 2 |
    | case k force x, case k force y | force on the tip | largest `force` (0.3 N) | -1 | 1 |
    | case k left tension, case k right tension | of the tendons | largest of `tensions` (6 N) | 0 | 1 |

    A design that is not valid has no shape: its deviations are 0 and its errors `largest_error_mm` (50 mm).

    ## Reward
    The sum of the terms, each in `info["reward_terms"]`:

    | Term | Value |
    |---|---|
    | improvement | log((error before + `offset_mm`) / (error after + `offset_mm`)), `offset_mm` 0.5; or linear |
    | violation | - `violation` (1) · sum of the margins' shortfalls below 0 |
    | failure | - `failure` (1) where a valid design has no equilibrium in some case, else 0 |

    Improvements add up to the improvement of the whole episode.

    ## Start
    Drawn per episode: the forces, uniform in direction and in magnitude (`force`, 0 to 0.3 N); a hidden design and one
    to begin with, both valid and uniform in the box (`start`: or the space's reference). `reset(options=...)` fixes any
    of "design", "target_design", "forces" and "tensions"; the random draws are in `info["sampled"]`.

    ## Episode end
    Truncated by the environment itself after `episode_steps` (20); no TimeLimit is registered. Never terminated: a
    design that is not valid, or has no equilibrium, has the largest error and can be left again.

    ## Info
    `error_mm` over all cases, `case_errors_mm` (K,), `valid`, `status` (name of the worst rollingjoint Status of the
    cases), `margins` (q,), `design` (d,), `positions` (K, n - 1, 2) [mm]; from `step` also `reward_terms`, from `reset`
    also `sampled`.

    ## Arguments
    `CurvatureDesignEnv(render_mode=None, config=None, **overrides)`: `config` is a DesignConfig or a dictionary of its
    fields; overrides go on top, and nested ones change only the named fields:
    `gymnasium.make("rj_gym/CurvatureDesign-v0", space={"knots": 3}, force=(0, 0.1))`.
    See DesignConfig, DesignRewardConfig and rollingjoint.design.DesignSpace.

    ## Version history
    * v0: first version.
    """

    metadata = TaskEnv.metadata | {"render_fps": 4}
    settings: ClassVar[type[Settings]] = DesignConfig
    task_class: ClassVar[Callable[[Any], Task]] = DesignTask
    buffer: ClassVar[type[EpisodeBuffer]] = DesignEpisodeBuffer


class CoDesignEnv(TaskEnv):
    """Design a mechanism in the first steps of an episode, then bring its tip to targets by its tendons: co-design.

    A design is a vector of d numbers in [-1, 1], a point of a design space, by default as in CurvatureDesign (five
    links, m = 2 tendons, d = 10). The targets are the same for all designs: places of the tip of the space's reference
    under random tensions. n = 3 targets follow each other in the control phase, under an unchanging force at the tip.

    ## Action space
    `Box(-1, 1, (d + m,), float32)`, values beyond are clipped. In the design phase the first d entries change the
    design vector, in units of `design_scale` (0.5); the others do nothing. In the control phase the last m entries move
    the motors, in units of `step_mm` (1 mm), positive ones pull; the others do nothing.

    ## Observation space
    `Box(low, high, (entries,), float32)`; values are clipped to the bounds. q = 5 margins; L is the length of the
    space's reference (100 mm). In space vectors have a z, too.

    | Entries | Meaning | Unit | Low | High |
    |---|---|---|---|---|
    | control phase | 0 while the design can change, then 1 | 1 | 0 | 1 |
    | steps left | of the episode | episode | 0 | 1 |
    | (names of the design space) | the design vector | half range | -1 | 1 |
    | (names of the margins) margin | valid: 0 or more | 1 | -1 | 1 |
    | target k x, target k y | where the tip should be, k = 0 ... n - 1 | L | -2 | 2 |
    | tip x, tip y | where it is | L | -2 | 2 |
    | error x, error y | present target minus tip | 10 mm | -5 | 5 |
    | force x, force y | at the tip, in the control phase | largest `force` (0.1 N) | -1 | 1 |
    | tendon j tension | at the motors | 10 N | 0 | 10 |
    | tendon j command | motor from its place at rest | `command_range_mm` (15 mm) | -1 | 1 |

    ## Reward
    The sum of the terms, each in `info["reward_terms"]`:

    | Term | Value |
    |---|---|
    | tracking | in the control phase - error / `error_scale_mm` (10 mm) |
    | effort | in the control phase - `effort` (0) · mean tension [N] |
    | violation | in the design phase - `violation` (1) · sum of the margins' shortfalls below 0 |
    | failure | - `failure` (1) where a valid design has no equilibrium at rest, or a command none, else 0 |

    ## Start
    Drawn per episode: a valid design, uniform in the box (`start`: or the space's reference), the targets, the force.
    `reset(options=...)` fixes any of "design", "targets" and "force"; the random draws are in `info["sampled"]`.

    ## Transition
    The mechanism is always built of the last design that was valid and rests in an equilibrium under `pretension` (4 N
    in every tendon); motors hold the unstretched lengths of that equilibrium, from which commands count, so that the
    same command means the same for every design. Tendons are elastic and may go slack. In the control phase motors
    move, at most by `command_range_mm`, and the equilibrium is searched from the last one. A command without one is not
    carried out.

    ## Episode end
    Truncated by the environment itself after `design_steps` (5) + `control_steps` (30); never terminated.

    ## Info
    `error_mm`, `phase` ("design" or "control"), `valid`, `status` (name of a rollingjoint Status), `margins` (q,),
    `design` and `built_design` (d,), `tip`, `target` [mm], `tensions` [N], `command` [mm]; from `step` also
    `reward_terms`, from `reset` also `sampled`.

    ## Arguments
    `CoDesignEnv(render_mode=None, config=None, **overrides)`: `config` is a CoDesignConfig or a dictionary of its
    fields; overrides go on top, and nested ones change only the named fields:
    `gymnasium.make("rj_gym/CoDesign-v0", space={"mechanism": "two_segment", "height": (-2, 3)})`.
    See CoDesignConfig, CoDesignRewardConfig and rollingjoint.design.DesignSpace.

    ## Version history
    * v0: first version.
    """

    metadata = TaskEnv.metadata | {"render_fps": 4}
    settings: ClassVar[type[Settings]] = CoDesignConfig
    task_class: ClassVar[Callable[[Any], Task]] = CoDesignTask
    buffer: ClassVar[type[EpisodeBuffer]] = CoDesignEpisodeBuffer
