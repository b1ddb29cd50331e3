"""Torsion springs: one law in every solver, as a load and as a part of the mechanism."""

import numpy as np
import pytest
import yaml

import rollingjoint as rj
from rollingjoint import RollingChain, Spring, TorsionSpring, WorldForce
from rollingjoint.compiled import BatchArrays, PinnedRange, TendonLaw
from rollingjoint.errors import ConfigError, InvalidInput, MechanismError
from rollingjoint.io.mechanism_file import dump_mechanism, mechanism_from_dict, mechanism_to_dict
from rollingjoint.kernels.batch import solve_lanes
from rollingjoint.kernels.rolling import new_results
from rollingjoint.load import LOAD_COLUMNS, load_table
from rollingjoint.statics import sensitivity
from tests.second_opinions.published import solve_tensions_published

FIVE = rj.five_link()
FORCE = WorldForce(-1, (0.1, 0.05), 0.3)
SPRINGS = (TorsionSpring(3, 50.0, 0.1, 1), TorsionSpring(0, 20.0, 0.3, -1), TorsionSpring(2, 30.0, -0.1, 1))


def lengths(count, seed=0):
    return FIVE.neutral_lengths + np.random.default_rng(seed).uniform(-2.0, 1.0, (count, 2))


def energy(chain, law, springs, phi):
    """V of elastic tendons and torsion springs, by the page."""
    theta = chain.poses(phi)[..., 2]
    pull = np.maximum(law.stiffness * (chain.tendon_lengths(phi) - law.command), 0.0)
    turned = [theta[..., spring.link] - theta[..., spring.other] - spring.rest_angle for spring in springs]
    stored = sum(0.5 * spring.stiffness * twist**2 for spring, twist in zip(springs, turned, strict=True))
    return (0.5 * pull**2 / law.stiffness).sum(-1) + stored


def law_of(command):
    return TendonLaw(command, FIVE.stiffnesses.copy(), np.zeros_like(command), np.full_like(command, np.inf))


@pytest.mark.parametrize("rest", [-0.3, 0.0, 0.25])
def test_a_single_joint_without_tension_rests_at_the_rest_angle(rest):
    chain = rj.uniform(2)
    found = rj.solve_tensions(chain, (0.0, 0.0), [TorsionSpring(1, 40.0, rest)])
    assert found.status is rj.Status.CONVERGED
    assert found.joint_angles == pytest.approx([rest], abs=1e-12)
    assert found.stiffness == pytest.approx(np.array([[40.0]]))


def test_a_spring_at_every_joint_sets_every_angle():
    springs = [TorsionSpring(i + 1, 5.0, 0.1 * i, other=i) for i in range(4)]
    assert rj.solve_tensions(FIVE, (0.0, 0.0), springs).joint_angles == pytest.approx([0.0, 0.1, 0.2, 0.3], abs=1e-10)


def test_it_does_not_matter_which_link_is_named_first():
    one = rj.solve_tensions(FIVE, (3.0, 2.0), [TorsionSpring(3, 50.0, 0.2, 1)])
    other = rj.solve_tensions(FIVE, (3.0, 2.0), [TorsionSpring(1, 50.0, -0.2, 3)])
    assert one.joint_angles == pytest.approx(other.joint_angles, abs=1e-12)


def test_equilibrium_and_stiffness_are_the_differences_of_the_energy():
    command = FIVE.neutral_lengths - (1.5, 0.5)
    found = rj.solve_lengths(FIVE, command, SPRINGS)
    step = 1e-4 * np.eye(4)

    def value(phi):
        return energy(FIVE, law_of(command), SPRINGS, phi)

    slope = [value(found.joint_angles + e) - value(found.joint_angles - e) for e in step]
    assert np.array(slope) / 2e-4 == pytest.approx(0.0, abs=1e-5)
    second = [
        [sum(a * b * value(found.joint_angles + a * u + b * v) for a in (1, -1) for b in (1, -1)) / 4e-8 for u in step]
        for v in step
    ]
    assert found.stiffness == pytest.approx(np.array(second), rel=1e-4, abs=1e-3)


def test_a_spring_of_the_mechanism_acts_like_the_same_load():
    chain, command = FIVE.replace(springs=SPRINGS), lengths(30)
    own, load = (
        rj.solve_lengths_batch(chain, command, [FORCE]),
        rj.solve_lengths_batch(FIVE, command, [FORCE, *SPRINGS]),
    )
    assert np.all(own.ok)
    for name in ("joint_angles", "tensions", "contact_forces", "stiffness"):
        assert getattr(own, name) == pytest.approx(getattr(load, name), rel=1e-9, abs=1e-9)
    assert len(own.loads[0]) == 1  # the table has what the caller gave
    taut = rj.solve_tensions(chain, (3.0, 2.0)), rj.solve_tensions(FIVE, (3.0, 2.0), SPRINGS)
    assert taut[0].joint_angles == pytest.approx(taut[1].joint_angles, abs=1e-10)


def test_mechanisms_with_and_without_springs_are_solved_in_one_batch():
    chains = [FIVE, FIVE.replace(springs=SPRINGS), FIVE.replace(springs=SPRINGS[:1])] * 4
    command = lengths(12)
    batch = rj.solve_lengths_batch(chains, command, [FORCE])
    for lane, chain in enumerate(chains):
        assert np.array_equal(batch.joint_angles[lane], rj.solve_lengths(chain, command[lane], [FORCE]).joint_angles)


def test_every_lane_of_a_batch_is_the_single_solve_to_the_last_bit():
    command = lengths(40)
    twisted, plain = load_table([FORCE, *SPRINGS[:1]], 5), load_table([FORCE, FORCE], 5)
    tables = np.array([twisted if lane % 3 else plain for lane in range(40)])
    batch = rj.solve_lengths_batch(FIVE, command, tables)
    for lane in range(40):
        alone = rj.solve_lengths_batch(FIVE, command[lane : lane + 1], tables[lane : lane + 1])
        assert np.array_equal(batch.joint_angles[lane], alone.joint_angles[0])
        assert np.array_equal(batch.stiffness[lane], alone.stiffness[0])


def test_side_by_side_and_lane_by_lane_agree():
    command = lengths(64) - 1.0  # no tendon is slack at the start
    tables = np.repeat(load_table([FORCE, *SPRINGS], 5)[None], 64, axis=0)
    starts, designs = np.repeat(FIVE.neutral_angles[None], 64, axis=0), np.zeros(64, np.int64)
    laws = TendonLaw(*(np.broadcast_to(values, (64, 2)).copy() for values in law_of(command)))  # writable, as compiled
    fast, slow = (BatchArrays(FIVE.arrays, designs, laws, tables, starts, new_results(64, 4, 2)) for _ in range(2))
    side_by_side = PinnedRange(RollingChain.kernels, fast)
    assert side_by_side._solve(0, 64) == 0
    solve_lanes(*slow, np.arange(64))
    assert np.all(slow.results.status == 0)
    assert np.array_equal(fast.results.iterations, slow.results.iterations)
    for name in ("joint_angles", "tensions", "poses", "contact_forces"):
        assert getattr(fast.results, name) == pytest.approx(getattr(slow.results, name), abs=1e-8)


def test_a_long_chain_is_solved_in_few_steps():
    chain = rj.uniform(40)
    springs = [TorsionSpring(30, 200.0, 0.2, 10), TorsionSpring(20, 100.0), TorsionSpring(5, 50.0, 0.1, 4)]
    springs += [TorsionSpring(-1, 10.0, 0.0, 25), Spring(15, 1e-4, (30.0, 300.0))]
    found = rj.solve_tensions(chain, (2.0, 1.98), springs)
    assert found.status is rj.Status.CONVERGED and found.iterations < 12
    table = np.r_[load_table(springs, 40)][None]
    assert rj.solve_tensions_batch(chain, [(2.0, 1.98)], table).joint_angles[0] == pytest.approx(found.joint_angles)


def test_sensitivities_know_the_springs():
    chain, tensions, step = FIVE.replace(springs=SPRINGS), np.array([3.0, 2.0]), 1e-5
    found = rj.solve_tensions(chain, tensions, [FORCE])
    shifts = step * np.eye(2)
    moved = [
        rj.solve_tensions(chain, tensions + e, [FORCE]).poses - rj.solve_tensions(chain, tensions - e, [FORCE]).poses
        for e in shifts
    ]
    assert sensitivity.dposes_dtensions(found) == pytest.approx(np.stack(moved, -1) / (2 * step), rel=1e-5, abs=1e-6)


@pytest.mark.parametrize("own", [False, True])
def test_least_squares_finds_the_tensions_again(own):
    chain, loads = (FIVE.replace(springs=SPRINGS), ()) if own else (FIVE, SPRINGS)
    known = rj.solve_tensions(chain, (3.0, 2.0), loads)
    found = rj.solve_lengths(chain, known.lengths, loads, method="least_squares")
    assert found.tensions == pytest.approx([3.0, 2.0], abs=1e-6)


@pytest.mark.parametrize("solver", ["torch", "compiled"])
def test_torch_solves_the_same_and_differentiates_it(solver):
    torch = pytest.importorskip("torch")
    from rollingjoint import differentiable

    chain, table = FIVE.replace(springs=SPRINGS[:2]), load_table([FORCE, SPRINGS[2]], 5)
    design = differentiable.DifferentiableChain.from_mechanism(chain, requires_grad=("starts",))
    assert design.mechanism().springs == chain.springs
    loads, tensions = torch.tensor(table, requires_grad=True), torch.tensor([3.0, 2.0], dtype=torch.float64)
    found = differentiable.solve_tensions(design, tensions, loads, solver=solver)
    compiled = rj.solve_tensions(chain, (3.0, 2.0), [FORCE, SPRINGS[2]])
    assert found.joint_angles.detach().numpy() == pytest.approx(compiled.joint_angles, abs=1e-9)
    assert found.stiffness.detach().numpy() == pytest.approx(compiled.stiffness, rel=1e-7, abs=1e-6)
    found.poses[-1, 0].backward()
    for column in ("torsion", "rest"):
        place, step = LOAD_COLUMNS.index(column), 1e-4
        tip = []
        for sign in (1.0, -1.0):
            changed = table[None].copy()
            changed[0, 1, place] += sign * step
            tip.append(rj.solve_tensions_batch(chain, [(3.0, 2.0)], changed).tip[0, 0])
        assert float(loads.grad[1, place]) == pytest.approx((tip[0] - tip[1]) / (2 * step), rel=1e-4, abs=1e-7)
    assert bool(torch.isfinite(design.starts.grad).all())


def test_mechanism_files_keep_springs_exactly():
    chain = FIVE.replace(springs=[*SPRINGS, TorsionSpring(1, 0.1 + 0.2, 1 / 3), Spring(-1, 0.02, (40, 60), (1.0, 2.0))])
    read = mechanism_from_dict(yaml.safe_load(dump_mechanism(chain)))
    assert read.springs == chain.springs
    assert np.array_equal(read.arrays.standing, chain.arrays.standing)
    assert "springs" not in mechanism_to_dict(FIVE)
    short = mechanism_to_dict(FIVE) | {"springs": [{"link": 2, "stiffness": 5}]}
    assert mechanism_from_dict(short).springs == (TorsionSpring(2, 5.0),)


@pytest.mark.parametrize(
    "springs, said",
    [
        ([{"link": 9, "stiffness": 5}], "0 (the base) to 4"),
        ([{"link": 2, "stiffness": 5, "other": 2}], "a link other than 2"),
        ([{"link": 2, "stiffness": 5, "rest": 2}], "rest_angle"),
        ([{"link": 2, "stiffness": -5}], ">= 0"),
        ([{"link": 2, "stiffness": "soft"}], "finite number"),
        ([3], "keys and values"),
    ],
)
def test_mistakes_in_mechanism_files_are_told_in_one_line(springs, said):
    with pytest.raises(ConfigError) as caught:
        mechanism_from_dict(mechanism_to_dict(FIVE) | {"springs": springs}, "arm.yaml")
    assert said in str(caught.value) and "arm.yaml" in str(caught.value) and "\n" not in str(caught.value)


def test_rj_takes_torsion_springs(capsys):
    import json

    from rollingjoint.cli import main

    words = "--torsion-spring 3 50 0.1 1 --torsion-spring 2 30 --torsion-spring 1 10 -0.2"
    assert main(["solve", "five_link", "--tensions", "3", "2", "--json", *words.split()]) == 0
    springs = [TorsionSpring(3, 50.0, 0.1, 1), TorsionSpring(2, 30.0), TorsionSpring(1, 10.0, -0.2)]
    expected = rj.solve_tensions(FIVE, (3.0, 2.0), springs)
    told = json.loads(capsys.readouterr().out)
    assert [row["angle_rad"] for row in told["joints"]] == expected.joint_angles.tolist()
    for words, said in (
        ("five_link --tensions 3 2 --torsion-spring 3", "LINK K [REST [OTHER]]"),
        ("five_link --tensions 3 2 --torsion-spring 3 1 0 9", "0 (the base) to 4"),
        ("small_arm --tensions 3 2 1 1 --torsion-spring 3 1", "parallel joints"),
    ):
        assert main(["solve", *words.split()]) == 2
        error = capsys.readouterr().err
        assert said in error and error.count("\n") == 1


def test_what_cannot_be_solved_is_refused_or_says_so():
    with pytest.raises(InvalidInput, match="a link other than"):
        rj.solve_tensions(FIVE, (1.0, 1.0), [TorsionSpring(-1, 5.0, other=4)])
    for loads, chain in ((SPRINGS, FIVE), ((), FIVE.replace(springs=SPRINGS))):
        with pytest.raises(InvalidInput, match="published algorithms"):
            solve_tensions_published(chain, (1.0, 1.0), loads)
    assert rj.solve_tensions(FIVE, (1.0, 1.0), [TorsionSpring(1, -5.0)]).status is rj.Status.INVALID_INPUT
    assert rj.solve_tensions(FIVE, (1.0, 1.0), [TorsionSpring(1, np.nan)]).status is rj.Status.INVALID_INPUT
    for wrong in ([WorldForce(1, (0.0, 1.0))], [TorsionSpring(1, np.nan)], [TorsionSpring(7, 1.0)], 5):
        with pytest.raises(MechanismError):
            FIVE.replace(springs=wrong)


def test_tables_may_end_after_the_anchor():
    command, full = lengths(3), np.repeat(load_table([FORCE, Spring(2, 0.01, (9.0, 9.0))], 5)[None], 3, axis=0)
    former = np.ascontiguousarray(full[..., : LOAD_COLUMNS.index("ay") + 1])
    a, b = (rj.solve_lengths_batch(FIVE, command, table) for table in (full, former))
    assert np.array_equal(a.joint_angles, b.joint_angles) and b.loads.shape == full.shape
    for width in (LOAD_COLUMNS.index("ay"), len(LOAD_COLUMNS) + 1):
        with pytest.raises(InvalidInput, match="shape of the load table"):
            rj.solve_lengths_batch(FIVE, command, np.zeros((3, 1, width)))
    full[..., LOAD_COLUMNS.index("other")] = 7.0
    with pytest.raises(InvalidInput, match="links of the load table"):
        rj.solve_lengths_batch(FIVE, command, full)


def parallel_arm(n, **fields):
    """An arm whose hinges are all about x, so that a torsion spring may span any of them."""
    holes = [(8.0, 1.0), (-8.0, 0.0), (0.0, 7.0), (0.0, -7.0)]
    return rj.HingeChain([rj.Bead(20.0, "x", 300.0, 8.0)] * n, [rj.BeadTendon([hole]) for hole in holes], **fields)


ARM_SPRINGS = (TorsionSpring(4, 200.0, 0.2, 1), TorsionSpring(0, 100.0, -0.3, -1), TorsionSpring(3, 50.0, 0.1, 2))
ARM_FORCE = WorldForce(-1, (0.0, 0.05, 0.1))
PULL = np.array([1.0, 0.5, 2.0, 1.0])


@pytest.mark.parametrize("n", [5, 15, 24])  # dense steps, and steps in O(n)
def test_on_an_arm_equilibrium_and_stiffness_are_the_differences_of_the_energy(n):
    arm = parallel_arm(n)
    found = rj.solve_tensions(arm, PULL, [*ARM_SPRINGS, ARM_FORCE])
    assert found.status is rj.Status.CONVERGED

    def value(phi):
        turns = np.concatenate([[0.0], np.cumsum(phi)])
        stored = sum(0.5 * s.stiffness * (turns[s.link] - turns[s.other] - s.rest_angle) ** 2 for s in ARM_SPRINGS)
        work = np.array(ARM_FORCE.force) @ arm.poses(phi)[-1, :3, 3]
        return PULL @ arm.tendon_lengths(phi) + 150.0 * phi @ phi + stored - work

    step, phi = 1e-4 * np.eye(n), found.joint_angles
    slope = np.array([value(phi + e) - value(phi - e) for e in step]) / 2e-4
    assert slope == pytest.approx(0.0, abs=1e-5)
    for u in step[:4]:
        row = [sum(a * b * value(phi + a * u + b * v) for a in (1, -1) for b in (1, -1)) / 4e-8 for v in step[:4]]
        assert found.stiffness[np.argmax(u), :4] == pytest.approx(np.array(row), rel=1e-4, abs=1e-2)


def test_springs_of_an_arm_act_like_the_same_loads():
    springs = [*ARM_SPRINGS, Spring(2, 0.02, (10.0, 20.0, 80.0), (1.0, 0.0, 2.0))]
    plain, sprung = parallel_arm(6), parallel_arm(6, springs=springs)
    command = plain.neutral_lengths - np.linspace(0.0, 1.0, 12)[:, None] * (1.0, 0.0, 2.0, 0.5)
    own, load = rj.solve_lengths_batch(sprung, command, [ARM_FORCE]), rj.solve_lengths_batch(plain, command, springs)
    assert np.all(own.ok) and not np.allclose(own.joint_angles, load.joint_angles)
    load = rj.solve_lengths_batch(plain, command, [ARM_FORCE, *springs])
    for name in ("joint_angles", "tensions", "stiffness"):
        assert getattr(own, name) == pytest.approx(getattr(load, name), rel=1e-9, abs=1e-9)
    mixed = rj.solve_lengths_batch([sprung, plain] * 6, command, [ARM_FORCE])
    assert mixed.joint_angles[0] == pytest.approx(own.joint_angles[0], abs=1e-12)
    assert mixed.joint_angles[1] == pytest.approx(rj.solve_lengths(plain, command[1], [ARM_FORCE]).joint_angles)


def test_friction_carries_the_springs_of_an_arm_along():
    arm = parallel_arm(5, friction=rj.CapstanFriction(0.1))
    start = rj.solve_tensions(arm, PULL, ARM_SPRINGS)
    step = rj.solve_tensions(arm, PULL, ARM_SPRINGS, history=start)
    assert step.ok and step.joint_angles == pytest.approx(start.joint_angles, abs=0.1)
    assert step.joint_angles != pytest.approx(rj.solve_tensions(arm, PULL).joint_angles, abs=0.01)


def test_a_torsion_spring_over_hinges_that_are_not_parallel_is_refused():
    with pytest.raises(InvalidInput, match="parallel joints"):
        rj.solve_tensions(rj.small_arm(4), [1.0] * 4, [TorsionSpring(2, 5.0)])
    assert rj.solve_tensions(rj.small_arm(4), [1.0] * 4, [TorsionSpring(2, 5.0, other=1)]).ok
    with pytest.raises(MechanismError, match="parallel joints"):
        rj.small_arm(4).replace(springs=[TorsionSpring(3, 5.0, other=1)])


def test_files_of_arms_keep_springs():
    springs = [TorsionSpring(4, 200.0, 0.2, 1), Spring(-1, 0.02, (10.0, 20.0, 80.0))]
    arm = parallel_arm(6, springs=springs, name="sprung")
    again = mechanism_from_dict(yaml.safe_load(dump_mechanism(arm)), "a file")
    assert again.springs == arm.springs and mechanism_to_dict(again) == mechanism_to_dict(arm)
    content = mechanism_to_dict(arm) | {"springs": [{"link": 1, "stiffness": 1.0, "anchor": [0.0, 1.0]}]}
    with pytest.raises(ConfigError, match="three numbers"):
        mechanism_from_dict(content, "a file")


def test_spatial_tables_may_leave_the_columns_of_torsion_springs_out():
    arm = rj.small_arm(4)
    tables = np.repeat(arm.load_table([WorldForce(-1, (0.1, 0.0, 0.0))])[None], 2, axis=0)
    command = np.repeat(arm.neutral_lengths[None], 2, axis=0)
    whole, short = (rj.solve_lengths_batch(arm, command, each) for each in (tables, tables[..., :-3].copy()))
    assert np.array_equal(whole.joint_angles, short.joint_angles)
    assert rj.load.SPATIAL_LOAD_COLUMNS[-3:] == LOAD_COLUMNS[-3:] == ("torsion", "rest", "other")
