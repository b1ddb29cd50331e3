"""The arrays that a step of the tracking tasks works on, as its compiled code declares them."""

from __future__ import annotations

from typing import Annotated, NamedTuple

from rollingjoint.compiled import Floats, Integers, Singles

# Rows of Hardware.motors [mm]: where motors are, where they are going; both after a step that stands; the position that
# the step asks of the tendon.
MOTOR, GOAL, NEXT_MOTOR, NEXT_GOAL, ASKED, MOTOR_ROWS = range(6)
# Rows of Hardware.limits: the drawn limit; the upper limit of the tension behind the sheath in the last solve, infinite
# where a motor was at rest or paid out [N]; and whether a limit stopped a motor at its place, or in its play.
LIMIT, BOUND, STOP, LIMIT_ROWS = range(4)
MOVES, STAYS, IN_PLAY = range(3)  # values of STOP
GAIN, OFFSET, CELL_ROWS = range(3)  # rows of Hardware.cells [1, N]
POSITION, TENSION, SENSED = range(3)  # rows of Hardware.measured [mm, N]
TAKEN, NEW = range(2)  # columns of Hardware.picture: the step it is from, and whether it came in this step

LAG_TENSION = 2.0  # N: unit of past tensions
AGE = 10.0  # steps: unit of the age of a picture


class HardwareRules(NamedTuple):
    """Numbers that all lanes share; settings are SensingConfig's and ActuationConfig's."""

    active: bool
    rate_limit: float  # mm
    action_delay: int  # steps
    dead_band: float  # mm
    limits_pulls: bool  # whether limits act at motors
    cells_at_tendons: bool
    encoder_resolution: float  # mm
    tension_resolution: float  # N
    late: bool
    period: int  # steps
    picture_delay: int  # steps
    lags: Annotated[Integers, "lags"]  # steps
    stiffnesses: Annotated[Floats, "m"]  # of the nominal tendons, N/mm
    tells_limits: bool  # in the privileged state
    friction: bool  # whether tendons can rub in their holes
    steps: int  # of an episode
    privileged_at: int  # first column of readings
    privileged_low: Annotated[Singles, "K"]
    privileged_high: Annotated[Singles, "K"]


class Hardware(NamedTuple):
    """Motors and sensors of lanes; none where they are not active. Up to `cells`: constant in an episode."""

    half_play: Annotated[Floats, "lanes", "m"]  # mm
    sheath: Annotated[Floats, "lanes", "m"]
    starts: Annotated[Floats, "lanes", "m"]  # q - p at the start, mm
    friction: Annotated[Floats, "lanes", "m"]  # coefficients, in the holes of links
    encoder_noise: Annotated[Floats, "lanes", "0 or T + 1 positions", "m"]  # mm
    tension_noise: Annotated[Floats, "lanes", "0 or T + 1 tensions", "m"]  # N
    phase: Annotated[Integers, "lanes"]  # of the pictures, steps
    cells: Annotated[Floats, "0 or lanes with errors of load cells", 2, "m"]  # CELL_ROWS
    limits: Annotated[Floats, "0 or lanes with separate limits", 3, "m"]  # LIMIT_ROWS
    motors: Annotated[Floats, "lanes", 5, "m"]  # MOTOR_ROWS
    measured: Annotated[Floats, "lanes", 2, "m"]  # SENSED
    pictures: Annotated[Floats, "lanes", "depth", "pose"]  # true poses: a ring over steps, and the one that is seen
    picture: Annotated[Integers, "lanes", 2]
    errors: Annotated[Floats, "lanes", "0 or d"]  # target minus measured tip, mm
    past: Annotated[Floats, "lanes", "times", "width"]  # action, position, tension (m each), error: a ring over steps


class Rules(NamedTuple):
    """Numbers that all lanes share, filled in TrackingTask.rules; scales as in the settings."""

    dimension: int  # coordinates of a position, 2 or 3
    slips: bool  # whether joints are contacts: in space, another class of arrays for the solver
    action_scale: float  # mm
    length: float  # of the mechanism, mm
    command_scale: float  # mm
    error_scale: float  # mm
    angle_scale: float  # rad
    highest_tension: float  # N
    force_scale: float  # N
    effort: float
    smoothness: float
    failure_penalty: float
    precision: float
    orientation: bool  # whether targets have a frame
    observe_tensions: bool
    observe_target: bool  # and the errors
    observe_load: bool
    neutral_lengths: Annotated[Floats, "m"]  # mm
    low: Annotated[Singles, "entries"]  # of the observation
    high: Annotated[Singles, "entries"]
    first_seen: int  # of the moving links, those before it are not observed
    force_column: int  # of a load table, the first of the force
    hardware: HardwareRules


class Course(NamedTuple):
    """Constants and series of an episode; series have one entry where they are constant."""

    targets: Annotated[Floats, "B", "1 or T + 1 targets", "d or d + 9"]  # mm; rotation matrices with `orientation`
    forces: Annotated[Floats, "B", "1 or T + 1 forces", "d"]  # N
    stiffnesses: Annotated[Floats, "B", "m"]  # N/mm
    actuator_offsets: Annotated[Floats, "B", "m"]  # mm
    noise: Annotated[Floats, "B", "0, 1 or T + 1", "measured links", "errors"]  # mm, rad


class RunningEpisodes(NamedTuple):
    """Where running episodes are. A pose has 3 numbers in the plane (mm, mm, rad), 4 x 4 in space (row by row, mm)."""

    angles: Annotated[Floats, "B", "J"]  # joint angles of the last usable equilibrium, rad
    responses: Annotated[Floats, "B or 0 responses", "J", "m"]  # its d angle / d command, rad/mm
    poses: Annotated[Floats, "B", "n", "pose numbers"]  # its poses
    actions: Annotated[Floats, "B", 2, "m"]  # the last action and the one before, within [-1, 1]
    readings: Annotated[Floats, "B", "columns"]  # see rj_gym/core/columns.py
    tip_rates: Annotated[Floats, "0 or B", 2, "m"]  # d tip / d command, where it is asked for


class StepInputs(NamedTuple):
    """Inputs of a step and of its solve."""

    actions: Annotated[Floats, "B", "m"]  # not yet clipped
    starts: Annotated[Floats, "B", "J"]  # joint angles from which the solver starts, rad
    commands: Annotated[Floats, "B", "m"]  # tendon lengths, mm
    highest: Annotated[Floats, "B", "m"]  # tensions, N
    loads: Annotated[Floats, "B", "rows", "load columns"]  # the force that changes in the last row


class StepResults(NamedTuple):
    """The parts of the solver's results that the task reads."""

    joint_angles: Annotated[Floats, "B", "J"]
    poses: Annotated[Floats, "B", "n", "pose numbers"]
    tensions: Annotated[Floats, "B", "m"]
    lengths: Annotated[Floats, "B", "m"]
    responses: Annotated[Floats, "B or 0 responses", "J", "m"]
    contacts: Annotated[Floats, "B or 0", "J", 4]
    status: Annotated[Integers, "B"]


class TaskArrays(NamedTuple):
    """Everything that the kernels of kernels.py work on."""

    rules: Rules
    course: Course
    state: RunningEpisodes
    hardware: Hardware
    inputs: StepInputs
    solved: StepResults
    solver: int  # address of the solver's machine code, for compiled.call_range; 0: all lanes are left to Python
    problem: int  # address of the solver's arrays
