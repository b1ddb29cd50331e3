"""Elementary functions of numbers and of SIMD lanes alike, made of arithmetic alone: lanes round as floats do."""

from __future__ import annotations

import math

from rollingjoint._numba.jit import part
from rollingjoint._numba.simd import where

_EXP_TERMS = 12
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
def exponential(x):
    """exp(x) for |x| up to 3, to a relative error of 3e-15: the power series of x/8, squared three times."""
    y = 0.125 * x
    value = 1.0 + y * (1.0 / _EXP_TERMS)
    for k in range(_EXP_TERMS - 1, 0, -1):
        value = 1.0 + y * value * (1.0 / k)
    value = value * value
    value = value * value
    return value * value


@part(inline=True)
def angle_of(sine, cosine):
    """The angle, 0 to pi, of a vector with these components (of any length, not both zero, sine not negative)."""
    size = abs(cosine)
    over, under = where(sine < size, sine, size), where(sine < size, size, sine)
    far = over > _SPLIT * under
    over, under = where(far, over - under, over), where(far, over + under, under)
    x = over / under
    z = x * x
    p = (((_P[0] * z + _P[1]) * z + _P[2]) * z + _P[3]) * z + _P[4]
    q = ((((z + _Q[0]) * z + _Q[1]) * z + _Q[2]) * z + _Q[3]) * z + _Q[4]
    angle = where(far, 0.25 * math.pi, 0.0) + (x + x * z * p / q)
    angle = where(sine < size, angle, 0.5 * math.pi - angle)
    return where(cosine < 0.0, math.pi - angle, angle)
