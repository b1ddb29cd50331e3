"""Pinned NamedTuples reach kernels as they are; other layouts are refused before anything is read."""

import gc
import weakref
from typing import Annotated, NamedTuple

import numpy as np
import pytest

from rollingjoint._numba.borrowed import borrow
from rollingjoint._numba.jit import entry_address, kernel, machine_code
from rollingjoint._numba.layout import Floats, Integers, Singles, layout_hash, leaves
from rollingjoint._numba.pins import Pinned, WrongLayout, call_range, carve_tuple, size_of, unpin
from rollingjoint.errors import InvalidInput


class Inner(NamedTuple):
    """Arrays of one or many rows."""

    values: Annotated[Floats, "m", 3]
    counts: Annotated[Integers, "m"]


class Outer(NamedTuple):
    """Numbers and arrays of every kind."""

    scale: float
    offset: int
    doubled: bool
    small: Annotated[Singles, "B"]
    inner: Annotated[Inner, "B"]


class Renamed(NamedTuple):
    """Outer with another name of one field."""

    factor: float
    offset: int
    doubled: bool
    small: Annotated[Singles, "B"]
    inner: Annotated[Inner, "B"]


class Sizes(NamedTuple):
    """Lengths of the axes of an Inner."""

    m: int


@kernel
def scale_pinned(pins):
    task = unpin(pins, Outer)
    values, counts = task.inner
    for row in range(values.shape[0]):
        for j in range(values.shape[1]):
            for k in range(values.shape[2]):
                values[row, j, k] *= task.scale * counts[row, j]
        task.small[row] += task.offset + (100 if task.doubled else 0)


@kernel
def count_rows(pins, first, last):
    return unpin(pins, Outer).small.size + last - first


@kernel
def call_count_rows(entry, pins):
    return call_range(entry, pins, Outer, 3, 5)


@kernel
def call_with_another_layout(entry, pins):
    return call_range(entry, pins, Renamed, 3, 5)


def outer(rows=2, doubled=True):
    inner = Inner(np.ones((rows, 4, 3)), np.arange(4 * rows).reshape(rows, 4))
    return Outer(0.5, 7, doubled, np.zeros(rows, np.float32), inner)


def test_pinned_arrays_and_numbers_are_found_by_their_address():
    task = outer()
    scale_pinned(Pinned(task).address_for(Outer))
    assert np.array_equal(task.inner.values[..., 0], 0.5 * task.inner.counts)
    assert task.small.tolist() == [107.0, 107.0]
    other = outer(doubled=False)
    scale_pinned(Pinned(other).address)
    assert other.small.tolist() == [7.0, 7.0]


def test_pins_keep_their_arrays_alive():
    task = outer()
    seen = weakref.ref(task.inner.values)
    pinned = Pinned(task)
    del task
    gc.collect()
    assert seen() is not None
    scale_pinned(pinned.address)
    assert seen()[1, 3, 2] == 3.5
    del pinned
    gc.collect()
    assert seen() is None


def test_pins_of_another_layout_are_refused():
    pinned = Pinned(Renamed(*outer()))
    with pytest.raises(InvalidInput, match="Renamed"):
        pinned.address_for(Outer)
    with pytest.raises(WrongLayout, match="pins of another layout than Outer"):
        scale_pinned(pinned.address)
    with pytest.raises(WrongLayout):
        scale_pinned(0)


def test_a_kernel_that_is_called_by_another_one_refuses_pins_of_another_layout():
    entry, mine = entry_address(count_rows, int, int, int), Pinned(outer())
    assert call_count_rows(entry, mine.address) == 4
    with pytest.raises(WrongLayout, match="Outer"):
        call_count_rows(entry, Pinned(Renamed(*outer())).address)
    with pytest.raises(WrongLayout, match="Renamed"):
        call_with_another_layout(entry, mine.address)


@pytest.mark.parametrize(
    ("spoil", "message"),
    [
        (lambda task: task._replace(small=np.zeros(2)), "Outer.small"),
        (lambda task: task._replace(small=np.zeros(3, np.float32)), "Outer.inner.values, axis B"),
        (lambda task: task._replace(small=[0.0, 0.0]), "Outer.small"),
        (lambda task: task._replace(inner=task.inner._replace(values=np.ones((2, 4, 2)))), "inner.values, axis 3"),
        (lambda task: task._replace(inner=task.inner._replace(values=np.ones((4, 3)))), "inner.values"),
        (lambda task: task._replace(inner=task.inner._replace(values=np.ones((2, 4, 6))[..., ::2])), "contiguous"),
        (lambda task: task._replace(inner=task.inner._replace(counts=np.ones((2, 5), int))), "inner.counts, axis m"),
    ],
)
def test_arrays_that_are_not_as_declared_are_refused_by_name(spoil, message):
    with pytest.raises(InvalidInput, match=message):
        Pinned(spoil(outer()))


def test_a_layout_is_its_names_types_and_axes():
    assert [leaf.path for leaf in leaves(Outer)] == [
        "Outer.scale",
        "Outer.offset",
        "Outer.doubled",
        "Outer.small",
        "Outer.inner.values",
        "Outer.inner.counts",
    ]
    assert leaves(Outer)[4].axes == ("B", "m", 3)
    assert layout_hash(Outer) != layout_hash(Renamed)


@kernel
def sum_of_borrowed(task, alone):
    borrowed = borrow(task)
    total = 0.0
    for row in range(borrowed.small.size):
        for j in range(borrowed.inner.counts.shape[1]):
            total += borrowed.scale * borrowed.inner.values[row, j, 2] * borrow(alone)[row]
    return total


def test_a_nested_tuple_is_borrowed_whole():
    assert sum_of_borrowed(outer(3), np.array([1.0, 2.0, 4.0])) == 0.5 * 4 * 7.0


@kernel
def carve_inner(memory, m):
    sizes = Sizes(m)
    inner = carve_tuple(borrow(memory), 1, Inner, sizes)
    for j in range(m):
        inner.counts[j] = 10.0 * j
        for k in range(3):
            inner.values[j, k] = j + 0.1 * k
    return size_of(Inner, sizes)


def test_a_tuple_is_carved_field_by_field():
    memory = np.full(10, -1.0)
    assert carve_inner(memory, 2) == 8
    assert memory.tolist() == [-1.0, 0.0, 0.1, 0.2, 1.0, 1.1, 1.2, 0.0, 10.0, -1.0]


@kernel
def total(values):
    result = 0.0
    for i in range(len(values)):
        result += values[i]
    return result


def test_machine_code_is_that_of_the_types_of_its_arguments():
    floats, singles, counts = np.ones(3), np.ones(3, np.float32), np.arange(3)
    assert [machine_code(total, one)(one) for one in (floats, singles, counts)] == [3.0, 3.0, 3.0]
    assert machine_code(total, floats) is not machine_code(total, singles)
    assert machine_code(total, Annotated[Floats, "n"])(floats) == 3.0
    assert len(total.signatures) == 3


def test_the_address_of_machine_code_is_that_of_the_types_of_its_arguments():
    assert entry_address(total, np.ones(3)) != entry_address(total, np.ones(3, np.float32))
    assert entry_address(total, np.ones(3)) == entry_address(total, Annotated[Floats, "n"])
