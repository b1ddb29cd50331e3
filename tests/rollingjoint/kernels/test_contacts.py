"""Joints with contacts in space: geometry and reactions of the reference cases, at their angles, without a solver."""

import numpy as np
import pytest

from rollingjoint._numba.jit import standalone
from rollingjoint.kernels import contacts
from tests.second_opinions import spatial_reference as reference

CASES = reference.cases()
tangent, fill_reaction = standalone(contacts.tangent), standalone(contacts.fill_reaction)
cases = pytest.mark.parametrize("case", CASES, ids=lambda case: case["name"][:30])


def at_angles(case):
    """The design of a case, and its state at the angles of the equilibrium."""
    mechanism = reference.chain(case)
    return reference.geometry_at(mechanism, case["expected"]["joint_angles"])


@cases
def test_poses_contacts_and_gaps_are_the_reference(case):
    (_, state), expected = at_angles(case), case["expected"]
    np.testing.assert_allclose(state.pose[:, 9:], expected["positions"], atol=1e-10)
    np.testing.assert_allclose(state.pose[:, :9].reshape(-1, 3, 3), expected["rotations"], atol=1e-11)
    np.testing.assert_allclose(state.contact, expected["contact_points"], atol=1e-10)
    np.testing.assert_allclose(state.length, expected["lengths"], atol=1e-10)
    np.testing.assert_allclose(state.gap[..., 1], expected["tendon_rates"], atol=1e-10)


@cases
def test_axes_normals_and_tangents_are_at_right_angles(case):
    design, state = at_angles(case)
    for i, joint in enumerate(case["joints"]):
        rotation = state.pose[i, :9].reshape(3, 3)
        lateral, axial, axis = (rotation @ row for row in design.frames[i].reshape(3, 3))
        np.testing.assert_allclose(state.axis[i], axis, atol=1e-14)
        e = np.array(tangent(state.joint, i))
        assert e @ e == pytest.approx(1.0, abs=1e-14)
        along, size = e[0] * lateral + e[1] * axial, np.linalg.norm(state.normal[i])
        assert (size > 0.0) == (joint["kind"] == "rolling")
        if joint["kind"] == "hinge":
            assert tuple(e) == (1.0, 0.0)
        else:
            np.testing.assert_allclose(state.normal[i], -size * np.cross(axis, along), atol=1e-12)


def loads_beyond(case, state):
    """Force and moment about the contact of all loads beyond every joint, (J, 3) both."""
    force, couple = np.zeros((2, len(case["joints"]), 3))
    for load in case["loads"]:
        link = load["link"] % len(state.pose)
        rotation, origin = state.pose[link, :9].reshape(3, 3), state.pose[link, 9:]
        point = origin + rotation @ load["point"]
        pull = load["spring"] * (np.array(load["anchor"]) - point)
        total = np.array(load["force"]) + rotation @ load["body_force"] + pull
        moment = np.array(load["moment"]) + rotation @ load["body_moment"]
        for i in range(link):
            force[i] += total
            couple[i] += moment + np.cross(point - state.contact[i], total)
    return force, couple


@cases
def test_reactions_balance_loads_and_tendons(case):
    design, state = at_angles(case)
    force, couple = loads_beyond(case, state)
    constants = design.frames, design.offsets, design.holes, design.tendon_joints
    for i, expected in enumerate(case["expected"]["reactions"]):
        reaction, tensions = np.empty(6), np.array(case["expected"]["tensions"])
        fill_reaction(*constants, state, tensions, tuple(force[i]), tuple(couple[i]), i, reaction)
        np.testing.assert_allclose(reaction, expected, atol=1e-9)
