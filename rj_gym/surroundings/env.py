"""The scalar environments of the tasks among walls."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, ClassVar

from rj_gym.core.env import TaskEnv
from rj_gym.core.episodes import EpisodeBuffer
from rj_gym.core.settings import Settings
from rj_gym.core.task import Task
from rj_gym.surroundings.config import HiddenWallConfig, LumenConfig, ObstaclesConfig, ObstaclesV1Config
from rj_gym.surroundings.episodes import SurroundingsEpisodeBuffer
from rj_gym.surroundings.task import HiddenWallTask, LumenTask, ObstaclesTask


class LumenEnv(TaskEnv):
    """Bring the tip of an instrument along a bent lumen to a point on its centre line, by tendons and feed.

    By default an instrument of eight moving links of 10 mm with four tendons, in a sleeve of 4.5 mm radius, in a lumen
    of 6 mm radius with two bends; contact with friction that remembers, and no wall in the observation. m tendons, n
    links, length L (90 mm), lengths in mm, forces in N. Positions in infos are in the frame of the base at the start.

    ## Action space
    `Box(-1, 1, (m + 1,), float32)`: entry j < m pulls in tendon j by `action_scale_mm` (1 mm) times the action, the
    last moves the base on by `feed_scale_mm` (2 mm) times the action, within `feed_range` (0 to 75 mm). Values beyond
    [-1, 1] are clipped. At a tension limit (0.5 N, 15 N) a command follows its tendon.

    ## Observation space
    `Box(low, high, (entries,), float32)`, relative to the base; values are clipped to the bounds.
    `rj_gym.surroundings_observation_entries` lists them.

    | Entries | Meaning | Unit | Low | High |
    |---|---|---|---|---|
    | link k x, link k y | origin of moving link k | L | -2 | 2 |
    | link k cos angle, link k sin angle | its angle | 1 | -1 | 1 |
    | tendon j command | commanded length minus that at rest | 10 mm | -4 | 4 |
    | tendon j tension | its tension | highest tension (15 N) | 0 | 1 |
    | feed | how far the base has moved on | largest feed (75 mm) | 0 | 1 |
    | insertion force | force along the base that holds it | 5 N | -4 | 4 |
    | target x, target y | target minus base | L | -2 | 2 |
    | error x, error y | target minus tip | L | -2 | 2 |
    | error along the tip, error across the tip | the same in the frame of the last link | L | -2 | 2 |
    | centre d mm ahead, along the tip | with `walls="ahead"`: the centre line, d = 0, 8, ... 40 | L | -2 | 2 |
    | centre d mm ahead, across the tip | the same | L | -2 | 2 |

    `poses` ("all") can be "tip", the last link alone, or "none", then errors are left out, too.

    ## Reward
    The sum of the terms, each in `info["reward_terms"]`. The way is that along and across the centre line.

    | Term | Value |
    |---|---|
    | tracking | - way / `error_scale_mm` (20 mm) |
    | progress | `progress` (0.5) · mm by which the way is shorter than a step before |
    | force | - `force` (0.3) · max(0, wall force - `free_force` (0.2 N)) |
    | smoothness | - `smoothness` (0.01) · mean of (action - previous action)² |
    | failure | - `failure_penalty` (100) in a step without a usable pose, which ends the episode |

    ## Start
    The instrument is straight, its tip 10 mm before the first bend. Drawn per episode: one of `families`, and from it
    bends, radius and stiffness of the lumen; the target, `depth` (45 to 70 mm) beyond the beginning of the first bend.
    `reset(options=...)` fixes "lumen", a rollingjoint.Lumen, and "depth".

    ## Episode end
    Truncated by the environment itself after `episode_steps` (60); no TimeLimit is registered. Terminated where a step
    finds no usable pose; the pose stays that of the step before.

    ## Info
    `error_mm`, distance of the tip from the target; `wall_force`, the largest normal force of any contact, and
    `peak_wall_force`, the largest so far; `path_ratio`, the share of the way that is done, 0 to 1; `success`, whether
    the error is at most `success_mm` (3 mm) and the peak at most `force_limit` (2 N): that of the last step counts.
    Also `feed`, `insertion_force`, `tensions`, `commands` (m,), `status`, `tip`, `target` (2,), `poses` (n, 3); from
    `step` also `reward_terms`, from `reset` also `sampled`.

    ## Arguments
    `LumenEnv(render_mode=None, config=None, **overrides)`: `config` is a LumenConfig or a dictionary of its fields;
    overrides go on top: `gymnasium.make("rj_gym/Lumen-v0", families=["hard", "gentle"], walls="ahead")`.

    ## Version history
    * v0: first version.
    """

    settings: ClassVar[type[Settings]] = LumenConfig
    task_class: ClassVar[Callable[[Any], Task]] = LumenTask
    buffer: ClassVar[type[EpisodeBuffer]] = SurroundingsEpisodeBuffer


class ObstaclesEnv(TaskEnv):
    """Bring the tip of an instrument to a target behind discs, which it sees: one of them is between the two.

    As LumenEnv without a lumen, and without feed. m tendons, n links, length L (90 mm).

    ## Action space
    `Box(-1, 1, (m,), float32)`: entry j pulls in tendon j by `action_scale_mm` (1 mm) times the action.

    ## Observation space
    As LumenEnv, without feed and insertion force, and with

    | Entries | Meaning | Unit | Low | High |
    |---|---|---|---|---|
    | disc i x, disc i y, disc i radius | its middle, and its radius | L | -2 | 2 |
    | disc i x from the tip, disc i y from the tip | the middle minus the tip | L | -2 | 2 |

    ## Reward
    As LumenEnv; the way is the distance from the tip to the target.

    ## Start
    Drawn per episode by a search: a target at least `reach_mm` (25 mm) from the tip; a disc between the two, others
    anywhere; and commands by way of which the tip gets there in at most 45 steps, touching with 1 N at most. So every
    target can be reached, which gives the floor: 100 %. `info["sampled"]` has the commands "via" and "goal". The search
    takes half a second of processor time or more an episode. `reset(options=...)` fixes "discs" and "target", together.

    ## Episode end
    As LumenEnv. A step that would pass through a disc, even in parts, also ends the episode.

    ## Info
    As LumenEnv.

    ## Arguments
    `ObstaclesEnv(render_mode=None, config=None, **overrides)`: see ObstaclesConfig.

    ## Version history
    * v1: other episodes, drawn faster: ObstaclesV1Env.
    * v0: first version.
    """

    settings: ClassVar[type[Settings]] = ObstaclesConfig
    task_class: ClassVar[Callable[[Any], Task]] = ObstaclesTask
    buffer: ClassVar[type[EpisodeBuffer]] = SurroundingsEpisodeBuffer


class ObstaclesV1Env(ObstaclesEnv):
    """Obstacles with other episodes, drawn six times as fast: as ObstaclesEnv but for what follows.

    ## Start
    As ObstaclesEnv, but the search looks more closely whether a way is clear of the discs (`search`: fine), so that
    nearly every way that it finds is passable, and its ways go by commands of up to 13 mm in place of 7 mm (the distal
    segment's besides 0.6 of the proximal's), which bend the instrument to an S. It takes less than a tenth of a
    second of processor time an episode.

    ## Arguments
    As ObstaclesEnv, with ObstaclesV1Config.

    ## Version history
    * v1: other draws.
    * v0: ObstaclesEnv.
    """

    settings: ClassVar[type[Settings]] = ObstaclesV1Config


class HiddenWallEnv(TaskEnv):
    """Touch a wall of unknown place and stiffness with a given force, or reach a target along it, by motors alone.

    As LumenEnv without a lumen, and without feed: by default the chain of five links with two tendons in a sleeve of
    8 mm, whose pose is not observed, nor the wall. m tendons, n links, length L (100 mm).

    ## Action space
    `Box(-1, 1, (m,), float32)`: entry j pulls in tendon j by `action_scale_mm` (1 mm) times the action.

    ## Observation space
    As LumenEnv with `poses="none"`: commands, tensions and the target; with `observe_force` also

    | Entries | Meaning | Unit | Low | High |
    |---|---|---|---|---|
    | wall force | normal force of the contact that presses most | 1 N | 0 | 4 |

    ## Reward
    As LumenEnv; the way is the distance from the tip to the target, and with `goal="touch"` the force term is
    - `force` (0.3) · |wall force - `touch_force` (0.5 N)|.

    ## Start
    Drawn per episode: a wall across the way of a straight change of the commands, its turn, place and stiffness,
    log-uniform in `stiffness` (1 to 10 N/mm); the target is where the last link, and no other, presses on it with
    `touch_force` (or, with `goal="reach"`, with a drawn force up to 0.8 of `force_limit`) on that way. So every target
    can be reached, which gives the floor: 100 %. `info["sampled"]` has its commands, "goal". `reset(options=...)` fixes
    "wall", a rollingjoint.HalfPlane, and "target", together.

    ## Episode end
    As LumenEnv.

    ## Info
    As LumenEnv; `success` needs the peak at most `force_limit` (1 N) and, with `goal="touch"`, a wall force within
    `force_margin` (0.2 N) of `touch_force`.

    ## Arguments
    `HiddenWallEnv(render_mode=None, config=None, **overrides)`: see HiddenWallConfig.

    ## Version history
    * v0: first version.
    """

    settings: ClassVar[type[Settings]] = HiddenWallConfig
    task_class: ClassVar[Callable[[Any], Task]] = HiddenWallTask
    buffer: ClassVar[type[EpisodeBuffer]] = SurroundingsEpisodeBuffer
