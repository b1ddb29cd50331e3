"""Pickles of earlier revisions, which name classes in modules that have moved, go on loading."""

import gzip
import importlib
import pickle
from pathlib import Path

import numpy as np
import pytest

from rollingjoint import (
    CapstanFriction,
    Equilibrium,
    HingeChain,
    HingeEquilibrium,
    RollingChain,
    Status,
    small_arm,
    solve_lengths,
    uniform,
)
from rollingjoint.chain.variations import ChainVariations
from rollingjoint.statics.problem import Problem

# gzip.compress(pickle.dumps(objects, protocol=4)) of revision cf8595c. `objects` are by name: uniform(3) named "old
# chain" and small_arm(2) named "old arm"; their solves for CHAIN and ARM less than at rest, a batch of the chain's and
# of half a millimetre more, and steps to there from rest under CapstanFriction(0.1); prepare(chain) and prepare(arm,
# given="tensions"); ChainVariations without offsets, with factors ((1, 1), (1.1, 0.9)).
PICKLES = Path(__file__).parent / "former_pickles.gz"
CHAIN, ARM = np.array([1.0, 0.0]), np.array([2.0, 0.0, 0.0, 0.0])
KINDS = {
    "chain": RollingChain,
    "arm": HingeChain,
    "equilibrium": Equilibrium,
    "hinge_equilibrium": HingeEquilibrium,
    "batch": Equilibrium,
    "step": Equilibrium,
    "hinge_step": HingeEquilibrium,
    "problem": Problem,
    "hinge_problem": Problem,
    "variations": ChainVariations,
}


@pytest.fixture(scope="module")
def old():
    return pickle.loads(gzip.decompress(PICKLES.read_bytes()))


def test_their_classes_are_those_of_today(old):
    assert {name: type(value) for name, value in old.items()} == KINDS


def test_mechanisms_in_them_solve_as_new_ones(old):
    for given, change, new in ((old["chain"], CHAIN, uniform(3)), (old["arm"], ARM, small_arm(2))):
        found, expected = (solve_lengths(each, new.neutral_lengths - change) for each in (given, new))
        assert found.poses == pytest.approx(expected.poses, abs=1e-9)  # its tables are of another processor
        assert found.status == Status.CONVERGED
    assert old["problem"].solve(uniform(3).neutral_lengths - CHAIN).ok


def test_equilibria_in_them_have_all_properties(old):
    for name, change in (("equilibrium", CHAIN), ("hinge_equilibrium", ARM)):
        found = old[name]
        fresh = solve_lengths(found.mechanism, found.mechanism.neutral_lengths - change)
        for field in ("poses", "stiffness", "tip", "pose_jacobian", "free_joints"):
            np.testing.assert_allclose(getattr(found, field), getattr(fresh, field), rtol=1e-9, atol=1e-9)
    assert old["batch"].row(1).ok and old["batch"].stiffness.shape == (2, 2, 2)


def test_steps_in_them_are_histories_of_new_steps(old):
    for name, change in (("step", CHAIN), ("hinge_step", ARM)):
        step = old[name]
        assert step.mechanism.friction == CapstanFriction(0.1)
        assert solve_lengths(step.mechanism, step.mechanism.neutral_lengths - 2 * change, history=step).ok


def test_variations_in_them_build_their_members(old):
    np.testing.assert_allclose(old["variations"][1].stiffnesses, old["chain"].stiffnesses * [1.1, 0.9])


def test_new_pickles_name_the_modules_of_today(old):
    text = pickle.dumps(old, protocol=0).decode("latin-1")
    assert "rollingjoint.chain.rolling" in text and "rollingjoint.chain.hinge" in text
    assert not any(f"c{module}\n" in text for module in FORMER)


FORMER = ("rollingjoint.mechanism", "rollingjoint.planar.chain", "rollingjoint.spatial.chain", "rollingjoint.solution")


@pytest.mark.slow
@pytest.mark.parametrize("module", FORMER)
def test_a_former_module_is_found_by_a_program_that_has_imported_nothing(module, run_python):
    assert importlib.import_module(module).__name__.startswith("rollingjoint.chain.")
    run_python("-c", f"import {module}")


@pytest.mark.slow
def test_pickles_load_in_a_program_that_has_imported_nothing(run_python):
    code = f"import gzip, pickle; print(*pickle.loads(gzip.decompress(open({str(PICKLES)!r}, 'rb').read())))"
    assert run_python("-c", code).split() == list(KINDS)
