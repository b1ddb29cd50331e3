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

# sin and cos up to pi/4, and pi/2 in two parts, the first of 33 bits. Source: fdlibm, k_sin.c, k_cos.c, e_rem_pio2.c
_SIN = (
    -1.66666666666666324348e-1,
    8.33333333332248946124e-3,
    -1.98412698298579493134e-4,
    2.75573137070700676789e-6,
    -2.50507602534068634195e-8,
    1.58969099521155010221e-10,
)
_COS = (
    4.16666666666666019037e-2,
    -1.38888888888741095749e-3,
    2.48015872894767294178e-5,
    -2.75573143513906633035e-7,
    2.08757232129817482790e-9,
    -1.13596475577881948265e-11,
)
_QUARTER, _QUARTER_REST = 1.57079632673412561417, 6.07710050650619224932e-11
_INTEGERS = 1.5 * 2.0**52  # added and taken away again, it rounds to an integer


@part(inline=True)
def sine_and_cosine(x):
    """(sin x, cos x) to 1.2e-16 for |x| up to 1e5."""
    quarters = (x * (2.0 / math.pi) + _INTEGERS) - _INTEGERS
    y = (x - quarters * _QUARTER) - quarters * _QUARTER_REST
    z = y * y
    sine = y + y * z * (_SIN[0] + z * (_SIN[1] + z * (_SIN[2] + z * (_SIN[3] + z * (_SIN[4] + z * _SIN[5])))))
    half = 0.5 * z
    high = 1.0 - half
    tail = z * z * (_COS[0] + z * (_COS[1] + z * (_COS[2] + z * (_COS[3] + z * (_COS[4] + z * _COS[5])))))
    cosine = high + (((1.0 - high) - half) + tail)
    is_odd = _is_odd(quarters)
    is_turned = _is_odd(where(is_odd, 0.5 * (quarters - 1.0), 0.5 * quarters))
    sine, cosine = where(is_odd, cosine, sine), where(is_odd, -sine, cosine)
    return where(is_turned, -sine, sine), where(is_turned, -cosine, cosine)


@part(inline=True)
def _is_odd(integer):
    half = 0.5 * integer
    return abs(half - ((half + _INTEGERS) - _INTEGERS)) > 0.25


@part(inline=True)
def decay(x):
    """(exp(-x), (1 - exp(-x)) / x), the second with its limit 1 at x = 0; |x| up to 1: 1e-15, up to 3: 1e-11.

    The second is its power series at y = x/4, with the argument doubled twice by (1 - e^-2y) = (1 - e^-y)(1 + e^-y).
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
def angle_and_inverse(sine, cosine, value):
    """(the angle, 0 to 2 pi, of a vector with these components, 1 / value): two divisions for both.

    The vector has any length but zero.
    """
    side, size = abs(sine), abs(cosine)
    over, under = where(side < size, side, size), where(side < size, size, side)
    far = over > _SPLIT * under
    over, under = where(far, over - under, over), where(far, over + under, under)
    per_both = 1.0 / (under * value)
    x = over * value * per_both
    z = x * x
    p = (((_P[0] * z + _P[1]) * z + _P[2]) * z + _P[3]) * z + _P[4]
    q = ((((z + _Q[0]) * z + _Q[1]) * z + _Q[2]) * z + _Q[3]) * z + _Q[4]
    angle = where(far, 0.25 * math.pi, 0.0) + (x + x * z * p / q)
    angle = where(side < size, angle, 0.5 * math.pi - angle)
    angle = where(cosine < 0.0, math.pi - angle, angle)
    return where(sine < 0.0, 2.0 * math.pi - angle, angle), under * per_both
