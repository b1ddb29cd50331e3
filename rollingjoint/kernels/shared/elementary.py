"""Elementary functions of numbers and of SIMD lanes alike, made of arithmetic alone: lanes round as floats do."""

from __future__ import annotations

import math

from rollingjoint._numba.jit import part
from rollingjoint._numba.simd import where

_C = tuple(1.0 / math.factorial(k + 1) for k in range(12))
_SPLIT = 0.66  # of the tangent: above it the angle is taken from pi/4

# atan(x) = x + x z P(z) / Q(z), z = x², |x| <= 0.66, relative error 2e-16. Source: S. L. Moshier, Cephes, atan.c
_P = (
    -8.750608600031904122785e-1,
    -1.615753718733365076637e1,
    -7.500855792314704667340e1,
    -1.228866684490136173410e2,
    -6.485021904942025371773e1,
)
_Q = (
    2.485846490142306297962e1,
    1.650270098316988542046e2,
    4.328810604912902668951e2,
    4.853903996359136964868e2,
    1.945506571482613964425e2,
)


@part(inline=True)
def decay(x):
    """(exp(-x), (1 - exp(-x)) / x), the second with its limit 1 at x = 0; |x| up to 1: 1e-15, up to 3: 1e-11.

    The power series of the second at y = x/4, whose argument is doubled twice by (1 - e^-2y) = (1 - e^-y)(1 + e^-y).
    """
    y = 0.25 * x
    y2 = y * y
    y4 = y2 * y2
    low = (1.0 - _C[1] * y) + (_C[2] - _C[3] * y) * y2
    middle = (_C[4] - _C[5] * y) + (_C[6] - _C[7] * y) * y2
    high = (_C[8] - _C[9] * y) + (_C[10] - _C[11] * y) * y2
    mean = low + (middle + high * y4) * y4
    once = 1.0 - y * mean
    twice = once * once
    return twice * twice, mean * (0.5 + 0.5 * once) * (0.5 + 0.5 * twice)


@part(inline=True)
def _fraction(sine, cosine):
    """(over, under, whether the angle is taken from pi/4) of the tangent or cotangent of an angle, at most 0.66."""
    size = abs(cosine)
    over, under = where(sine < size, sine, size), where(sine < size, size, sine)
    far = over > _SPLIT * under
    return where(far, over - under, over), where(far, over + under, under), far


@part(inline=True)
def _arc(x, over_q, far, sine, cosine):
    """The angle from its reduced tangent x and 1 / Q(x²)."""
    z = x * x
    p = (((_P[0] * z + _P[1]) * z + _P[2]) * z + _P[3]) * z + _P[4]
    angle = where(far, 0.25 * math.pi, 0.0) + (x + x * z * p * over_q)
    angle = where(sine < abs(cosine), angle, 0.5 * math.pi - angle)
    return where(cosine < 0.0, math.pi - angle, angle)


@part(inline=True)
def _bottom(z):
    return ((((z + _Q[0]) * z + _Q[1]) * z + _Q[2]) * z + _Q[3]) * z + _Q[4]


@part(inline=True)
def angle_of(sine, cosine):
    """The angle, 0 to pi, of a vector with these components (of any length, not both zero, sine not negative)."""
    over, under, far = _fraction(sine, cosine)
    x = over / under
    return _arc(x, 1.0 / _bottom(x * x), far, sine, cosine)


@part(inline=True)
def two_angles(sine, cosine, other_sine, other_cosine, length):
    """Two angles, 0 to pi, from their unit vectors (sines not negative), and 1 / length: two divisions for all five."""
    over, under, far = _fraction(sine, cosine)
    other_over, other_under, other_far = _fraction(other_sine, other_cosine)
    both = under * other_under
    per_all = 1.0 / (both * length)
    per_length, per_both = both * per_all, length * per_all
    x, y = over * other_under * per_both, other_over * under * per_both
    q, other_q = _bottom(x * x), _bottom(y * y)
    per_q = 1.0 / (q * other_q)
    angle = _arc(x, other_q * per_q, far, sine, cosine)
    return angle, _arc(y, q * per_q, other_far, other_sine, other_cosine), per_length
