"""Equilibria as differentiable functions of the design, the inputs and the loads, in torch.

Nothing else in the project imports this package; `import rollingjoint` needs no torch. docs/differentiable.md shows it.

    design.py      a mechanism, or many, as tensors
    surface.py     curvature to tangent angles and points
    geometry.py    where surfaces touch, where holes are
    statics.py     the whole chain at given contacts: residual, stiffness, energy, contact forces
    newton.py      equilibria of many lanes by Newton's method in torch
    compiled.py    lanes through the compiled solver
    equilibria.py  what the solvers return
    solve.py       the two solvers, and the adjoint
"""

from rollingjoint.differentiable.design import DifferentiableChain
from rollingjoint.differentiable.equilibria import Equilibria
from rollingjoint.differentiable.solve import solve_lengths, solve_tensions
from rollingjoint.differentiable.surface import linear_pieces, spline_pieces

__all__ = [
    "DifferentiableChain",
    "Equilibria",
    "linear_pieces",
    "solve_lengths",
    "solve_tensions",
    "spline_pieces",
]
