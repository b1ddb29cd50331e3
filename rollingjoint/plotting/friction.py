"""Pictures of friction: tensions of the gaps and holes that stick, in a mechanism, along a tendon and over a path."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from rollingjoint.chain.equilibrium import Equilibrium
from rollingjoint.chain.solution import Solution
from rollingjoint.checks import as_integer
from rollingjoint.errors import InvalidInput, naming_extras
from rollingjoint.plotting.parts import ORDER, PALETTE

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.cm import ScalarMappable

Array = NDArray[np.float64]

STICKS: dict[str, Any] = {
    "linestyle": "none",
    "marker": "o",
    "markerfacecolor": "white",
    "markeredgecolor": "#B2182B",
    "markeredgewidth": 1.4,
    "markersize": 6,
    "zorder": ORDER["contact"] + 0.5,
    "label": "sticks",
}
_TENSIONS, _STATES = "viridis", "PuOr"  # colour maps


def draw_gap_tensions(ax: Axes, eq: Equilibrium, ends: tuple[float, float] | None = None, scale: bool = True) -> None:
    """Draws the tendons, coloured by their tension, with numbers at the base and rings on holes in which they stick.

    Args:
        ax: axes to draw on, in mm.
        eq: one equilibrium.
        ends: tensions at both ends of the colours [N]; the smallest and largest of the gaps when None.
        scale: draw a scale of the colours below.
    """
    from matplotlib.collections import LineCollection

    colors, step = tension_colors(eq, ends), 0.035 * eq.chain.length
    for j, holes in enumerate(eq.chain.tendon_polyline(eq.poses)):
        pieces, tones = list(np.stack([holes[:-1], holes[1:]], axis=1)), colors.to_rgba(piece_tensions(eq, j))
        ax.add_collection(LineCollection(pieces, colors=tones, linewidths=2.6, zorder=ORDER["tendon"]))
        ax.text(holes[0, 0], holes[0, 1] - step, str(j), ha="center", va="top", fontsize=8)
        ax.update_datalim(np.vstack([holes, holes[0] - (0.0, 3 * step)]))
        motor = colors.to_rgba(eq.tensions[j])
        ax.plot([], [], color=motor, linewidth=2.6, label=f"tendon {j}, {eq.tensions[j]:.3g} N at the motor")
        sticking = holes.reshape(-1, 2, 2)[:-1][eq.sticking[: len(holes) // 2 - 1, j]]
        if len(sticking):
            ax.plot(*sticking.reshape(-1, 2).T, **STICKS)
    if scale:
        ax.figure.colorbar(colors, ax=ax, location="bottom", shrink=0.7, pad=0.12, label="tension [N]")


def piece_tensions(equilibrium: Solution, tendon: int) -> Array:
    """Tension of a tendon in the channel of link 0, gap 0, the channel of link 1 and so on to its end [N].

    A channel has the mean of both sides; friction at its holes changes the tension between them.
    """
    gaps = equilibrium.gap_tensions[: equilibrium.mechanism.last_links[tendon], tendon]
    sides = np.concatenate([equilibrium.tensions[[tendon]], gaps, gaps[-1:]])
    tensions = np.empty(2 * len(gaps) + 1)
    tensions[::2], tensions[1::2] = 0.5 * (sides[:-1] + sides[1:]), gaps
    return tensions


def tension_colors(equilibria: Solution, ends: tuple[float, float] | None = None) -> ScalarMappable:
    """Colours of the tensions between both ends; default: between the smallest and largest of the gaps."""
    from matplotlib.cm import ScalarMappable
    from matplotlib.colors import Normalize

    return ScalarMappable(Normalize(*(tension_ends(equilibria) if ends is None else ends)), _TENSIONS)


def tension_ends(equilibria: Solution) -> tuple[float, float]:
    """The smallest and largest tension of any gap that a tendon crosses [N]."""
    chain = equilibria.mechanism[0] if isinstance(equilibria.mechanism, tuple) else equilibria.mechanism
    crossed = np.arange(chain.n_joints)[:, None] < np.array(chain.last_links)
    tensions = equilibria.gap_tensions[..., crossed]
    return float(tensions.min()), float(tensions.max())


def plot_tensions(
    equilibria: Sequence[Solution], labels: Sequence[str], tendon: int = 0, ax: Axes | None = None
) -> Axes:
    """Axes with the tension along a tendon: before link 0 at the motor, after link k in gap k.

    Rings mark the links in which it sticks.

    Args:
        equilibria: single equilibria of one mechanism.
        labels: legend text of each.
        tendon: its number.
        ax: axes to draw on; new ones when None.
    Raises:
        InvalidInput: no equilibria, other numbers of labels, a tendon that does not exist.
    """
    if not equilibria or len(labels) != len(equilibria):
        raise InvalidInput("labels", list(labels), f"{len(equilibria)}, one per equilibrium, and at least one")
    last_links = equilibria[0].mechanism.last_links
    tendon = as_integer("tendon", tendon, 0, len(last_links) - 1)
    ax = _new_axes((6.4, 3.6)) if ax is None else ax
    links = np.arange(last_links[tendon])
    for place, (equilibrium, label) in enumerate(zip(equilibria, labels, strict=True)):
        tensions = np.concatenate([equilibrium.tensions[[tendon]], equilibrium.gap_tensions[links, tendon]])
        color = PALETTE[place % len(PALETTE)]
        ax.stairs(tensions, np.arange(-1, len(links) + 1), baseline=None, color=color, linewidth=1.8, label=label)
        sticking = links[equilibrium.sticking[links, tendon] & (equilibrium.friction is not None)]
        if len(sticking):
            ax.plot(sticking, 0.5 * (tensions[sticking] + tensions[sticking + 1]), **STICKS)
    ax.set(xlabel="link", ylabel=f"tension of tendon {tendon} [N]", xticks=links)
    ax.margins(x=0.02)
    unique = {text: handle for handle, text in zip(*ax.get_legend_handles_labels(), strict=True)}
    ax.legend(unique.values(), unique.keys())
    return _with_grid(ax)


def plot_friction_states(path: Solution, ax: Axes | None = None) -> Axes:
    """Axes with the friction state of every tendon in every link over the steps of a path.

    The full colours are slip, to the motor and to the tip; a tendon sticks in between.

    Args:
        path: from trace.
        ax: axes to draw on; new ones when None.
    Raises:
        InvalidInput: a single equilibrium.
    """
    states = path.friction_states
    if states.ndim != 3:
        raise InvalidInput("path", path, "a path, as trace returns it", "One equilibrium has no steps.")
    ends = path.mechanism.last_links
    ax = _new_axes((6.4, 0.22 * sum(ends) + 1.8)) if ax is None else ax
    rows = np.concatenate([states[:, :end, j] for j, end in enumerate(ends)], axis=1).T
    names = [f"{k}" for end in ends for k in range(end)]
    image = ax.imshow(rows, cmap=_STATES, vmin=-1, vmax=1, aspect="auto", interpolation="nearest", origin="lower")
    starts = np.cumsum([0, *ends])
    for j, start in enumerate(starts[:-1]):
        ax.axhline(start - 0.5, color="black", linewidth=0.8)
        middle = start + 0.5 * (ends[j] - 1)
        ax.annotate(
            f"tendon {j}", (0, middle), (-34, 0), ax.get_yaxis_transform(), "offset points", rotation=90,
            ha="center", va="center",
        )  # fmt: skip
    ax.set(xlabel="step", yticks=range(len(names)), yticklabels=names)
    ax.set_ylabel("link", labelpad=24)
    label = "state: −1 slips to the tip, 1 to the motor"
    ax.figure.colorbar(image, ax=ax, label=label, ticks=(-1, 0, 1))
    return ax


def _new_axes(size: tuple[float, float]) -> Axes:
    with naming_extras():
        from matplotlib import pyplot

    return pyplot.subplots(figsize=size, layout="constrained")[1]


def _with_grid(ax: Axes) -> Axes:
    ax.grid(color="#E5E8EC", linewidth=0.6)
    ax.set_axisbelow(True)
    return ax
