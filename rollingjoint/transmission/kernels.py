"""The formulas of a motor's transmission, for kernels, and the kernels in which they fill arrays.

Symbols and units as in the package's docstring. Parts take numbers, for the limit of tension SIMD lanes too, and as
`differentiable.formulas` makes them, tensors.
"""

from __future__ import annotations

import math

from rollingjoint._numba.jit import kernel, part
from rollingjoint._numba.simd import where

FREE = 1e-9  # mm: a tendon this near to the place its motor asked for is at no limit of tension
NARROW = 1e-6  # mm: half the width of a play that is none


@part(inline=True)
def play_step(tendon, motor, half_width):
    """p after a step of the motor to q: clip(p, q - h, q + h). p for a motor that is NaN."""
    return min(max(tendon, motor - half_width), motor + half_width)


@part(inline=True)
def play_contact(tendon, motor, half_width):
    """The end of the play that moves the tendon when its motor goes to q: the sign of p - q, or 0 within the play."""
    if abs(tendon - motor) >= half_width:
        return 1.0 if tendon > motor else -1.0
    return 0.0


@part(inline=True)
def play_place(tendon, motor, half_width):
    """Position of a tendon in its play: (p - q) / h, within [-1, 1] but for rounding; 0 without play."""
    return where(half_width > 0.0, (tendon - motor) / half_width, 0.0)


@part(inline=True)
def play_inverse(tendon, move, half_width):
    """q that moves a tendon by `move` [mm], whichever way it was moved before."""
    return tendon + move + (half_width if move > 0.0 else -half_width)


@part(inline=True)
def sheath_direction(tendon, motor, half_width):
    """zeta, along which friction acts on a tendon in its sheath: from 1, pulled in, to -1, paid out; 0 without play."""
    return min(max(play_place(tendon, motor, half_width), -1.0), 1.0)


@part(inline=True)
def sheath_ratio(friction, direction):
    """Tension at the motor over the one behind the sheath: exp(nu zeta), the capstan's."""
    return math.exp(friction * direction)


@part(inline=True)
def at_limit(tension, low, high):
    """Whether a motor holds (low) or gives way (high) at this tension, or at this pull k (l - p)."""
    return (tension <= low) | (tension >= high)


@part(inline=True)
def limited_tension(pull, low, high):
    """T of a tendon that its motor would pull with k (l - p): clip(pull, low, high), at a limit exactly that."""
    return where(pull <= low, low, where(pull >= high, high, pull))


@part(inline=True)
def elastic_tension(length, unstretched, stiffness, low, high):
    """T of a tendon of length l and stiffness k whose motor is at p: clip(k (l - p), low, high)."""
    return limited_tension(stiffness * (length - unstretched), low, high)


@part(inline=True)
def unstretched_length(length, tension, stiffness):
    """p of a tendon with this length and tension: l - T / k."""
    return length - tension / stiffness


@part(inline=True)
def pull_limit(limit, friction, half_width):
    """T behind the sheath at which a motor that pulls its tendon in stops: its limit over exp(nu)."""
    return where(half_width > 0.0, limit / sheath_ratio(friction, 1.0), limit)


@part(inline=True)
def pull_end(tendon, motor, goal, tension, limit, friction, half_width):
    """q where a pull from q to a goal ends while the tendon stays at p: there, or where T exp(nu zeta) is the limit.

    A motor that is at its limit already stays at q.
    """
    at_goal = tension * sheath_ratio(friction, sheath_direction(tendon, goal, half_width))
    at_start = tension * sheath_ratio(friction, sheath_direction(tendon, motor, half_width))
    stops = min(max(tendon - half_width * math.log(limit / tension) / friction, goal), motor)
    ends = where(at_start >= limit, motor, stops)
    return where(at_goal < limit, max(goal, tendon - half_width), ends)


@part(inline=True)
def paid_out(unstretched, held):
    """Whether a tendon at p has been paid out from where it was."""
    return unstretched > held + FREE


@part(inline=True)
def motor_yield(motor, goal, shift):
    """(q, goal) of a motor after a limit of tension has moved its tendon by `shift` [mm]; it stays there."""
    motor, goal = motor + shift, goal + shift
    return motor, where(abs(shift) > FREE, motor, goal)


@kernel(title="motors and sheaths")
def play_steps(tendon, motor, half_width, after):
    """Fill `after` (N,)."""
    for i in range(len(after)):
        after[i] = play_step(tendon[i], motor[i], half_width[i])


@kernel(title="motors and sheaths")
def play_contacts(tendon, motor, half_width, sides):
    """Fill sides (N,)."""
    for i in range(len(sides)):
        sides[i] = play_contact(tendon[i], motor[i], half_width[i])


@kernel(title="motors and sheaths")
def play_places(tendon, motor, half_width, places):
    """Fill places (N,)."""
    for i in range(len(places)):
        places[i] = play_place(tendon[i], motor[i], half_width[i])


@kernel(title="motors and sheaths")
def play_inverses(tendon, move, half_width, motors):
    """Fill motors (N,)."""
    for i in range(len(motors)):
        motors[i] = play_inverse(tendon[i], move[i], half_width[i])


@kernel(title="motors and sheaths")
def sheath_directions(tendon, motor, half_width, directions):
    """Fill directions (N,)."""
    for i in range(len(directions)):
        directions[i] = sheath_direction(tendon[i], motor[i], half_width[i])


@kernel(title="motors and sheaths")
def sheath_ratios(friction, direction, ratios):
    """Fill ratios (N,)."""
    for i in range(len(ratios)):
        ratios[i] = sheath_ratio(friction[i], direction[i])


@kernel(title="motors and sheaths")
def pull_limits(limit, friction, half_width, tensions):
    """Fill tensions (N,)."""
    for i in range(len(tensions)):
        tensions[i] = pull_limit(limit[i], friction[i], half_width[i])


@kernel(title="motors and sheaths")
def pull_ends(tendon, motor, goal, tension, limit, friction, half_width, ends):
    """Fill ends (N,)."""
    for i in range(len(ends)):
        ends[i] = pull_end(tendon[i], motor[i], goal[i], tension[i], limit[i], friction[i], half_width[i])


@kernel(title="motors and sheaths")
def limits_reached(tension, low, high, reached):
    """Fill reached (N,), numbers: 1 at a limit."""
    for i in range(len(reached)):
        reached[i] = 1.0 if at_limit(tension[i], low[i], high[i]) else 0.0


@kernel(title="motors and sheaths")
def limited_tensions(pull, low, high, tensions):
    """Fill tensions (N,)."""
    for i in range(len(tensions)):
        tensions[i] = limited_tension(pull[i], low[i], high[i])


@kernel(title="motors and sheaths")
def elastic_tensions(length, unstretched, stiffness, low, high, tensions):
    """Fill tensions (N,)."""
    for i in range(len(tensions)):
        tensions[i] = elastic_tension(length[i], unstretched[i], stiffness[i], low[i], high[i])


@kernel(title="motors and sheaths")
def unstretched_lengths(length, tension, stiffness, lengths):
    """Fill lengths (N,)."""
    for i in range(len(lengths)):
        lengths[i] = unstretched_length(length[i], tension[i], stiffness[i])
