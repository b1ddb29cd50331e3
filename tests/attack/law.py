"""The capstan law with memory, written down from docs/theory.md, section 9."""

import numpy as np


def turns_of_links(turns):
    """Turn of every tendon in links 0 to J - 1, (B, J, m), from those at both holes of every gap, (B, J, m, 2)."""
    entry = np.concatenate([np.zeros_like(turns[:, :1, :, 1]), turns[:, :-1, :, 1]], axis=1)
    return turns[..., 0] + entry


def capstan_tensions(laws, ends, gaps, turns, motor, before):
    """(tension of every gap, friction state, slip coordinate), (B, J, m) each.

    laws: CapstanFriction or None of every tendon; ends: joints that it crosses; motor: (B, m); before: FrictionState.
    """
    tensions, states, slips = np.zeros((3, *gaps.shape))
    for j, (law, end) in enumerate(zip(laws, ends, strict=True)):
        mu, presliding, extra, constant, compliance = (
            (law.mu, law.presliding, law.extra_turn, law.constant, law.compliance) if law else (0, 0.02, 0, 0, 0)
        )
        beyond = np.cumsum(gaps[:, end - 1 :: -1, j] if end else gaps[:, :0, j], axis=1)[:, ::-1]
        share = compliance * (end - np.arange(end)) / end
        slips[:, :end, j] = beyond - share * motor[:, j : j + 1]
        way = slips[:, :end, j] - before.slips[:, :end, j]
        z = states[:, :end, j] = np.clip(before.states[:, :end, j] - way / presliding, -1.0, 1.0)
        kept = np.exp(-mu * np.cumsum(z * (extra + turns[:, :end, j]), axis=1))
        left = motor[:, j : j + 1] * kept - constant * np.cumsum(z, axis=1)
        tensions[:, :end, j] = np.maximum(left, 0.0)
    return tensions, states, slips


def gap_tensions(structure, cuts, motor, before):
    """capstan_tensions of an arm or a chain (`structures.py`); without a history the motor's tension in every gap."""
    if before is None:
        return np.where(structure.crossed, motor[:, None, :], 0.0), None, None
    laws = [tendon.friction or structure.chain.friction for tendon in structure.chain.tendons]
    return capstan_tensions(laws, structure.ends, cuts.gaps, turns_of_links(cuts.turns), motor, before)


def tendon_tensions(lengths, inputs, given, stiffnesses, limits):
    """Tensions at the motors, (B, m): those given, or those of stretched tendons within their limits."""
    if given == "tensions":
        return inputs
    return np.clip(stiffnesses * (lengths - inputs), *limits)


def tendon_energy(inputs, given, stiffnesses, limits):
    """The energy of the tendons as a function of their lengths (B, m), (B,)."""
    if given == "tensions":
        return lambda lengths: (inputs * lengths).sum(axis=1)
    low, high = limits

    def energy(lengths):
        stretch = lengths - inputs
        first, last = low / stiffnesses, np.minimum(high / stiffnesses, 1e9)
        inside = np.clip(stretch, first, last)
        linear = low * np.minimum(stretch, first) + np.where(stretch > last, high, 0.0) * np.maximum(stretch - last, 0)
        return (linear + 0.5 * stiffnesses * (inside**2 - first**2)).sum(axis=1)

    return energy
