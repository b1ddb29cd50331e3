"""Equilibria as differentiable functions of the design, the inputs and the loads, in torch.

No other module of the library imports this package; `import rollingjoint` needs no torch. See docs/differentiable.md.

Modules:
    compiled: batches through the compiled solver.
    contact: contact with walls at one pose in the plane.
    design: one chain in the plane or many as tensors.
    equilibria: results of the solvers.
    found: equilibria that compiled batches have found.
    formulas: formulas of kernels as functions of tensors.
    friction: friction of the tendons, and its memory from step to step.
    geometry: contacts of surfaces, routes of tendons.
    loads: loads, their energy, moments and stiffness.
    looking: looks of the host at numbers on a device.
    newton: Newton's method on many rows; the equilibria of a batch of designs.
    pairs: pairs of an outline and a wall, evaluated by the source of kernels.
    parameters: mechanisms as tensors, as far as the classes of chains share it.
    side_by_side: equilibria of many chains in a fixed number of passes, without gradients: for simulation on a device.
    slip: friction at one pose: slip of the holes, tensions of the gaps and their slopes.
    solve: the two solvers, and the adjoint.
    spatial_contact: contact with walls at one pose in space.
    spatial_design: one chain in space or many as tensors.
    spatial_equilibria: results of the solvers in space, with the margins of contact lines.
    spatial_loads: loads in space, their energy, moments and stiffness.
    spatial_statics: the whole chain in space at given angles.
    spatial_surroundings: walls in space as tensors.
    spatial_walled: equilibria in space among walls.
    statics: the whole chain at given angles: residual, stiffness, energy, contact forces.
    surface: curvature to tangent angles and points.
    surroundings: walls as tensors, in the plane.
    walled: equilibria among walls, in the plane.
"""

from rollingjoint.chain.wall_sums import link_contact
from rollingjoint.errors import naming_extras

with naming_extras():
    from rollingjoint.differentiable.design import DifferentiableChain
    from rollingjoint.differentiable.equilibria import Equilibria
    from rollingjoint.differentiable.found import of_solutions
    from rollingjoint.differentiable.friction import DifferentiableFriction, FrictionStates
    from rollingjoint.differentiable.looking import as_on_a_device
    from rollingjoint.differentiable.side_by_side import Settled, SideBySide
    from rollingjoint.differentiable.solve import solve_lengths, solve_tensions
    from rollingjoint.differentiable.spatial_design import DifferentiableSpatialChain
    from rollingjoint.differentiable.spatial_equilibria import SpatialEquilibria
    from rollingjoint.differentiable.spatial_surroundings import DifferentiableSpatialSurroundings
    from rollingjoint.differentiable.spatial_walled import SpatialWalledEquilibria
    from rollingjoint.differentiable.surface import linear_pieces, spline_pieces
    from rollingjoint.differentiable.surroundings import DifferentiableSurroundings
    from rollingjoint.differentiable.walled import WalledEquilibria

__all__ = [
    "DifferentiableChain",
    "DifferentiableFriction",
    "DifferentiableSpatialChain",
    "DifferentiableSpatialSurroundings",
    "DifferentiableSurroundings",
    "Equilibria",
    "FrictionStates",
    "Settled",
    "SideBySide",
    "SpatialEquilibria",
    "SpatialWalledEquilibria",
    "WalledEquilibria",
    "as_on_a_device",
    "linear_pieces",
    "link_contact",
    "of_solutions",
    "solve_lengths",
    "solve_tensions",
    "spline_pieces",
]
