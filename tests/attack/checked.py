"""Solvers and environments with every index of compiled code checked, and under malloc's checks at once."""

from tests.attack.edges import MALLOC, checked


def attack(rng, report):
    """One short attack in that mode; the kernels of the mode are compiled where they are not kept yet."""
    variables = MALLOC | {"ROLLINGJOINT_CHECK_BOUNDS": "1"}
    checked(report, "index checks", variables, int(rng.integers(1000)))
