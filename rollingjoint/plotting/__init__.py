"""Pictures of mechanisms and equilibria with matplotlib, which is imported at the first picture.

Modules:
    contact_lines: contact surfaces and lines of chains in space, and forces on teeth and straps.
    figure: a figure of any mechanism or equilibrium, and figures as files.
    film: animations, and a chain that is pushed in among walls.
    friction: tensions of the gaps and holes that stick, in a mechanism, along a tendon and over a path.
    loops: hysteresis loops, and a mechanism on its way around one.
    parts: elements of pictures of planar chains.
    planar: pictures of planar chains.
    plans: a mechanism on its way along a path, lengths and tensions over time.
    spatial: pictures of arms.
    walls: walls, lumens and obstacles, and the forces at them.
    walls_in_space: the same around chains in space.
    workspaces: dexterity, force and stiffness where the tip can be.
"""

from rollingjoint.plotting.figure import figure_of, save_figure
from rollingjoint.plotting.film import save_wall_film
from rollingjoint.plotting.friction import plot_friction_states, plot_tensions
from rollingjoint.plotting.loops import plot_loops, save_animation
from rollingjoint.plotting.parts import PALETTE
from rollingjoint.plotting.planar import plot_family, plot_mechanism
from rollingjoint.plotting.plans import plot_plan
from rollingjoint.plotting.spatial import plot_arm
from rollingjoint.plotting.walls import plot_wall_contacts
from rollingjoint.plotting.workspaces import plot_workspace

__all__ = [
    "PALETTE",
    "figure_of",
    "plot_arm",
    "plot_family",
    "plot_friction_states",
    "plot_loops",
    "plot_mechanism",
    "plot_plan",
    "plot_tensions",
    "plot_wall_contacts",
    "plot_workspace",
    "save_animation",
    "save_figure",
    "save_wall_film",
]
