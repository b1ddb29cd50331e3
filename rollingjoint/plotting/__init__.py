"""Pictures of mechanisms and equilibria with matplotlib, which is imported when something is drawn."""

from rollingjoint.plotting.parts import PALETTE
from rollingjoint.plotting.planar import plot_family, plot_mechanism, save_figure
from rollingjoint.plotting.spatial import plot_arm

__all__ = ["PALETTE", "plot_arm", "plot_family", "plot_mechanism", "save_figure"]
