"""The transmission of tensors is that of arrays."""

import inspect

import numpy as np
import pytest
import torch

from rollingjoint import transmission
from rollingjoint.compiled import motor_yield, standalone, unstretched_length
from rollingjoint.differentiable import formulas as of_tensors

NAMES = ["play_step", "sheath_direction", "sheath_ratio", "elastic_tension", "at_limit", "pull_limit", "pull_end"]


def numbers(function):
    """A row of numbers per argument: any, some alike, some zero or infinite; half widths are not negative."""
    rng = np.random.default_rng(0)
    rows = {name: rng.integers(-8, 9, 4000) / 4 for name in inspect.signature(function).parameters}
    for row in rows.values():
        row[::50], row[7::50] = rng.choice([np.inf, -np.inf], 80), rng.uniform(-2.0, 2.0, 80)
    if "half_width" in rows:
        rows["half_width"] = np.abs(rows["half_width"])
    return list(rows.values())


@pytest.mark.parametrize("name", NAMES)
def test_tensors_and_arrays_give_the_same_numbers(name):
    of_arrays = getattr(transmission, name)
    rows = numbers(of_arrays)
    found = getattr(of_tensors, name)(*map(torch.tensor, rows)).numpy()
    expected = of_arrays(*rows)
    known = ~(np.isnan(expected) | np.isnan(found))  # infinite less infinite stays NaN in torch
    assert known.mean() > 0.9 and found.dtype == expected.dtype
    if name in ("sheath_ratio", "pull_limit", "pull_end"):  # exponentials of libraries differ in the last bit
        np.testing.assert_allclose(found[known], expected[known], rtol=2e-15)
    else:
        assert np.array_equal(found[known], expected[known])


def test_what_follows_a_limit_is_that_of_kernels():
    rows = np.random.default_rng(1).uniform(1.0, 2.0, (3, 500))
    rows[2, ::2] -= rows[2, ::2].round(9)  # shifts of about what rounding leaves, and larger ones
    one_by_one = np.array([standalone(motor_yield)(*map(float, row)) for row in rows.T]).T
    assert np.array_equal(torch.stack(of_tensors.motor_yield(*torch.tensor(rows))).numpy(), one_by_one)
    lengths = [standalone(unstretched_length)(*map(float, row)) for row in rows.T]
    assert np.array_equal(of_tensors.unstretched_length(*torch.tensor(rows)).numpy(), lengths)
