"""Presets: named arms of beads."""

from __future__ import annotations

from collections.abc import Callable

from rollingjoint.checks import as_integer
from rollingjoint.spatial.chain import Bead, HingeChain
from rollingjoint.tendon import BeadTendon


def flexible_arm(model: str = "exact", *, stiffness: float = 681.6134060913569, compliance: float = 0.1) -> HingeChain:
    """The flexible-joint arm of 0.7 m: two segments of 16 beads of 10 g, four tendons each.

    Tendons 0 to 3 lie at +x, +y, -x, -y and end at link 16; tendons 4 to 7 lie between them and end at the tip.

    Args:
        model: of the tendons, as in HingeChain.
        stiffness: of every hinge [N·mm/rad].
        compliance: of every tendon [mm/N].
    Source: flexible-joint paper, fig. 1 and sec. IV (beads, segments, weight, length). It does not print the radius
        of the holes, their gap and the stiffness: 25 mm, 10 mm and E I / spacing of its 1.5 mm rod at 60 GPa.
    """
    axes = ("x", "y") * 16
    beads = [Bead(21.875, axis, stiffness, gap=10.0, weight=0.0981) for axis in axes]
    near, far = 25.0, 25.0 * 0.5**0.5
    rings = [(16, ((near, 0.0), (0.0, near), (-near, 0.0), (0.0, -near)))]
    rings += [(-1, ((far, far), (-far, far), (-far, -far), (far, -far)))]
    tendons = [BeadTendon([hole], end, 1.0 / compliance) for end, holes in rings for hole in holes]
    return HingeChain(beads, tendons, model, "flexible_arm")


def small_arm(n: int = 4, model: str = "exact", *, stiffness: float = 500.0, weight: float = 0.1) -> HingeChain:
    """A short arm of n beads with four tendons to its tip, for trying things out.

    Args:
        n: number of beads.
        model: of the tendons, as in HingeChain.
        stiffness: of every hinge [N·mm/rad].
        weight: of every bead [N].
    """
    n = as_integer("n", n, 1, allowed="1 or more beads")
    beads = [Bead(20.0, "xy"[i % 2], stiffness, gap=8.0, weight=weight) for i in range(n)]
    holes = ((15.0, 0.0), (0.0, 15.0), (-15.0, 0.0), (0.0, -15.0))
    return HingeChain(beads, [BeadTendon([hole]) for hole in holes], model, "small_arm")


PRESETS: dict[str, Callable[[], HingeChain]] = {"flexible_arm": flexible_arm, "small_arm": small_arm}
