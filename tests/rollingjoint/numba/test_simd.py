"""Lanes compute what NumPy computes, to the last bit; borrowed arrays are the arrays that they were borrowed from."""

import math
from fractions import Fraction

import numba
import numpy as np
import pytest

from rollingjoint._numba.borrowed import borrow
from rollingjoint._numba.jit import part, standalone
from rollingjoint._numba.simd import COLUMNS, WIDTH, any_lane, columns, fused, where
from rollingjoint._numba.views import aligned_simd, as_rows, as_simd, carve, integers, numbers, of_width, table_rows

SPECIAL = [0.0, -0.0, 1.0, np.nan, np.inf, -np.inf, 5e-324, 1e308]
compiled = numba.njit(error_model="numpy")


def operands():
    """Two arrays (rows, WIDTH): every pair of special numbers, and random ones of every size, some pairs equal."""
    rng = np.random.default_rng(0)
    pairs = np.array([(a, b) for a in SPECIAL for b in SPECIAL])
    drawn = rng.normal(size=(400, 2)) * 10.0 ** rng.integers(-8, 9, (400, 2))
    drawn[:40, 1] = drawn[:40, 0]
    return np.concatenate([pairs, drawn]).T.reshape(2, -1, WIDTH).copy()


A, B = operands()


def assert_bits(found, expected):
    """The same numbers, signs of zeros included; one NaN is as good as another."""
    assert np.array_equal(np.isnan(found), np.isnan(expected))
    known = ~np.isnan(expected)
    assert np.array_equal(found[known].view(np.int64), np.ascontiguousarray(expected[known]).view(np.int64))


@compiled
def arithmetic(a, b, out):
    x, y, result = as_simd(borrow(a)), as_simd(borrow(b)), as_simd(borrow(out))
    for i in range(a.shape[0]):
        result[0, i], result[1, i], result[2, i], result[3, i] = x[i] + y[i], x[i] - y[i], x[i] * y[i], x[i] / y[i]
        result[4, i], result[5, i], result[6, i], result[7, i] = x[i] + 0.1, 0.1 - x[i], 3 * x[i], 1.0 / x[i]
        result[8, i], result[9, i], result[10, i] = -x[i], abs(x[i]), math.sqrt(x[i])
        z = x[i]
        z += y[i]
        z -= 0.7
        z *= y[i]
        z /= 3.0
        result[11, i] = z
        result[12, i] = x[i] * y[i] + x[i]  # rounded twice, not fused
        result[13, i] = 0.25


def test_arithmetic_of_lanes_is_that_of_numpy():
    out = np.empty((14, *A.shape))
    arithmetic(A, B, out)
    with np.errstate(all="ignore"):
        both = [A + B, A - B, A * B, A / B, A + 0.1, 0.1 - A, 3 * A, 1.0 / A, -A, np.abs(A), np.sqrt(A)]
        both += [((A + B - 0.7) * B) / 3.0, A * B + A, np.full_like(A, 0.25)]
    for found, expected in zip(out, both, strict=True):
        assert_bits(found, expected)


@compiled
def comparisons(a, b, out):
    x, y, result = as_simd(borrow(a)), as_simd(borrow(b)), as_simd(borrow(out))
    for i in range(a.shape[0]):
        less, positive = x[i] < y[i], x[i] > 0.0
        result[0, i], result[1, i] = where(less, 1.0, 0.0), where(x[i] <= y[i], 1.0, 0.0)
        result[2, i], result[3, i] = where(x[i] > y[i], 1.0, 0.0), where(x[i] >= y[i], 1.0, 0.0)
        result[4, i], result[5, i] = where(x[i] == y[i], 1.0, 0.0), where(x[i] >= 1, 1.0, 0.0)
        result[6, i], result[7, i] = where(less & positive, 1.0, 0.0), where(less | positive, 1.0, 0.0)
        result[8, i], result[9, i] = where(~less, 1.0, 0.0), where(where(less, positive, ~positive), 1.0, 0.0)
        result[10, i], result[11, i], result[12, i] = (
            where(less, x[i], y[i]),
            where(less, 2.0, y[i]),
            where(less, x[i], 3),
        )


def test_comparisons_and_masks_of_lanes_are_those_of_numpy():
    out = np.empty((13, *A.shape))
    comparisons(A, B, out)
    less, positive = A < B, A > 0.0
    masks = [less, A <= B, A > B, A >= B, A == B, A >= 1, less & positive, less | positive, ~less]
    masks += [np.where(less, positive, ~positive)]
    chosen = [np.where(less, A, B), np.where(less, 2.0, B), np.where(less, A, 3.0)]
    for found, expected in zip(out, [*(mask.astype(float) for mask in masks), *chosen], strict=True):
        assert_bits(found, expected)


@compiled
def any_below(a, limit, out):
    x = as_simd(borrow(a))
    for i in range(a.shape[0]):
        out[i] = any_lane(x[i] < limit)


def test_any_lane_looks_at_every_lane():
    values = np.vstack([np.ones((1, WIDTH)), 1.0 - 2.0 * np.eye(WIDTH)])
    out = np.zeros(WIDTH + 1, np.bool_)
    any_below(values, 0.0, out)
    assert out.tolist() == [False] + [True] * WIDTH


@compiled
def of_one_number(x):
    return where(x < 1.0, x, 2.0), any_lane(x < 1.0)


def test_the_same_words_work_on_a_single_number():
    assert of_one_number(0.5) == (0.5, True)
    assert of_one_number(1.5) == (2.0, False)


@compiled
def transpose(values, out):
    memory, result = as_simd(borrow(values)), as_simd(borrow(out))
    eight = columns(as_rows(memory))
    result[0], result[1], result[2], result[3] = eight[0], eight[1], eight[2], eight[3]
    result[4], result[5], result[6], result[7] = eight[4], eight[5], eight[6], eight[7]


def test_columns_of_one_row_per_lane():
    rows, out = np.random.default_rng(1).normal(size=(WIDTH, COLUMNS)), np.empty((COLUMNS, WIDTH))
    transpose(rows.reshape(COLUMNS, WIDTH), out)
    assert np.array_equal(out, rows.T)


@compiled
def one_row(values, out):
    memory, result = borrow(values), numbers(borrow(out))
    eight = columns(as_rows(memory))
    for i in range(COLUMNS):
        result[i, 0] = 2.0 * eight[i]
    return result.shape[1]


def test_of_a_single_lane_the_columns_are_floats():
    row, out = np.random.default_rng(1).normal(size=COLUMNS), np.empty(COLUMNS)
    assert one_row(row, out) == 1
    assert np.array_equal(out, 2.0 * row)


@compiled
def multiply_add(a, b, c, out):
    x, z, result = table_rows(borrow(a)), table_rows(borrow(c)), table_rows(borrow(out))
    for i in range(a.shape[0]):
        result[i] = fused(x[i], b[i], z[i])


def test_fused_rounds_once():
    rng = np.random.default_rng(2)
    a, b = rng.normal(size=(50, COLUMNS)), rng.normal(size=50)
    c, out = -a * b[:, None] * (1 + 1e-15 * rng.normal(size=a.shape)), np.empty_like(a)
    multiply_add(a, b, c, out)
    exact = [
        [float(Fraction(x) * Fraction(y) + Fraction(z)) for x, z in zip(*rows, strict=True)]
        for y, *rows in zip(b, a, c, strict=True)
    ]
    assert np.array_equal(out, exact)
    assert np.any(out != a * b[:, None] + c)


@compiled
def copy_in_parts(values, whole, counts, out, shapes):
    cube, result, sizes = borrow(values), borrow(out), borrow(shapes)
    for i in range(cube.shape[0]):
        page, kept = cube[i], result[i]
        for j in range(page.shape[0]):
            line = page[j]
            for k in range(line.size):
                kept[j, k] = line[k] + cube[i, j, k] + page[j, k] + borrow(cube)[i][j][k]
    sizes[0], sizes[1], sizes[2] = cube.shape
    sizes[3], sizes[4] = cube[0].shape
    sizes[5] = cube[0, 1].size
    sizes[6] = borrow(counts)[1]
    sizes[7] = 1 if borrow(whole)[1] else 0


def test_borrowed_arrays_are_read_and_written_by_full_and_partial_indices():
    values = np.random.default_rng(3).normal(size=(2, 3, 4))
    out, shapes = np.empty_like(values), np.zeros(8, np.int64)
    copy_in_parts(values, np.array([False, True]), np.array([5, 6]), out, shapes)
    assert np.array_equal(out, values + values + values + values)
    assert shapes.tolist() == [2, 3, 4, 3, 4, 4, 6, 1]


@compiled
def fill_carved(memory):
    space = borrow(memory)
    n = memory.size // 4
    first, second, last = carve(space, 0, (n,)), carve(space, n, (2, n)), of_width(carve(space, 3 * n, (n // 2, 2)), 2)
    for i in range(n):
        first[i], second[0, i], second[1, i], last[i // 2, i % 2] = i, 100 + i, 200 + i, 300 + i
    return second.shape[0] * second.shape[1] + last.shape[1]


def test_carved_arrays_lie_one_after_the_other():
    memory = np.full(16, np.nan)
    assert fill_carved(memory) == 10
    assert memory.tolist() == [100 * block + i for block in range(4) for i in range(4)]


@compiled
def through_lanes(memory, out):
    wide = aligned_simd(borrow(memory))
    places = integers(carve(wide, 2, (1,)))
    for lane in range(WIDTH):
        numbers(wide)[0, lane], places[lane] = lane, 10 * lane
    wide[1] = wide[0] * 2.0
    for lane in range(WIDTH):
        out[0, lane], out[1, lane], out[2, lane] = numbers(wide)[0, lane], numbers(wide)[1, lane], places[lane]
    return wide.size


@pytest.mark.parametrize("shift", range(WIDTH))
def test_lanes_are_their_numbers_wherever_the_memory_begins(shift):
    memory, out = np.zeros(5 * WIDTH), np.zeros((3, WIDTH))
    assert through_lanes(memory[shift:], out) in (3, 4, 5)
    assert out.tolist() == [[factor * lane for lane in range(WIDTH)] for factor in (1, 2, 10)]


def test_a_part_belongs_to_kernels_and_says_so():
    @part
    def doubled(x):
        return 2.0 * x

    @compiled
    def quadrupled(x):
        return doubled(doubled(x))

    with pytest.raises(TypeError, match="doubled is a part of kernels"):
        doubled(1.0)
    assert quadrupled(1.5) == 6.0
    assert standalone(doubled)(1.5) == 3.0
