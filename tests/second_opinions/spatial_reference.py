"""Reference equilibria of chains in space, from a file: chains and loads as this package has them, and differences.

spatial_reference.json was computed in joint angles by a NumPy prototype and once more in maximal coordinates, where the
force and moment of every contact are unknown and no energy is used; its `about` states the conventions.
"""

import json
from pathlib import Path

import numpy as np

from rollingjoint import (
    BodyWrench,
    PointHinge,
    Profile,
    RollingContact,
    SpaceTendon,
    SpatialChain,
    Spring,
    Surface,
    WorldForce,
    solve_lengths,
    solve_tensions,
)
from rollingjoint._numba.jit import standalone
from rollingjoint.kernels import contacts, turns
from rollingjoint.kernels.friction import N_TURN, TURN

REFERENCE = Path(__file__).with_name("spatial_reference.json")

_new_state, _fill_geometry = standalone(contacts.new_contact_state), standalone(contacts.geometry_of)
_fill_turns = standalone(turns.fill_contact_turns)


def cases(path=REFERENCE):
    """The cases of a file, dictionaries."""
    return json.loads(Path(path).read_text("utf-8"))["cases"]


def surface(values):
    """A surface from breaks and rows of coefficients, which may be of different lengths."""
    longest = max(map(len, values["coefficients"]))
    rows = [[*row, *[0.0] * (longest - len(row))] for row in values["coefficients"]]
    profile = Profile.piecewise_polynomial(values["breaks"], rows)
    return Surface(profile, tuple(values["start"]), values["angle"])


def joint(values):
    """A joint of any kind."""
    spring = {"stiffness": values["stiffness"], "rest_angle": values["rest_angle"]}
    if values["kind"] == "hinge":
        limits = {"limits": tuple(values["limits"])} if "limits" in values else {}
        return PointHinge(values["axis"], values["below"], values["above"], **spring, **limits)
    sides = surface(values["parent"]), surface(values["child"])
    return RollingContact(values["phi"], *sides, values["half_width"], values["middle"], **spring)


def chain(case):
    """The mechanism of a case."""
    tendons = [SpaceTendon(t["holes"], len(t["holes"]) - 1, t["stiffness"]) for t in case["tendons"]]
    return SpatialChain([joint(values) for values in case["joints"]], tendons, name=case["name"])


def loads(case):
    """The loads of a case."""
    acting = []
    for load in case["loads"]:
        link, point = load["link"], tuple(load["point"])
        acting.append(WorldForce(link, tuple(load["force"]), tuple(load["moment"]), point))
        acting.append(BodyWrench(link, tuple(load["body_force"]), tuple(load["body_moment"]), point))
        acting.append(Spring(link, load["spring"], tuple(load["anchor"]), point))
    return acting


def solved(case, mechanism=None):
    """The equilibrium of a case, from the neutral pose."""
    mechanism, law = mechanism or chain(case), case["law"]
    if case["given"] == "tensions":
        return solve_tensions(mechanism, law["low"], loads(case))
    high = [np.inf if limit is None else limit for limit in law["high"]]
    return solve_lengths(mechanism, law["command"], loads(case), tension_limits=(law["low"], high))


def differences(case, equilibrium):
    """Largest difference of every quantity from its reference; infinite where one has a value and the other none.

    Turns of the tendons are compared where the case has them.
    """
    expected, e = case["expected"], equilibrium
    names = ("joint_angles", "arc_lengths", "positions", "rotations", "contact_points", "tensions", "lengths")
    values = {name: getattr(e, name) for name in (*names, "tendon_rates", "smallest_eigenvalue", "reactions")}
    largest = {name: _largest(values[name], expected[name]) for name in values}
    if "turns" in expected:
        turned = turns_of_links(e.mechanism, expected["turns"])
        largest["turns"] = _largest(turns_at(e.mechanism, e.joint_angles), turned)
    return largest


def geometry_at(mechanism, angles):
    """The arrays of a mechanism without its axis of designs, and its state at joint angles, a ContactState."""
    state, arrays = _new_state(mechanism.n_joints, mechanism.n_tendons), mechanism.arrays._asdict()
    state.angle[:] = angles
    whole = ("cells", "coefficients", "tendon_joints")  # of all designs
    design = contacts.ContactJoints(**{name: a if name in whole else a[0] for name, a in arrays.items()})
    _fill_geometry(design, state)
    return design, state


def turns_at(mechanism, angles):
    """Turn of every tendon at the two holes of the link below each joint, (J, m) [rad]; NaN where it does not pass."""
    turn = np.full((mechanism.n_joints, mechanism.n_tendons, N_TURN), np.nan)
    _fill_turns(*geometry_at(mechanism, angles), turn)
    return turn[..., TURN]


def turns_of_links(mechanism, turns_of_gaps):
    """The same from turns at the holes below and above every gap, (J, m, 2) [rad]."""
    below, above = np.moveaxis(np.array(turns_of_gaps, float), 2, 0)
    entry = np.vstack([np.zeros((1, mechanism.n_tendons)), above[:-1]])
    passes = np.arange(mechanism.n_joints)[:, None] < mechanism.last_links
    return np.where(passes, entry + below, np.nan)


def _largest(values, expected):
    values, expected = np.array(values, float), np.array(expected, float)
    if not np.array_equal(np.isnan(values), np.isnan(expected)):
        return np.inf
    return float(np.nanmax(np.abs(values - expected), initial=0.0))
