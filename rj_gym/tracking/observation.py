"""Entries of the observations of tracking tasks: names, units and bounds.

An entry is what a sensor gives; true values that none gives are shown by `observe_load` and the privileged state alone.
measuring.py fills them (`tendon_entries`: `_observe_tendons`, and so on), in torch rj_gym/torch_env/observing.py.
"""

from __future__ import annotations

import math
from typing import Any

from rj_gym.core.task import POSITION_BOUND, Entry, ObservedError
from rj_gym.tracking.arrays import AGE, LAG_TENSION
from rj_gym.tracking.config import FlexibleArmConfig, TaskConfig
from rj_gym.tracking.sensing import LARGEST_LIMIT, LARGEST_PLAY, LARGEST_SHEATH
from rollingjoint.errors import ConfigError
from rollingjoint.friction import LARGEST_MU

COMMAND_BOUND = 2.0
ERROR_BOUND = 10.0
RATE_BOUND = 100.0  # mm/mm
ANGLE_BOUND = 2 * math.pi
TRUE_TENSION_BOUND = 20.0  # motors at rest hold any tension
SENSED_TENSION_BOUND = 3.0  # sheath friction makes measured tensions larger than any tension
AGE_BOUND = 100.0
LAG_BOUND = 50.0


def observation_entries(config: TaskConfig, mechanism: Any, goal: bool = False) -> list[Entry]:
    """The entries of the observation vector, in order.

    Args:
        config: the settings.
        mechanism: the mechanism before randomisation.
        goal: entries of the Goal environment's "observation", which leaves out the target and the errors.
    """
    entries = measured_entries(config, mechanism) + tendon_entries(config, mechanism.n_tendons)
    if not goal:
        entries += pose_entries("target", config)
        entries += error_entries(config) if config.sensing.pose != "none" else []
    if config.observe_load:
        entries += load_entries(config, mechanism)
    return entries + instrument_entries(config, mechanism.n_tendons)


def first_seen(config: TaskConfig, mechanism: Any) -> int:
    """How many of the moving links, the first ones, are not observed: of an arm all but the tip."""
    if config.sensing.pose == "none":
        return int(mechanism.n_links - 1)
    return int(mechanism.n_links - 2) if config.sensing.pose == "tip" or config.DIMENSION == 3 else 0


def measured_entries(config: TaskConfig, mechanism: Any) -> list[Entry]:
    """The entries of measured poses, in order: of a chain's observed links, or of an arm's tip."""
    if config.DIMENSION == 2:
        return _link_entries(range(1 + first_seen(config, mechanism), mechanism.n_links))
    return pose_entries("tip", config) if config.sensing.pose != "none" else []


def privileged_entries(config: TaskConfig, mechanism: Any) -> list[Entry]:
    """The entries of the privileged state, in order: the true values, hidden ones too."""
    tendons, truth = range(mechanism.n_tendons), tendon_truth_entries(config, mechanism)
    hidden = [*position_error_entries(config), *load_entries(config, mechanism)]
    if config.DIMENSION == 2:
        rates = (Entry(f"tip {axis} by tendon {j}", "mm/mm", -RATE_BOUND, RATE_BOUND) for axis in "xy" for j in tendons)
        return [*_link_entries(range(1, mechanism.n_links)), *hidden, *truth, *rates]
    angles = [
        Entry(f"{mechanism.joint} {i} angle", "rad", -ANGLE_BOUND, ANGLE_BOUND) for i in range(mechanism.n_joints)
    ]
    return [*position_entries("tip", config), *_frame_entries("tip"), *hidden, *angles, *truth]


def load_entries(config: TaskConfig, mechanism: Any) -> list[Entry]:
    """The load: in the plane a force and the link that it pulls, of an arm the direction of gravity and the payload."""
    unit = f"{load_scale(config):g} N"
    if config.DIMENSION == 2:
        forces, links = [Entry(f"load {axis}", unit, -1.0, 1.0) for axis in "xy"], range(1, mechanism.n_links)
        return forces + [Entry(f"load on link {link}", "1 if so, else 0", 0.0, 1.0) for link in links]
    return [*(Entry(f"gravity {axis}", "1", -1.0, 1.0) for axis in "xyz"), Entry("payload", unit, 0.0, 1.0)]


def pose_entries(what: str, config: TaskConfig) -> list[Entry]:
    """A position and, with orientation, the first two columns of a rotation matrix."""
    return position_entries(what, config) + (_frame_entries(what) if config.orientation else [])


def position_entries(what: str, config: TaskConfig) -> list[Entry]:
    """The coordinates of a position in units of the length."""
    return [Entry(f"{what} {axis}", "L", -POSITION_BOUND, POSITION_BOUND) for axis in axes(config)]


def axes(config: TaskConfig) -> str:
    """The names of the coordinates of a position."""
    return "xyz"[: config.DIMENSION]


def _frame_entries(what: str) -> list[Entry]:
    return [Entry(f"{what} R {row}{column}", "1", -1.0, 1.0) for column in "xy" for row in "xyz"]


def _link_entries(links: range) -> list[Entry]:
    """Place and angle of links of a chain."""
    bound, entries = POSITION_BOUND, []
    for link in links:
        entries += [Entry(f"link {link} {axis}", "L", -bound, bound) for axis in "xy"]
        entries += [Entry(f"link {link} {function} angle", "1", -1.0, 1.0) for function in ("cos", "sin")]
    return entries


def tendon_entries(config: TaskConfig, n_tendons: int) -> list[Entry]:
    """The entries of commands and tensions in every tracking task."""
    unit = f"{config.command_scale_mm:g} mm"
    entries = [Entry(f"tendon {j} command", unit, -COMMAND_BOUND, COMMAND_BOUND) for j in range(n_tendons)]
    if config.observe_tensions:
        unit = f"{config.tension_range[1]:g} N"
        rubs = config.actuation.sheath_friction[1] > 0 or config.sensing.tension_noise > 0
        high = SENSED_TENSION_BOUND if rubs or _exceeds_scale(config) else 1.0
        entries += [Entry(f"tendon {j} tension", unit, 0.0, high) for j in range(n_tendons)]
    return entries


def _exceeds_scale(config: TaskConfig) -> bool:
    """Whether tensions can be above the upper end of `tension_range`, or measured so without friction and noise."""
    return config.actuation.limits_vary or config.sensing.cells_err


def instrument_entries(config: TaskConfig, n_tendons: int) -> list[Entry]:
    """Age of the picture and past readings in every tracking task; lags count steps."""
    entries: list[Entry] = []
    if config.sensing.late:
        entries += [
            Entry("picture age", f"{AGE:g} steps", 0.0, AGE_BOUND),
            Entry("picture new", "1 if so, else 0", 0, 1),
        ]
    tendons, has_pose = range(n_tendons), config.sensing.pose != "none"
    moved, pulled, error = (
        f"{config.action_scale_mm:g} mm",
        f"{LAG_TENSION:g} N",
        f"{config.reward.error_scale_mm:g} mm",
    )
    for lag in config.lags:
        entries += [Entry(f"tendon {j} action, lag {lag}", "1", -1.0, 1.0) for j in tendons]
        entries += [Entry(f"tendon {j} command, lag {lag}", moved, -LAG_BOUND, LAG_BOUND) for j in tendons]
        entries += [Entry(f"tendon {j} tension, lag {lag}", pulled, -LAG_BOUND, LAG_BOUND) for j in tendons]
        if has_pose:
            bound = ERROR_BOUND
            entries += [Entry(f"tip error {axis}, lag {lag}", error, -bound, bound) for axis in axes(config)]
    return entries


def tendon_truth_entries(config: TaskConfig, mechanism: Any) -> list[Entry]:
    """The privileged numbers of every tracking task, in the order of hardware.tendon_truth."""
    newtons, far = f"{config.tension_range[1]:g} N", 1.0 + config.randomization.actuator_offset_mm
    kinds = [
        ("tendon {} command minus motor", "mm", -LARGEST_PLAY / 2, LARGEST_PLAY / 2),
        ("tendon {} half play", "mm", 0.0, LARGEST_PLAY / 2),
        ("tendon {} sheath friction", "1", 0.0, LARGEST_SHEATH),
        ("tendon {} tension", newtons, 0.0, TRUE_TENSION_BOUND if config.actuation.limits_vary else 1.0),
        ("tendon {} motor offset", "mm", -far, far),
        ("tendon {} stiffness factor", "1", 0.0, 10.0),
    ]
    if config.has_friction(mechanism):
        kinds.append(("tendon {} friction", "1", 0.0, LARGEST_MU))
    if config.actuation.limits_vary:
        kinds.append(("tendon {} tension limit", "N", 0.0, LARGEST_LIMIT))
    tendons = range(mechanism.n_tendons)
    entries = [Entry(name.format(j), unit, low, high) for name, unit, low, high in kinds for j in tendons]
    return [*entries, Entry("time", "episode_steps", 0.0, 1.0)]


def error_entries(config: TaskConfig) -> list[Entry]:
    """Errors of the tip's position and, with orientation, of its frame."""
    entries = position_error_entries(config)
    if isinstance(config, FlexibleArmConfig) and config.orientation:
        unit, bound = f"{config.reward.angle_scale_rad:g} rad", math.pi / config.reward.angle_scale_rad
        entries += [Entry(f"angle error {axis}", unit, -bound, bound) for axis in "xyz"]
    return entries


def position_error_entries(config: TaskConfig) -> list[Entry]:
    """The tip error."""
    unit = f"{config.reward.error_scale_mm:g} mm"
    return [Entry(f"tip error {axis}", unit, -ERROR_BOUND, ERROR_BOUND) for axis in axes(config)]


def observed_error(config: TaskConfig, entries: list[Entry]) -> ObservedError:
    """The observed tip error among these entries; raises ConfigError where none of them has it."""
    names = [entry.name for entry in entries]
    errors = [entry.name for entry in position_error_entries(config)]
    if not set(errors) <= set(names):
        allowed = "an environment whose observation vector has its entries"
        raise ConfigError("tip error", "not observed", allowed, "Here the tip is not seen, or goals are apart.")
    return ObservedError(tuple(map(names.index, errors)), float(config.reward.error_scale_mm))


def load_scale(config: TaskConfig) -> float:
    """Unit of observed loads: the largest load magnitude, or 1 where there is none [N]."""
    return float(config.load.magnitude[1]) or 1.0
