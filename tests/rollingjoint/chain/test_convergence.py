"""Random mechanisms: every result is converged with a small residual, or says truthfully that it is not."""

import importlib.util
from pathlib import Path

import numpy as np
import pytest

from rollingjoint import Equilibrium, Status

spec = importlib.util.spec_from_file_location(
    "convergence", Path(__file__).resolve().parents[3] / "benchmarks" / "convergence.py"
)
convergence = importlib.util.module_from_spec(spec)
spec.loader.exec_module(convergence)


def is_truthful(result: Equilibrium) -> bool:
    """The status says what the numbers show."""
    finite = np.all(np.isfinite(result.poses)) and np.all(np.isfinite(result.contact_forces))
    if not finite or np.any(result.tensions < 0):
        return False
    match result.status:
        case Status.CONVERGED:
            return result.residual < 1e-8 and result.free_joints.all() and result.smallest_eigenvalue > 0
        case Status.AT_LIMIT:
            return result.residual < 1e-8 and not result.free_joints.all() and result.smallest_eigenvalue > 0
        case Status.INDETERMINATE:
            return result.residual < 1e-8 and abs(result.smallest_eigenvalue) < 1e-3
        case Status.UNSTABLE:
            return result.residual < 1e-8 and result.smallest_eigenvalue < 0
        case Status.NOT_CONVERGED:
            return result.residual > 1e-9
    return False


def check(seed: int, n_mechanisms: int) -> None:
    conservative = failed = followers = 0
    for given, load, start, result in convergence.cases(seed, n_mechanisms):
        assert is_truthful(result), f"{given}, {load}, {start}: {result.status.name}, residual {result.residual}"
        if load == "follower":
            followers += 1
            failed += result.status >= Status.UNSTABLE
        else:
            conservative += 1
            assert result.status <= Status.INDETERMINATE, f"{given}, {load}, {start}: {result.status.name}"
    assert conservative > 10 * n_mechanisms
    assert failed <= 0.05 * followers  # under a large follower force and little tension there may be no equilibrium


@pytest.mark.slow
def test_random_mechanisms_converge_or_say_why_not():
    check(seed=100, n_mechanisms=60)


@pytest.mark.slow(minutes=2)
def test_twenty_thousand_solves_converge_or_say_why_not():
    check(seed=0, n_mechanisms=1250)


def test_the_report_counts_every_solve():
    text = convergence.table(convergence.cases(seed=1, n_mechanisms=3))
    assert "48 solves" in text and "| lengths | none | cold |" in text
