"""The scalar environments of the tracking tasks, with the decision processes in their docstrings."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, ClassVar

from rj_gym.core.env import GoalTaskEnv, TaskEnv
from rj_gym.core.episodes import EpisodeBuffer
from rj_gym.core.settings import Settings
from rj_gym.core.task import Task
from rj_gym.tracking.arm import ArmTask
from rj_gym.tracking.config import FlexibleArmConfig, PitchYawConfig, TrackingConfig
from rj_gym.tracking.episodes import TrackingEpisodeBuffer
from rj_gym.tracking.planar import PlanarTask
from rj_gym.tracking.worlds import (
    ArmInstrumentConfig,
    ArmInstrumentV1Config,
    InstrumentConfig,
    InstrumentShiftConfig,
    InstrumentShiftV1Config,
    InstrumentV1Config,
    LatePoseConfig,
    LatePoseV1Config,
    SlowCameraConfig,
    SlowCameraV1Config,
)


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
    Tensions of 3 N (`start_tension`) set the unloaded mechanism; the tendons are locked there and the load applied,
    in a step with the action 0.
    Drawn per episode: a target that the unloaded mechanism reaches (`target`), and the load: a dead force at the
    origin of a random moving link, uniform in direction and in magnitude from 0 to 1 N (`load`).
    `reset(options=...)` fixes any of "target", "load", "mechanism", "start" and "friction"; the random draws are in
    `info["sampled"]`.

    ## Episode end
    Truncated by the environment itself after `episode_steps` (50); no TimeLimit is registered, because a native
    vector environment has no such wrapper and both must end alike. Reaching the target does not end the episode.
    Terminated only when the solver finds no usable equilibrium: `info["status"]` says why, the penalty is added, and
    pose, tensions and commands are the last good ones.

    ## Info
    `error_mm`, `status` (name of a rollingjoint Status), `tip` and `target` (2,) [mm], `load` {"link", "force"},
    `tensions` (m,) [N], `command` (m,) [mm]; from `step` also `reward_terms`, from `reset` `sampled`; with friction
    `gap_tensions` (n - 1, m) [N], `sticking` (n - 1, m), `dissipated_work` [N·mm].

    ## Arguments
    `RollingJointEnv(render_mode=None, config=None, **overrides)`: `config` is a TrackingConfig or a dictionary of its
    fields; overrides go on top, and nested ones change only the named fields:
    `gymnasium.make("rj_gym/RollingJoint-v0", episode_steps=20, load={"magnitude": (0, 1.5)})`.
    See TrackingConfig, LoadConfig, TargetConfig, RewardConfig, RandomizationConfig and FrictionConfig: tendons rub in
    their holes (`friction`, off), by a hidden coefficient drawn per episode, and poses depend on the moves before them.

    ## Version history
    * v0: first version.
    """

    settings: ClassVar[type[Settings]] = TrackingConfig
    task_class: ClassVar[Callable[[Any], Task]] = PlanarTask
    buffer: ClassVar[type[EpisodeBuffer]] = TrackingEpisodeBuffer


class RollingJointGoalEnv(GoalTaskEnv, RollingJointEnv):
    """The tracking task with goals, for hindsight relabelling: as RollingJointEnv, with these differences.

    ## Observation space
    `Dict`, float32:

    | Key | Meaning | Unit | Low | High |
    |---|---|---|---|---|
    | observation | the entries of RollingJointEnv without target and tip error | | | |
    | achieved_goal | true tip x, y (without sensor noise) | L | -2 | 2 |
    | desired_goal | target x, y | L | -2 | 2 |

    ## Reward
    Exactly `compute_reward(achieved_goal, desired_goal, info)`, which does not read info and takes batches:
    "dense" (default) is - error / `error_scale_mm`; "sparse" (`reward={"goal": "sparse"}`) is 0 where the error is at
    most `goal_tolerance_mm` (2 mm), else -1. There are no effort, smoothness and failure terms.

    ## Info
    As RollingJointEnv, and `is_success`: whether the error is at most `goal_tolerance_mm`.

    ## Version history
    * v0: first version.
    """


class InstrumentEnv(RollingJointEnv):
    """Bring an instrument's tip to a target without measurements of it: as RollingJointEnv, with these differences.

    Motors pull tendons through a sheath with play and friction. The agent reads the positions and tensions of the
    motors; from these it has to infer play, friction and the force at the tip.

    ## Action space
    As RollingJointEnv, but an action moves the motor, q. The tendon's command p (`info["command"]`) follows by a play
    operator, p <- clip(p, q - h, q + h), h half the width of the play. Where a tension is at a limit, the motor moves
    with the command.

    ## Observation space
    `Box(low, high, (entries,), float32)`; values are clipped to the bounds. `rj_gym.observation_entries` lists them.

    | Entries | Meaning | Unit | Low | High |
    |---|---|---|---|---|
    | tendon j command | measured motor position minus neutral length | `command_scale_mm` (20 mm) | -2 | 2 |
    | tendon j tension | measured by the motor: T exp(nu zeta), zeta = (p - q) / h | largest tension (15 N) | 0 | 3 |
    | target x, target y | where the tip should be now | L | -2 | 2 |
    | past readings (`observe_history`, 1) | for every lag, see below | | | |

    With `observe_history=[1, 2, 4]` (or a number k, for 1 to k) there follow for every lag, oldest last, entries with
    names such as "tendon 0 action, lag 2":

    | Entries | Meaning | Unit | Low | High |
    |---|---|---|---|---|
    | tendon j action at lag l | the action that was taken l steps ago | 1 | -1 | 1 |
    | tendon j command at lag l | measured motor position then minus now | `action_scale_mm` (1 mm) | -50 | 50 |
    | tendon j tension at lag l | measured tension then minus now | 2 N | -50 | 50 |
    | tip error x at lag l, tip error y at lag l (with a pose) | the same of the error | `error_scale_mm` | -10 | 10 |

    ## Reward
    As RollingJointEnv with effort 0, smoothness 0.002 and precision 0.5: tracking loses 0.5 error / (error + 1 mm) too.

    ## Start
    As RollingJointEnv. Drawn per episode and hidden: a constant force at the tip, 0 to 1 N; stiffness of every tendon
    (20 %), motor offsets (0.5 mm) and contact surfaces (0.1 mm, 0.01 rad) unlike the model; the width of every
    tendon's play, 0.5 to 3 mm, and where in it the tendon begins; every sheath's nu, 0 to 0.6.

    ## Episode end
    As RollingJointEnv. Controllers are compared by the mean tip error over the last 10 steps.

    ## Info
    As RollingJointEnv; with `privileged="info"` also `privileged`: the true state, hidden parts included, for teachers
    and critics (`rj_gym.privileged_entries` lists it). With `privileged="observation"` the observation is a Dict of
    `observation` and `privileged` instead. `sampled` has `play_mm`, `motor_starts` and `sheath_friction`, too.

    ## Arguments
    As RollingJointEnv, with InstrumentConfig: TrackingConfig with other defaults, see SensingConfig and
    ActuationConfig. Moving targets: `target={"process": "path"}`.

    ## Version history
    * v0: first version, with an ideal limit of tension, behind the sheath; InstrumentV1Env has that of a motor.
    """

    settings: ClassVar[type[Settings]] = InstrumentConfig


class InstrumentShiftEnv(InstrumentEnv):
    """The instrument as it is before it wears, to train for later wear: as InstrumentEnv, with these differences.

    ## Start
    Surfaces are exact; play is 0.5 to 2 mm and nu 0 to 0.3. That is the world to train in. Controllers are tested in
    two others, absent from training: `actuation={"play_mm": (2, 3)}` and
    `actuation={"sheath_friction": (0, 0.6)}`.

    ## Arguments
    As InstrumentEnv, with InstrumentShiftConfig.

    ## Version history
    * v0: first version, with an ideal limit of tension: see InstrumentShiftV1Env.
    """

    settings: ClassVar[type[Settings]] = InstrumentShiftConfig


class SlowCameraEnv(RollingJointEnv):
    """A camera that looks now and then, and tensions all the time: as RollingJointEnv, with these differences.

    ## Observation space
    As RollingJointEnv; link entries and tip error come from the last picture. After them:

    | Entries | Meaning | Unit | Low | High |
    |---|---|---|---|---|
    | picture age | how old the picture is | 10 steps | 0 | 100 |
    | picture new | 1 if it came in this step | 1 | 0 | 1 |

    A picture comes at every fifth step, counted from a random one, and is then three steps old; an episode begins with
    a picture of its start. Its noise is 0.5 mm and 0.01 rad; tensions, measured at every step, have 0.1 N. Tension
    entries go up to 3. Past readings (`observe_history`, 1) as in InstrumentEnv.

    ## Reward
    As InstrumentEnv.

    ## Start
    As InstrumentEnv without play and friction. The force wanders (an Ornstein-Uhlenbeck process of 15 steps, 1 N at
    most) and pulls a random link.

    ## Arguments
    As RollingJointEnv, with SlowCameraConfig; info as InstrumentEnv.

    ## Version history
    * v0: first version, with an ideal limit of tension: see SlowCameraV1Env.
    """

    settings: ClassVar[type[Settings]] = SlowCameraConfig


class LatePoseEnv(RollingJointEnv):
    """Poses come late, and play and friction come between motors and tendons: as InstrumentEnv, with these differences.

    ## Observation space
    As SlowCameraEnv, but every step brings a picture of two steps ago, with noise of 0.3 mm and 0.005 rad.

    ## Start
    Mechanism and motors are as in the model; play is 0.5 to 3 mm and nu 0 to 0.3. The force at the tip wanders as
    in SlowCameraEnv.

    ## Arguments
    As RollingJointEnv, with LatePoseConfig; info as InstrumentEnv.

    ## Version history
    * v0: first version, with an ideal limit of tension: see LatePoseV1Env.
    """

    settings: ClassVar[type[Settings]] = LatePoseConfig


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
    | tendon j command | commanded length minus the straight arm's, j = 0 ... m - 1 | `command_scale_mm` (30 mm) | -2 | 2 |
    | tendon j tension (`observe_tensions`, on) | measured tension | largest tension (15 N) | 0 | 1 |
    | target x, target y, target z | where the tip should be now | L | -2 | 2 |
    | target R xx, target R yx, target R zx, target R xy, target R yy, target R zy (`orientation`, off) | axes of the target frame | 1 | -1 | 1 |
    | tip error x, tip error y, tip error z | target minus measured tip | `error_scale_mm` (30 mm) | -10 | 10 |
    | angle error x, angle error y, angle error z (`orientation`, off) | rotation vector from the measured to the target frame | `angle_scale_rad` (0.3 rad) | -10.472 | 10.472 |
    | gravity x, gravity y, gravity z (`observe_load`, off) | its direction in the base frame | 1 | -1 | 1 |
    | payload (`observe_load`, off) | weight at the tip | largest `load.magnitude` (0.5 N) | 0 | 1 |

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
    "mechanism", "start" and "friction"; the random draws are in `info["sampled"]`.

    ## Episode end
    As RollingJointEnv: truncated by the environment itself after `episode_steps` (50), terminated only where
    the solver finds no usable equilibrium, with the penalty and the observation of the last good pose.

    ## Info
    `error_mm`, `status` (name of a rollingjoint Status), `tip` and `target` (3,) [mm], `load` {"link", "force"},
    `gravity` (3,), `tensions` (m,) [N], `command` (m,) [mm]; with `orientation` `angle_error_rad`; from `step` also
    `reward_terms`, from `reset` also `sampled`; with friction `gap_tensions` (n - 1, m) [N], `sticking` (n - 1, m),
    `dissipated_work` [N·mm].

    ## Arguments
    `FlexibleArmEnv(render_mode=None, config=None, **overrides)`: `config` is a FlexibleArmConfig or a dictionary of its
    fields; overrides go on top, and nested ones change only the named fields:
    `gymnasium.make("rj_gym/FlexibleArm-v0", orientation=True, load={"magnitude": (0, 0.8)})`.
    See FlexibleArmConfig, PayloadConfig, GravityConfig, ArmTargetConfig, ArmRewardConfig, ArmRandomizationConfig and
    FrictionConfig (`friction`, off): tendons rub in the beads' holes, by a hidden coefficient drawn per episode.

    ## Version history
    * v0: first version.
    """  # noqa: E501

    settings: ClassVar[type[Settings]] = FlexibleArmConfig
    task_class: ClassVar[Callable[[Any], Task]] = ArmTask
    buffer: ClassVar[type[EpisodeBuffer]] = TrackingEpisodeBuffer


class FlexibleArmGoalEnv(GoalTaskEnv, FlexibleArmEnv):
    """The arm's task with goals, for hindsight relabelling: as FlexibleArmEnv, with these differences.

    ## Observation space
    `Dict`, float32:

    | Key | Meaning | Unit | Low | High |
    |---|---|---|---|---|
    | observation | the entries of FlexibleArmEnv without target and errors | | | |
    | achieved_goal | true tip x, y, z (without sensor noise) | L | -2 | 2 |
    | desired_goal | target x, y, z | L | -2 | 2 |

    With `orientation` both goals go on with the six entries "R xx" ... "R zy" of their frame, within [-1, 1].

    ## Reward
    Exactly `compute_reward(achieved_goal, desired_goal, info)`, which does not read info and takes batches:
    "dense" (default) is - error / `error_scale_mm`, with `orientation` - angle / `angle_scale_rad` on top; "sparse"
    (`reward={"goal": "sparse"}`) is 0 where the error is at most `goal_tolerance_mm` (5 mm), and the angle at most
    `goal_tolerance_rad` (0.05 rad), else -1. There are no effort, smoothness and failure terms.

    ## Info
    As FlexibleArmEnv, and `is_success`: whether the errors are within the tolerances.

    ## Version history
    * v0: first version.
    """


class PitchYawEnv(FlexibleArmEnv):
    """Bring the tip of a slender instrument in space to a target: as FlexibleArmEnv, with these differences.

    A tube of n - 1 rolling joints about pitch and yaw axes in turn, m tendons, length L (112 mm, 14 joints and m = 8
    for the default one, in two segments of four tendons each, whose tip fills space). Its links have no weight by
    default; the payload pulls along gravity, which has any direction, as of an instrument that is held at any attitude.

    ## Action space
    As FlexibleArmEnv, in units of 0.5 mm.

    ## Observation space
    `Box(low, high, (entries,), float32)`; values are clipped to the bounds. `rj_gym.observation_entries` lists them.

    | Entries | Meaning | Unit | Low | High |
    |---|---|---|---|---|
    | tip x, tip y, tip z | where the tip is | L | -2 | 2 |
    | tendon j command | commanded length minus neutral, j = 0 ... m - 1 | `command_scale_mm` (10 mm) | -2 | 2 |
    | tendon j tension (`observe_tensions`, on) | measured tension | largest tension (15 N) | 0 | 1 |
    | target x, target y, target z | where the tip should be now | L | -2 | 2 |
    | tip error x, tip error y, tip error z | target minus measured tip | `error_scale_mm` (10 mm) | -10 | 10 |

    With `orientation` and `observe_load` more entries as in FlexibleArmEnv. With `sensing={"pose": "none"}` nobody sees
    the tip: there are neither tip nor tip error.

    ## Reward
    As FlexibleArmEnv, with an `error_scale_mm` of 10 mm.

    ## Start
    Drawn per episode: a target, the tip of an equilibrium without payload at tensions from 2 to 8 N (`target`); the
    payload, a dead force at the tip along gravity, uniform from 0 to 0.2 N (`load`); the direction of gravity, uniform
    over the sphere (`gravity`). Tensions of 3 N (`start_tension`) set the instrument without payload; the tendons are
    locked there and the payload applied. The tip of a mechanism with four tendons moves on a surface, off which the
    payload pushes it: `target={"loaded": True}` draws targets under the payload.

    ## Info
    As FlexibleArmEnv; the privileged state has "joint i angle" in place of "hinge i angle".

    ## Arguments
    As FlexibleArmEnv, with PitchYawConfig, and a SpatialChain as its `mechanism`.

    ## Version history
    * v0: first version.
    """

    settings: ClassVar[type[Settings]] = PitchYawConfig


class ArmInstrumentEnv(FlexibleArmEnv):
    """Bring an arm's tip to a target without measurements of it: as FlexibleArmEnv, with these differences.

    Motors pull the tendons through a sheath with play and friction, and the tendons rub in the holes of the beads. The
    agent reads the positions and tensions of the motors.

    ## Action space
    As FlexibleArmEnv, but an action moves the motor, and the tendon's command follows through play: see InstrumentEnv.

    ## Observation space
    `Box(low, high, (entries,), float32)`; values are clipped to the bounds.

    | Entries | Meaning | Unit | Low | High |
    |---|---|---|---|---|
    | tendon j command | measured motor position minus length when straight | `command_scale_mm` (30 mm) | -2 | 2 |
    | tendon j tension | measured by the motor: T exp(nu zeta), zeta = (p - q) / h | largest tension (15 N) | 0 | 3 |
    | target x, target y, target z | where the tip should be now | L | -2 | 2 |

    With `orientation` the axes of the target frame follow; past readings (`observe_history`, 1) as in InstrumentEnv.

    ## Reward
    As FlexibleArmEnv with effort 0, smoothness 0.002 and precision 0.5: tracking loses 0.5 error / (error + 1 mm) too.

    ## Start
    As FlexibleArmEnv. Drawn per episode and hidden besides gravity and payload: the stiffness of every tendon (20 %)
    and hinge (10 %), the weight of every bead (10 %), motor offsets (0.5 mm); the width of every tendon's play, 0.2 to
    1 mm, and where in it the tendon begins; every sheath's nu, 0 to 0.3; mu in the holes, 0 to 0.1, the
    same for all tendons. Targets are tips of equilibria without friction under gravity and payload of the episode.

    ## Episode end
    As FlexibleArmEnv. Controllers are compared by the mean tip error over the last 10 steps.

    ## Info
    As FlexibleArmEnv with friction, and with `privileged` the true state as in InstrumentEnv.

    ## Arguments
    As FlexibleArmEnv, with ArmInstrumentConfig: FlexibleArmConfig with other defaults. Moving targets:
    `target={"process": "path"}`.

    ## Version history
    * v0: first version, with an ideal limit of tension: see ArmInstrumentV1Env.
    """

    settings: ClassVar[type[Settings]] = ArmInstrumentConfig


class InstrumentV1Env(InstrumentEnv):
    """The instrument with the motors and sensors of a rig: as InstrumentEnv, with these differences.

    ## Action space
    A motor moves by an action once it is more than 0.02 mm from where it is commanded (`actuation.dead_band_mm`). No
    tension has an ideal limit. A motor that pulls in stops where the tension before the sheath, T exp(nu zeta), is its
    limit (`actuation.limit_at`: motor); at rest it holds any tension, and paying out is free.

    ## Observation space
    As InstrumentEnv, with tensions in units of 15 N. Motor positions are multiples of 0.015 mm. Load cells, at the
    motors, have a gain within 2 % of 1 and an offset within 0.1 N, constant in an episode and hidden.

    ## Start
    As InstrumentEnv, but motors begin where their load cells show 3 N, and then the load acts (`start`: measured).
    Every motor has a hidden limit, 10 to 30 N in steps of 0.5 N (`actuation.tension_limit`).

    ## Info
    As InstrumentEnv; `sampled` has `tension_limits`, `tension_gains` and `tension_offsets`, too.

    ## Arguments
    As InstrumentEnv, with InstrumentV1Config. `actuation={"tension_limit": [20, 20]}` has the same limit at every
    motor; the observation keeps its units.

    ## Version history
    * v1: limits at the motors, measured starts, errors of load cells, dead bands and counts of motors and encoders.
    * v0: InstrumentEnv, with an ideal limit.
    """

    settings: ClassVar[type[Settings]] = InstrumentV1Config


class InstrumentShiftV1Env(InstrumentShiftEnv):
    """The instrument before it wears, with the motors and sensors of a rig: as InstrumentShiftEnv and InstrumentV1Env.

    ## Arguments
    As InstrumentShiftEnv, with InstrumentShiftV1Config.

    ## Version history
    * v1: motors and sensors as InstrumentV1Env.
    * v0: InstrumentShiftEnv, with an ideal limit.
    """

    settings: ClassVar[type[Settings]] = InstrumentShiftV1Config


class SlowCameraV1Env(SlowCameraEnv):
    """A slow camera with the motors and sensors of a rig: as SlowCameraEnv, with the differences of InstrumentV1Env.

    ## Arguments
    As SlowCameraEnv, with SlowCameraV1Config.

    ## Version history
    * v1: motors and sensors as InstrumentV1Env.
    * v0: SlowCameraEnv, with an ideal limit.
    """

    settings: ClassVar[type[Settings]] = SlowCameraV1Config


class LatePoseV1Env(LatePoseEnv):
    """Late poses with the motors and sensors of a rig: as LatePoseEnv, with the differences of InstrumentV1Env.

    ## Arguments
    As LatePoseEnv, with LatePoseV1Config.

    ## Version history
    * v1: motors and sensors as InstrumentV1Env.
    * v0: LatePoseEnv, with an ideal limit.
    """

    settings: ClassVar[type[Settings]] = LatePoseV1Config


class ArmInstrumentV1Env(ArmInstrumentEnv):
    """An arm's instrument with the motors and sensors of a rig: as ArmInstrumentEnv and InstrumentV1Env.

    ## Arguments
    As ArmInstrumentEnv, with ArmInstrumentV1Config.

    ## Version history
    * v1: motors and sensors as InstrumentV1Env.
    * v0: ArmInstrumentEnv, with an ideal limit.
    """

    settings: ClassVar[type[Settings]] = ArmInstrumentV1Config
