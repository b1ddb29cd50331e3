"""Results cannot be bent into indices that compiled code would follow: read-only arrays, checked copies."""

import copy
import pickle
from dataclasses import fields, replace

import numpy as np
import pytest

from rollingjoint import InvalidInput, WorldForce, five_link, preset, solve_tensions, solve_tensions_batch, uniform
from rollingjoint.friction import CapstanFriction


def _solved(name: str, batch: bool = False, friction: bool = False):
    mechanism = preset(name)
    force = WorldForce(-1, (0.1, 0.05) if name == "five_link" else (0.1, 0.05, 0.0))
    tensions = np.full(mechanism.n_tendons, 2.0)
    if friction:
        mechanism = mechanism.replace(friction=CapstanFriction(0.1))
        before = solve_tensions(mechanism, tensions, [force])
        return solve_tensions(mechanism, tensions + 0.5, [force], history=before)
    if batch:
        return solve_tensions_batch(mechanism, [tensions, 2.0 * tensions], [force])
    return solve_tensions(mechanism, tensions, [force])


def _arrays(result):
    values = {each.name: getattr(result, each.name) for each in fields(result)}
    found = {name: value for name, value in values.items() if isinstance(value, np.ndarray)}
    if result.friction is not None:
        found |= {"gap_tensions": result.gap_tensions, "slip": result.slip} | result.friction_state._asdict()
    return found


CASES = {
    "chain": lambda: _solved("five_link"),
    "arm": lambda: _solved("small_arm"),
    "chains": lambda: _solved("five_link", batch=True),
    "arms": lambda: _solved("small_arm", batch=True),
    "a row": lambda: _solved("five_link", batch=True).row(1),
    "friction": lambda: _solved("five_link", friction=True),
    "pickled": lambda: pickle.loads(pickle.dumps(_solved("five_link"))),
    "deep copy": lambda: copy.deepcopy(_solved("small_arm")),
    "replaced": lambda: replace(_solved("five_link"), joint_angles=np.zeros(4)),
}


@pytest.mark.parametrize("case", CASES)
def test_every_array_of_a_result_is_read_only(case):
    result = CASES[case]()
    before = np.array(result.stiffness)
    arrays = _arrays(result)
    assert {"loads", "joint_angles", "poses", "tensions", "tendon_rates"} <= set(arrays)
    for name, array in arrays.items():
        with pytest.raises(ValueError, match="read-only"):
            array[...] = 1e9
            pytest.fail(name)
    np.testing.assert_array_equal(result.stiffness, before)


@pytest.mark.parametrize("case", ["chain", "arm", "chains", "friction"])
@pytest.mark.parametrize("name", ["joint_angles", "tensions", "tendon_stiffness", "tendon_rates", "poses", "lengths"])
def test_replacing_an_array_by_one_of_another_shape_is_refused(case, name):
    result = CASES[case]()
    array = getattr(result, name)
    for wrong in (np.zeros(4_000), array[..., :-1], array[..., None], array.tolist(), None, 3.0):
        with pytest.raises(InvalidInput, match=name):
            replace(result, **{name: wrong})


@pytest.mark.parametrize("case", ["chain", "arm", "chains", "arms"])
@pytest.mark.parametrize("link", [1e9, -1.0, 0.5, np.nan, 1e300])
def test_replacing_loads_by_those_of_links_that_do_not_exist_is_refused(case, link):
    result = CASES[case]()
    loads = result.loads.copy()
    loads[..., 0, 0] = link
    with pytest.raises(InvalidInput, match="links of the load table"):
        replace(result, loads=loads)
    with pytest.raises(InvalidInput, match="loads"):
        replace(result, loads=result.loads[..., :3])
    with pytest.raises(InvalidInput, match="loads"):
        replace(result, loads=result.loads[..., 0])


def test_a_mechanism_that_does_not_fit_is_refused_and_friction_is_checked():
    with pytest.raises(InvalidInput, match="joint_angles"):
        replace(_solved("five_link"), mechanism=uniform(7))
    result = _solved("five_link", friction=True)
    state = result.friction.state._replace(states=np.zeros((400, 2)))
    with pytest.raises(InvalidInput, match=r"friction state \(states\)"):
        replace(result, friction=replace(result.friction, state=state))


def test_a_replaced_array_is_a_copy():
    angles = np.zeros(4)
    result = replace(_solved("five_link"), joint_angles=angles)
    angles[:] = 1.0
    assert not result.joint_angles.any() and angles.flags.writeable
    assert result.mechanism.n_joints == five_link().n_joints
