"""Designing mechanisms: spaces of designs, what a design is judged by, problems that a search can solve.

Needs torch, which nothing else in the project imports with it; docs/design.md shows it.

    space.py       DesignSpace: vectors to mechanisms and back
    ranges.py      its fields, checked
    numbers.py     the numbers of designs, and how links share them
    curve.py       matrices from knot values to curvature, turning and points
    margins.py     validity as smooth margins
    faults.py      validity by an independent check
    inverse.py     a mechanism back to the numbers of a design
    objectives.py  bending shapes, what the tip reaches, tendon travel
    loads.py       stiffness, load capacity, peak tension
    sweeps.py      sweeps of tensions that several objectives share
    comparison.py  objectives of any mechanism; designs that no other one beats
    problem.py     Problem: space, objectives and limits to an Evaluation
"""

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
