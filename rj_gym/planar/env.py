"""The scalar environments of the planar tracking task."""

from __future__ import annotations

from typing import ClassVar

from rj_gym.core.env import GoalTaskEnv, TaskEnv
from rj_gym.core.episodes import EpisodeBuffer
from rj_gym.core.settings import Settings
from rj_gym.planar.config import TrackingConfig
from rj_gym.planar.episodes import PlanarEpisodeBuffer


class RollingJointEnv(TaskEnv):
    """Bring the tip of a tendon-driven rolling-contact chain to a target while an unknown force pulls at it.

    n links (n - 1 of them move), m tendons, length L (sum of the link heights; 100 mm for the default five-link
    mechanism, n = 5, m = 2). Every step is quasi-static: tendons move, the load moves on, the mechanism settles.

    ## Action space
    `Box(-1, 1, (m,), float32)`: how far each tendon is pulled in, in units of `action_scale_mm` (1 mm); negative
    pays out. Values beyond [-1, 1] are clipped. Tensions stay between 0.5 N and 15 N (`tension_range`); at these
    limits the command follows the tendon, so commands do not wind up.

    ## Observation space
    `Box(low, high, (entries,), float32)`; values are clipped to the bounds. `rj_gym.observation_entries` lists them.

    | Entries | Meaning | Unit | Low | High |
    |---|---|---|---|---|
    | link k x, link k y | origin of moving link k, k = 1 ... n - 1 | L | -2 | 2 |
    | link k cos angle, link k sin angle | its angle | 1 | -1 | 1 |
    | tendon j command | commanded length minus neutral length, j = 0 ... m - 1 | `command_scale_mm` (20 mm) | -2 | 2 |
    | tendon j tension (`observe_tensions`, on) | measured tension | largest tension (15 N) | 0 | 1 |
    | target x, target y | where the tip should be now | L | -2 | 2 |
    | tip error x, tip error y | target minus measured tip | `error_scale_mm` (10 mm) | -10 | 10 |
    | load x, load y (`observe_load`, off) | external force | largest `load.magnitude` (1 N) | -1 | 1 |
    | load on link k (`observe_load`, off) | 1 for the link that the force pulls | 1 | 0 | 1 |

    Links' entries come link by link (x, y, cos, sin), all others in the order of the table.

    ## Reward
    The sum of the terms, each in `info["reward_terms"]`:

    | Term | Value |
    |---|---|
    | tracking | - error / `error_scale_mm` (10 mm), error the distance of the true tip from the target after the step |
    | effort | - `effort` (0.01) · mean((tension / largest tension)²) |
    | smoothness | - `smoothness` (0.01) · mean((action - previous action)²) |
    | failure | - `failure_penalty` (100) if the solver gave no usable equilibrium, else 0 |

    ## Start
    Tensions of 3 N (`start_tension`) set the unloaded mechanism; the tendons are locked there and the load applied.
    Drawn per episode: a target that the unloaded mechanism reaches (`target`), and the load: a dead force at the
    origin of a random moving link, uniform in direction and in magnitude from 0 to 1 N (`load`).
    `reset(options=...)` fixes any of "target", "load", "mechanism", "start" and "friction"; what was drawn is in
    `info["sampled"]`.

    ## Episode end
    Truncated by the environment itself after `episode_steps` (50); no TimeLimit is registered, because a native
    vector environment has no such wrapper and both must end alike. Reaching the target does not end the episode.
    Terminated only when the solver finds no usable equilibrium: `info["status"]` says why, the penalty applies, and
    the observation is that of the last good pose.

    ## Info
    `error_mm`, `status` (name of a rollingjoint Status), `tip` and `target` (2,) [mm], `load` {"link", "force"},
    `tensions` (m,) [N], `command` (m,) [mm]; from `step` also `reward_terms`, from `reset` `sampled`; with friction
    `gap_tensions` (n - 1, m) [N], `sticking` (n - 1, m), `dissipated_work` [N·mm].

    ## Arguments
    `RollingJointEnv(render_mode=None, config=None, **overrides)`: `config` is a TrackingConfig or a dictionary of its
    fields; overrides go on top, and nested ones change only what they name:
    `gymnasium.make("rj_gym/RollingJoint-v0", episode_steps=20, load={"magnitude": (0, 1.5)})`.
    See TrackingConfig, LoadConfig, TargetConfig, RewardConfig, RandomizationConfig and FrictionConfig: tendons rub in
    their holes (`friction`, off), by a hidden coefficient drawn per episode, and poses depend on the moves before them.

    ## Version history
    * v0: first version.
    """

    settings: ClassVar[type[Settings]] = TrackingConfig
    buffer: ClassVar[type[EpisodeBuffer]] = PlanarEpisodeBuffer


class RollingJointGoalEnv(GoalTaskEnv, RollingJointEnv):
    """The tracking task with goals, for hindsight relabelling: as RollingJointEnv but for what follows.

    ## Observation space
    `Dict`, float32:

    | Key | Meaning | Unit | Low | High |
    |---|---|---|---|---|
    | observation | the entries of RollingJointEnv without target and tip error | | | |
    | achieved_goal | true tip x, y (without sensor noise) | L | -2 | 2 |
    | desired_goal | target x, y | L | -2 | 2 |

    ## Reward
    Exactly `compute_reward(achieved_goal, desired_goal, info)`, which needs nothing from info and takes batches:
    "dense" (default) is - error / `error_scale_mm`; "sparse" (`reward={"goal": "sparse"}`) is 0 where the error is at
    most `goal_tolerance_mm` (2 mm), else -1. There are no effort, smoothness and failure terms.

    ## Info
    As RollingJointEnv, and `is_success`: whether the error is at most `goal_tolerance_mm`.

    ## Version history
    * v0: first version.
    """
