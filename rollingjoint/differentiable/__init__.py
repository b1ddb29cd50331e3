"""Equilibria as differentiable functions of the design, the inputs and the loads, in torch.

Nothing else in the project imports this package; `import rollingjoint` needs no torch. docs/differentiable.md shows it.

Modules:
    compiled: batches through the compiled solver.
    design: a mechanism, or many, as tensors.
    equilibria: what the solvers return.
    friction: friction of the tendons, and what one step leaves to the next.
    geometry: where surfaces touch, how tendons run.
    loads: loads, their energy, moments and stiffness.
    looking: looks of the host at numbers on a device.
    newton: Newton's method on many rows; the equilibria of a batch of designs.
    side_by_side: equilibria of many chains in a fixed number of passes, without gradients: for simulation on a device.
    slip: friction at one pose: slip of the holes, tensions of the gaps and their slopes.
    solve: the two solvers, and the adjoint.
    statics: the whole chain at given angles: residual, stiffness, energy, contact forces.
    surface: curvature to tangent angles and points.
    tabulated: joints as the compiled solver's tables on a device.
    transmission: play, sheath and limits of tension of motors.
"""

from rollingjoint.errors import naming_extras

with naming_extras():
    from rollingjoint.differentiable.design import DifferentiableChain
    from rollingjoint.differentiable.equilibria import Equilibria
    from rollingjoint.differentiable.friction import DifferentiableFriction, FrictionStates
    from rollingjoint.differentiable.looking import as_on_a_device
    from rollingjoint.differentiable.side_by_side import Settled, SideBySide
    from rollingjoint.differentiable.solve import solve_lengths, solve_tensions
    from rollingjoint.differentiable.surface import linear_pieces, spline_pieces

__all__ = [
    "DifferentiableChain",
    "DifferentiableFriction",
    "Equilibria",
    "FrictionStates",
    "Settled",
    "SideBySide",
    "as_on_a_device",
    "linear_pieces",
    "solve_lengths",
    "solve_tensions",
    "spline_pieces",
]
