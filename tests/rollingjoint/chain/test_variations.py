"""Variations of a chain, whose arrays are filled all at once, are the chains that are built one by one."""

import pickle

import numpy as np
import pytest

from rollingjoint import (
    CapstanFriction,
    InvalidInput,
    WorldForce,
    solve_lengths_batch,
    solve_tensions,
    solve_tensions_batch,
)
from rollingjoint.chain import variations as variations_module
from rollingjoint.chain.presets import five_link, two_segment
from rollingjoint.chain.stacks import stack
from rollingjoint.chain.variations import ChainVariations, varied_chain


def drawn(nominal, count, mm, rad, spread, seed=0):
    rng = np.random.default_rng(seed)
    offsets = rng.uniform(-1, 1, (count, nominal.n_links, 2, 3)) * np.array([mm, mm, rad])
    return offsets, 1 + spread * rng.uniform(-1, 1, (count, nominal.n_tendons))


@pytest.mark.parametrize("nominal", [five_link(), two_segment()], ids=["five_link", "two_segment"])
@pytest.mark.parametrize(("mm", "rad"), [(0.1, 0.01), (2.0, 0.2)])
def test_arrays_of_variations_are_those_of_chains_built_one_by_one(nominal, mm, rad):
    offsets, factors = drawn(nominal, 6, mm, rad, 0.2)
    chains = [varied_chain(nominal, *each) for each in zip(offsets, factors, strict=True)]
    variations, expected = ChainVariations(nominal, offsets, factors), stack(chains)
    for name in expected._fields:
        assert np.allclose(getattr(variations.arrays, name), getattr(expected, name), rtol=0, atol=1e-12), name
    assert np.allclose(variations.neutral_angles, [chain.neutral_angles for chain in chains], rtol=0, atol=1e-14)
    assert np.array_equal(variations.stiffnesses, [chain.stiffnesses for chain in chains])
    surfaces = [(link.parent.start, link.child.angle) for chain in (variations[3], chains[3]) for link in chain.links]
    assert surfaces[: nominal.n_links] == surfaces[nominal.n_links :] and len(variations) == 6


def test_without_displacements_all_variations_share_the_arrays_of_the_chain():
    nominal = five_link()
    offsets, factors = drawn(nominal, 3, 0.0, 0.0, 0.3)
    variations = ChainVariations(nominal, offsets, factors)
    assert variations.arrays is nominal.arrays and not variations.designs.any()
    assert np.allclose(variations[1].stiffnesses, nominal.stiffnesses * factors[1])


@pytest.mark.parametrize("mm", [0.0, 0.5])
def test_taken_variations_are_those_of_the_other_and_the_rest_stays(mm):
    nominal = five_link()
    first, second = (ChainVariations(nominal, *drawn(nominal, 5, mm, 0.1 * mm, 0.2, seed)) for seed in (1, 2))
    kept, came = [first[place].stiffnesses for place in (0, 2)], [second[place] for place in (2, 0)]
    assert first.take(np.array([1, 4]), second, np.array([2, 0]))
    assert np.array_equal([first[0].stiffnesses, first[2].stiffnesses], kept)
    for row, chain in zip((1, 4), came, strict=True):
        assert first[row] is chain and np.array_equal(first.stiffnesses[row], chain.stiffnesses)
        assert np.array_equal(first.neutral_angles[row], chain.neutral_angles)
    if mm:
        expected, joints = stack([first[place] for place in range(5)]), first.arrays.joints
        assert np.allclose(joints, expected.joints) and np.allclose(first.arrays.coefficients, expected.coefficients)
    other = ChainVariations(nominal, *drawn(nominal, 5, 0.3 - 0.3 * bool(mm), 0.0, 0.2))
    assert not first.take(np.array([0]), other, np.array([0]))


@pytest.mark.parametrize("mm", [0.0, 0.3])
def test_batches_take_variations_without_building_a_chain(mm, monkeypatch):
    nominal = five_link().replace(friction=CapstanFriction(0.1, 0.05))
    variations = ChainVariations(nominal, *drawn(nominal, 5, mm, 0.1 * mm, 0.2))
    chains = list(ChainVariations(nominal, *drawn(nominal, 5, mm, 0.1 * mm, 0.2)))
    lengths = nominal.neutral_lengths - np.random.default_rng(1).uniform(0.0, 3.0, (5, 2))
    loads = [WorldForce(-1, (0.2, 0.0))]
    expected = solve_lengths_batch(chains, lengths, loads)
    stepped = solve_lengths_batch(chains, lengths - 0.5, loads, history=expected.friction_state)
    with monkeypatch.context() as patched:
        patched.setattr(variations_module, "varied_chain", None)
        result = solve_lengths_batch(variations, lengths, loads)
        tight = solve_tensions_batch(variations, np.ones((5, 2)), loads)
    assert result.ok.all() and tight.ok.all()
    again = solve_lengths_batch(variations, lengths - 0.5, loads, history=expected.friction_state)
    for mine, theirs in ((result, expected), (again, stepped)):
        assert np.allclose(mine.poses, theirs.poses, rtol=0, atol=1e-9)
        assert np.allclose(mine.tensions, theirs.tensions, rtol=0, atol=1e-7)
    with pytest.raises(InvalidInput, match="one per row"):
        solve_lengths_batch(variations, lengths[:4])


def test_an_equilibrium_of_variations_keeps_the_mechanisms_that_were_solved():
    nominal = five_link()
    first, second = (ChainVariations(nominal, *drawn(nominal, 3, 0.3, 0.03, 0.2, seed)) for seed in (1, 2))
    solved = solve_tensions_batch(first, np.ones((3, 2)))
    stiffnesses = np.array(first.stiffnesses)
    assert first.take(np.arange(3), second, np.arange(3))
    assert np.array_equal([chain.stiffnesses for chain in solved.mechanism], stiffnesses)
    row = solved.row(-1)
    assert row.mechanism is solved.mechanism[2] and len(solved.mechanism[1:]) == 2
    alone = solve_tensions(row.mechanism, (1, 1))
    assert np.allclose(row.arc_lengths, alone.arc_lengths, rtol=0, atol=1e-8)
    kept = pickle.loads(pickle.dumps(solved))
    assert np.array_equal([chain.stiffnesses for chain in kept.mechanism], stiffnesses)


def test_mechanisms_that_are_built_when_asked_for_are_a_tuple_of_them():
    offsets, factors = drawn(five_link(), 3, 0.1, 0.01, 0.2)
    first, second = (ChainVariations(five_link(), offsets, factors).members() for _ in range(2))
    built = tuple(first)
    assert first[1] in first and second[1] not in first and None not in first
    assert first == built and built == first and hash(first) == hash(built) and first != second
    assert repr(first) == repr(built)
