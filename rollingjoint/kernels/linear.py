"""Small dense linear algebra on the free joints of a chain."""

from __future__ import annotations

import math

import numpy as np

from rollingjoint._numba.jit import part


@part
def largest(H, free):
    """Largest |H| over the free rows and columns."""
    value = 0.0
    for i in range(free.size):
        if free[i]:
            for m in range(free.size):
                if free[m]:
                    value = max(value, abs(H[i, m]))
    return value


@part
def cholesky(H, free, shift, L):
    """Lower factor of the symmetric part of H + shift I on the free joints into L.

    Returns the smallest pivot over the largest |H|, or -1.
    """
    n = free.size
    floor = 1e-13 * (largest(H, free) + shift)
    smallest = math.inf
    for i in range(n):
        if not free[i]:
            continue
        for m in range(i + 1):
            if not free[m]:
                continue
            value = 0.5 * (H[i, m] + H[m, i]) if m < i else H[i, i] + shift
            for k in range(m):
                if free[k]:
                    value -= L[i, k] * L[m, k]
            if m < i:
                L[i, m] = value / L[m, m]
            else:
                if not value > floor:
                    return -1.0
                smallest = min(smallest, value)
                L[i, i] = math.sqrt(value)
    return smallest * 1e-13 / floor if floor > 0.0 else 1.0


@part
def cholesky_solve(L, free, residual, out):
    """Solve L Lᵀ out = -r on the free joints; zero elsewhere."""
    n = free.size
    for i in range(n):
        out[i] = 0.0
        if free[i]:
            value = -residual[i]
            for k in range(i):
                if free[k]:
                    value -= L[i, k] * out[k]
            out[i] = value / L[i, i]
    for i in range(n - 1, -1, -1):
        if free[i]:
            value = out[i]
            for k in range(i + 1, n):
                if free[k]:
                    value -= L[k, i] * out[k]
            out[i] = value / L[i, i]


@part
def indices(free):
    """Indices of the free joints."""
    count = 0
    for i in range(free.size):
        count += free[i]
    index = np.empty(count, np.int64)
    count = 0
    for i in range(free.size):
        if free[i]:
            index[count] = i
            count += 1
    return index


@part
def is_finite(H, free):
    """True if H has neither NaN nor infinity in the free rows and columns: LAPACK's wrappers raise on them."""
    for i in range(free.size):
        for m in range(free.size):
            if free[i] and free[m] and not abs(H[i, m]) < math.inf:
                return False
    return True


@part
def smallest_real_part(H, free):
    """Smallest real part of the eigenvalues of H over the free joints; -inf where H is not finite."""
    if not is_finite(H, free):
        return -math.inf
    index = indices(free)
    reduced = np.empty((index.size, index.size), np.complex128)
    for i in range(index.size):
        for m in range(index.size):
            reduced[i, m] = H[index[i], index[m]]
    smallest = math.inf
    for value in np.linalg.eigvals(reduced):
        smallest = min(smallest, value.real)
    return smallest


@part
def eigen(H, free):
    """(indices, eigenvalues, eigenvectors) of a symmetric H over the free joints; of the identity if not finite."""
    index, finite = indices(free), is_finite(H, free)
    reduced = np.eye(index.size)
    for i in range(index.size if finite else 0):
        for m in range(index.size):
            reduced[i, m] = H[index[i], index[m]]
    values, vectors = np.linalg.eigh(reduced)
    return index, values, vectors


@part
def descent_step(H, free, residual, L, out):
    """Newton step H out = -r on the free joints where H is positive definite, else with |eigenvalues| in its place.

    Reversing negative eigenvalues keeps the step's length right along soft directions, where a common shift would be
    set by the stiffest one.
    """
    if cholesky(H, free, 0.0, L) > 1e-10:
        cholesky_solve(L, free, residual, out)
        return
    index, values, vectors = eigen(H, free)
    floor = 1e-300
    for value in values:
        floor = max(floor, 1e-10 * abs(value))
    for i in range(out.size):
        out[i] = 0.0
    for q in range(index.size):
        along = 0.0
        for i in range(index.size):
            along -= vectors[i, q] * residual[index[i]]
        along /= max(abs(values[q]), floor)
        for i in range(index.size):
            out[index[i]] += along * vectors[i, q]


@part
def damped_step(H, free, residual, damping, L, out):
    """Levenberg-Marquardt step for an unsymmetric H: (HᵀH + damping I) out = -Hᵀ r on the free joints."""
    n = free.size
    normal = np.zeros((n, n))
    rhs = np.zeros(n)
    for i in range(n):
        if not free[i]:
            continue
        for k in range(n):
            if free[k]:
                rhs[i] += H[k, i] * residual[k]
                for m in range(n):
                    if free[m]:
                        normal[i, m] += H[k, i] * H[k, m]
    size = largest(normal, free)
    while cholesky(normal, free, damping * size, L) < 0.0:
        damping = max(10.0 * damping, 1e-14)
        if damping > 1e3:
            for i in range(n):
                out[i] = 0.0
            return
    cholesky_solve(L, free, rhs, out)


@part
def lu_step(H, free, residual, out):
    """Newton step H out = -r on the free joints by elimination with pivoting; False when H is singular."""
    n = free.size
    index = indices(free)
    count = index.size
    A = np.empty((count, count + 1))
    for i in range(count):
        for m in range(count):
            A[i, m] = H[index[i], index[m]]
        A[i, count] = -residual[index[i]]
    if not eliminate(A, 1e-13 * largest(H, free)):
        return False
    for i in range(n):
        out[i] = 0.0
    for i in range(count):
        out[index[i]] = A[i, count]
    return True


@part
def eliminate(A, floor):
    """Solve n equations in place by elimination with pivoting, (n, n + k): the last k columns become the solutions.

    False where a pivot is not above the floor.
    """
    n, columns = A.shape
    for p in range(n):
        best = p
        for i in range(p + 1, n):
            if abs(A[i, p]) > abs(A[best, p]):
                best = i
        if not abs(A[best, p]) > floor:
            return False
        if best != p:
            for m in range(p, columns):
                A[p, m], A[best, m] = A[best, m], A[p, m]
        for i in range(p + 1, n):
            factor = A[i, p] / A[p, p]
            for m in range(p, columns):
                A[i, m] -= factor * A[p, m]
    for i in range(n - 1, -1, -1):
        for c in range(n, columns):
            value = A[i, c]
            for m in range(i + 1, n):
                value -= A[i, m] * A[m, c]
            A[i, c] = value / A[i, i]
    return True


@part
def downhill_step(A, free, residual, L, out):
    """Newton step A out = -r on the free joints by elimination without exchange of rows; L: memory for the factors.

    False where a pivot is not positive, as it is where the symmetric part of A is positive definite, or where the step
    does not descend: out . r >= 0.
    """
    n = free.size
    floor = 1e-10 * largest(A, free)
    for i in range(n):
        out[i] = 0.0
        if not free[i]:
            continue
        value = -residual[i]
        for m in range(n):
            L[i, m] = A[i, m]
        for k in range(i):
            if free[k]:
                L[i, k] /= L[k, k]
                value -= L[i, k] * out[k]
                for m in range(k + 1, n):
                    L[i, m] -= L[i, k] * L[k, m]
        if not L[i, i] > floor:
            return False
        out[i] = value
    slope = 0.0
    for i in range(n - 1, -1, -1):
        if free[i]:
            value = out[i]
            for m in range(i + 1, n):
                value -= L[i, m] * out[m]
            out[i] = value / L[i, i]
            slope += out[i] * residual[i]
    return slope < 0.0
