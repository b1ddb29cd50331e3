"""The scalar environments of the arm's tracking task."""

from __future__ import annotations

from typing import ClassVar

from rj_gym.arm.config import FlexibleArmConfig
from rj_gym.arm.episodes import ArmEpisodeBuffer
from rj_gym.arm.worlds import ArmInstrumentConfig
from rj_gym.core.env import GoalTaskEnv, TaskEnv
from rj_gym.core.episodes import EpisodeBuffer
from rj_gym.core.settings import Settings


class FlexibleArmEnv(TaskEnv):
    """Bring the tip of a hanging tendon-driven arm to a target, under unknown gravity and an unknown payload.

    An arm of n - 1 beads on elastic hinges, m tendons, length L (0.7 m, 32 beads and m = 8 for the default one, in two
    segments of four tendons each). Its base is tilted, so that the direction of gravity is unknown, and
    an unknown payload hangs from its tip. Every step is quasi-static: tendons move, the payload moves on, the arm settles.

    ## Action space
    `Box(-1, 1, (m,), float32)`: how far each tendon is pulled in, in units of `action_scale_mm` (1 mm); negative
    pays out. Values beyond [-1, 1] are clipped. Tensions stay between 0.5 N and 15 N (`tension_range`); at these
    limits the command follows the tendon, so commands do not wind up.

    ## Observation space
    `Box(low, high, (entries,), float32)`; values are clipped to the bounds. `rj_gym.arm_observation_entries` lists them.

    | Entries | Meaning | Unit | Low | High |
    |---|---|---|---|---|
    | tip x, tip y, tip z | where the tip is | L | -2 | 2 |
    | tip R xx, tip R yx, tip R zx, tip R xy, tip R yy, tip R zy (`orientation`, off) | x and y axis of its frame | 1 | -1 | 1 |
    | tendon j command | commanded length minus that of the straight arm, j = 0 ... m - 1 | `command_scale_mm` (30 mm) | -2 | 2 |
    | tendon j tension (`observe_tensions`, on) | measured tension | largest tension (15 N) | 0 | 1 |
    | target x, target y, target z | where the tip should be now | L | -2 | 2 |
    | target R xx, target R yx, target R zx, target R xy, target R yy, target R zy (`orientation`, off) | axes of the target frame | 1 | -1 | 1 |
    | tip error x, tip error y, tip error z | target minus measured tip | `error_scale_mm` (30 mm) | -10 | 10 |
    | angle error x, angle error y, angle error z (`orientation`, off) | rotation vector from the measured to the target frame | `angle_scale_rad` (0.3 rad) | -10.472 | 10.472 |
    | gravity x, gravity y, gravity z (`observe_load`, off) | its direction in the base frame | 1 | -1 | 1 |
    | payload (`observe_load`, off) | what hangs from the tip | largest `load.magnitude` (0.5 N) | 0 | 1 |

    Entries stand in the order of the table.

    ## Reward
    The sum of the terms, each in `info["reward_terms"]`:

    | Term | Value |
    |---|---|
    | tracking | - error / `error_scale_mm` (30 mm), error the distance of the true tip from the target after the step |
    | effort | - `effort` (0.01) · mean((tension / largest tension)²) |
    | smoothness | - `smoothness` (0.01) · mean((action - previous action)²) |
    | failure | - `failure_penalty` (100) if the solver gave no usable equilibrium, else 0 |
    | orientation (`orientation`, off) | - angle / `angle_scale_rad` (0.3 rad), angle between the true tip frame and the target frame |

    ## Start
    Drawn per episode: the direction of gravity, uniform within 0.5 rad of hanging straight (`gravity`); a target, the
    tip of an equilibrium under that gravity without payload (`target`); the payload, a dead force at the tip along
    gravity, uniform from 0 to 0.5 N (`load`). Tensions of 3 N (`start_tension`) set the arm without payload; the
    tendons are locked there and the payload applied. `reset(options=...)` fixes any of "target", "load", "gravity",
    "mechanism", "start" and "friction"; what was drawn is in `info["sampled"]`.

    ## Episode end
    As that of RollingJointEnv: truncated by the environment itself after `episode_steps` (50), terminated only where
    the solver finds no usable equilibrium, with the penalty and the observation of the last good pose.

    ## Info
    `error_mm`, `status` (name of a rollingjoint Status), `tip` and `target` (3,) [mm], `load` {"link", "force"},
    `gravity` (3,), `tensions` (m,) [N], `command` (m,) [mm]; with `orientation` `angle_error_rad`; from `step` also
    `reward_terms`, from `reset` also `sampled`; with friction `gap_tensions` (n - 1, m) [N], `sticking` (n - 1, m),
    `dissipated_work` [N·mm].

    ## Arguments
    `FlexibleArmEnv(render_mode=None, config=None, **overrides)`: `config` is a FlexibleArmConfig or a dictionary of its
    fields; overrides go on top, and nested ones change only what they name:
    `gymnasium.make("rj_gym/FlexibleArm-v0", orientation=True, load={"magnitude": (0, 0.8)})`.
    See FlexibleArmConfig, PayloadConfig, GravityConfig, ArmTargetConfig, ArmRewardConfig, ArmRandomizationConfig and
    FrictionConfig (`friction`, off): tendons rub in the beads' holes, by a hidden coefficient drawn per episode.

    ## Version history
    * v0: first version.
    """  # noqa: E501

    settings: ClassVar[type[Settings]] = FlexibleArmConfig
    buffer: ClassVar[type[EpisodeBuffer]] = ArmEpisodeBuffer


class FlexibleArmGoalEnv(GoalTaskEnv, FlexibleArmEnv):
    """The arm's task with goals, for hindsight relabelling: as FlexibleArmEnv but for what follows.

    ## Observation space
    `Dict`, float32:

    | Key | Meaning | Unit | Low | High |
    |---|---|---|---|---|
    | observation | the entries of FlexibleArmEnv without target and errors | | | |
    | achieved_goal | true tip x, y, z (without sensor noise) | L | -2 | 2 |
    | desired_goal | target x, y, z | L | -2 | 2 |

    With `orientation` both goals go on with the six entries "R xx" ... "R zy" of their frame, within [-1, 1].

    ## Reward
    Exactly `compute_reward(achieved_goal, desired_goal, info)`, which needs nothing from info and takes batches:
    "dense" (default) is - error / `error_scale_mm`, with `orientation` - angle / `angle_scale_rad` on top; "sparse"
    (`reward={"goal": "sparse"}`) is 0 where the error is at most `goal_tolerance_mm` (5 mm), and the angle at most
    `goal_tolerance_rad` (0.05 rad), else -1. There are no effort, smoothness and failure terms.

    ## Info
    As FlexibleArmEnv, and `is_success`: whether the errors are within the tolerances.

    ## Version history
    * v0: first version.
    """


class ArmInstrumentEnv(FlexibleArmEnv):
    """Bring the tip of an arm to a target when nobody sees the tip: as FlexibleArmEnv but for what follows.

    Motors pull the tendons through a sheath with play and friction, and the tendons rub in the holes of the beads. What
    the agent has is where the motors are and what they measure.

    ## Action space
    As FlexibleArmEnv, but an action moves the motor, and the tendon's command follows through play: see InstrumentEnv.

    ## Observation space
    `Box(low, high, (entries,), float32)`; values are clipped to the bounds.

    | Entries | Meaning | Unit | Low | High |
    |---|---|---|---|---|
    | tendon j command | measured motor position minus length when straight | `command_scale_mm` (30 mm) | -2 | 2 |
    | tendon j tension | measured by the motor: T exp(phi u), u = (p - q) / h | largest tension (15 N) | 0 | 3 |
    | target x, target y, target z | where the tip should be now | L | -2 | 2 |

    With `orientation` the axes of the target frame follow; past readings (`observe_history`, 1) as in InstrumentEnv.

    ## Reward
    As FlexibleArmEnv with effort 0, smoothness 0.002 and precision 0.5: tracking loses 0.5 error / (error + 1 mm) too.

    ## Start
    As FlexibleArmEnv. Drawn per episode and hidden besides gravity and payload: the stiffness of every tendon (20 %)
    and hinge (10 %), the weight of every bead (10 %), motor offsets (0.5 mm); the width of every tendon's play, 0.2 to
    1 mm, and where in it the tendon begins; every tendon's phi in the sheath, 0 to 0.3; mu in the holes, 0 to 0.1, the
    same for all tendons. Targets are tips of equilibria without friction under gravity and payload of the episode.

    ## Episode end
    As FlexibleArmEnv. Controllers are compared by the mean tip error over the last 10 steps.

    ## Info
    As FlexibleArmEnv with friction, and with `privileged` the true state as in InstrumentEnv.

    ## Arguments
    As FlexibleArmEnv, with ArmInstrumentConfig: FlexibleArmConfig with other defaults. Moving targets:
    `target={"process": "path"}`.

    ## Version history
    * v0: first version.
    """

    settings: ClassVar[type[Settings]] = ArmInstrumentConfig
