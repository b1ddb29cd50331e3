"""A second solver: minima of the energy between the limits of the joints, by SciPy on recomputed geometry.

Where loads have a potential there is always one, since joints move between stops. An equilibrium that the solver does
not find and this one does is a failure.
"""

import numpy as np
from scipy.optimize import least_squares, minimize

from tests.attack.law import tendon_energy, tendon_tensions

STARTS = 6
BALANCED = 1e-6  # N·mm, and times 1e-6 of the sum of the terms
_AT_END = 1e-9  # of the range


class Row:
    """One row of a case as a bounded minimisation over arc lengths of contacts, or angles of hinges."""

    def __init__(self, case, geometry, row):
        self.geometry, self.table = geometry, case.tables[row : row + 1]
        self._law = case.inputs[row : row + 1], case.given
        self._stiffnesses = np.array([tendon.stiffness for tendon in case.mechanism.tendons])
        self._limits = case.limits
        self.low, self.high = geometry.limits

    def energy(self, at):
        """The potential energy [N·mm]."""
        potential = tendon_energy(*self._law, self._stiffnesses, self._limits)
        return float(self.geometry.energy(at[None], self.table, potential)[0])

    def torque(self, at):
        """(unbalanced moment of every joint, sum of its terms), (J,) each [N·mm]."""
        cuts = self.geometry.cuts(at[None])
        lengths = self.geometry.lengths(cuts)
        inputs, given = self._law
        motor = tendon_tensions(lengths, inputs, given, self._stiffnesses, self._limits)
        tensions, _, _ = self.geometry.gap_tensions(cuts, motor, None, None)
        torque, size, _ = self.geometry.imbalance(cuts, self.table, tensions)
        return torque[0], size[0]

    def gradient(self, at):
        """Of the energy over the coordinates, (J,)."""
        return -self.torque(at)[0] * self.geometry.turning_rates(at[None])[0]

    def held(self, at):
        """Joints that are pushed against an end of their range, (J,)."""
        margin, push = _AT_END * (self.high - self.low), -self.gradient(at)
        return ((at <= self.low + margin) & (push < 0.0)) | ((at >= self.high - margin) & (push > 0.0))

    def balances(self, at):
        """Whether the moments of all joints that are not held are balanced."""
        torque, size = self.torque(at)
        return bool(np.all(self.held(at) | (np.abs(torque) <= BALANCED * (1.0 + size))))

    def descended(self, start):
        """Coordinates of a local minimum, by L-BFGS-B; the free ones made exact by Gauss-Newton on the moments."""
        bounds = np.stack([self.low, self.high], axis=1)
        options = {"maxiter": 3000, "maxfun": 6000, "ftol": 1e-16, "gtol": 1e-10}
        found = minimize(self.energy, start, jac=self.gradient, bounds=bounds, method="L-BFGS-B", options=options)
        at = np.clip(found.x, self.low, self.high)
        free = ~self.held(at)
        if not free.any() or self.balances(at):
            return at

        def torque(part):
            return self.torque(_with(at, free, part))[0][free]

        margin = 1e-12 * (self.high - self.low)
        inside = np.clip(at, self.low + margin, self.high - margin)[free]
        part = least_squares(
            torque, inside, bounds=(self.low[free], self.high[free]), xtol=1e-15, ftol=1e-15, gtol=1e-15
        )
        return _with(at, free, part.x)


def _with(at, free, part):
    whole = at.copy()
    whole[free] = part
    return whole


def minimum(rng, case, geometry, row, start):
    """The lowest minimum found from the start and from random places, None where none balances; coordinates (J,)."""
    one, best, least = Row(case, geometry, row), None, np.inf
    starts = [start, *rng.uniform(one.low, one.high, (STARTS - 1, len(one.low)))]
    for begin in starts:
        at = one.descended(np.clip(begin, one.low, one.high))
        energy = one.energy(at)
        if energy < least and one.balances(at):
            best, least = at, energy
    return best
