"""State files keep plain values, arrays and tensors as they are, and nothing that could run."""

import json
import math
import random
from collections import deque

import numpy as np
import pytest
import safetensors.numpy
import torch

from agents.runs.state_file import StateError, packed, unpacked

VALUES = {
    "numbers": [1, -(2**120), 2.5, math.inf, True, None, "text", np.float32(1.5), np.int64(3), np.bool_(True)],
    "python's generator": random.Random(1).getstate(),
    "numpy's generator": np.random.RandomState(1).get_state(),
    "torch's generator": torch.Generator().get_state(),
    "nested": {"a": [(1, [2]), {}], 3: deque([1.0, 2.0], maxlen=3)},
    "arrays": [np.zeros((0, 3)), np.arange(6.0).reshape(2, 3).T, np.ones((), bool), np.arange(3, dtype=np.uint32)],
    "tensors": [torch.zeros(2, 3), torch.tensor(1, dtype=torch.int64), torch.nn.Parameter(torch.ones(2))],
}


def alike(first, second):
    """The same values of the same types; parameters become tensors."""
    if isinstance(first, torch.Tensor):
        return first.dtype == second.dtype and torch.equal(first.detach(), second)
    if isinstance(first, np.ndarray):
        return first.dtype == second.dtype and first.shape == second.shape and np.array_equal(first, second)
    if isinstance(first, dict):
        return list(first) == list(second) and all(alike(first[key], second[key]) for key in first)
    if isinstance(first, list | tuple | deque):
        kept = getattr(first, "maxlen", None) == getattr(second, "maxlen", None)
        return kept and len(first) == len(second) and all(map(alike, first, second))
    return type(first) is type(second) and first == second


@pytest.mark.parametrize("values", VALUES.values(), ids=VALUES)
def test_values_come_back_as_they_were(values):
    read = unpacked(packed(values), "state")
    assert type(read) is type(values) and alike(values, read)


def test_arrays_that_were_read_can_be_written_to():
    (array,) = unpacked(packed([np.zeros(2)]), "state")
    array += 1


@pytest.mark.parametrize("value", [object(), print, np.array([object()]), {1.5: 0}, {"a": [np.datetime64("now")]}])
def test_a_value_of_another_kind_is_named(value):
    with pytest.raises(StateError, match="state") as refused:
        packed(value)
    assert "\n" not in str(refused.value)


def described(node):
    return safetensors.numpy.save({"0": np.zeros(2)}, {"state": json.dumps(node)})


FOREIGN = {
    "nothing": b"",
    "a pickle": b"cos\nsystem\n(S'true'\ntR.",
    "no state": safetensors.numpy.save({"0": np.zeros(2)}),
    "a class": described({"object": "os.system", "state": []}),
    "no array of that name": described({"array": "7"}),
    "deep": safetensors.numpy.save({}, {"state": '{"list":[' * 100_000 + "]}" * 100_000}),
    "an empty node": described({}),
}


@pytest.mark.parametrize("data", FOREIGN.values(), ids=FOREIGN)
def test_foreign_bytes_are_refused_in_one_line(data):
    with pytest.raises(StateError, match=r"x\.safetensors") as refused:
        unpacked(data, "x.safetensors")
    assert "\n" not in str(refused.value)
