"""Designing mechanisms: design spaces, objectives, and problems that a search can solve.

Needs torch, which `import rollingjoint` does not load; see docs/design.md.

Modules:
    comparison: objectives of any mechanism; Pareto-optimal designs.
    curve: matrices from knot values to curvature, turning and points.
    faults: an independent check of validity.
    inverse: the numbers of the design of a mechanism.
    loads: objectives under lateral forces: stiffness, load capacity, peak tension.
    margins: validity as smooth margins.
    numbers: the numbers of designs, shared by links.
    objectives: bending shapes, tip travel and rotation, tendon travel.
    problem: a space, objectives and limits as a problem, and its evaluation.
    ranges: the fields of a design space, checked.
    space: vectors to mechanisms and back.
    sweeps: sweeps of tensions, shared by objectives.
"""

from rollingjoint.errors import naming_extras

with naming_extras():
    from rollingjoint.design.comparison import measure, nondominated
    from rollingjoint.design.loads import LateralStiffness, LoadCapacity, PeakTension
    from rollingjoint.design.margins import MARGINS
    from rollingjoint.design.objectives import BendingShapes, Measured, Objective, TendonTravel, TipRotation, TipTravel
    from rollingjoint.design.problem import Evaluation, Limit, Problem, Term
    from rollingjoint.design.space import DesignSpace

__all__ = [
    "MARGINS",
    "BendingShapes",
    "DesignSpace",
    "Evaluation",
    "LateralStiffness",
    "Limit",
    "LoadCapacity",
    "Measured",
    "Objective",
    "PeakTension",
    "Problem",
    "TendonTravel",
    "Term",
    "TipRotation",
    "TipTravel",
    "measure",
    "nondominated",
]
