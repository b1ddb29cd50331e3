"""Designing mechanisms: design spaces, objectives, and problems that a search can solve.

Needs torch, which `import rollingjoint` does not load; see docs/design.md.

Modules:
    box: vectors in a box to physical numbers and back, for every design space.
    chain_margins: validity of designs of any chain as margins.
    comparison: objectives of any mechanism; Pareto-optimal designs.
    curve: matrices from knot values to curvature, turning and points.
    faults: an independent check of validity.
    inverse: the numbers of the design of a mechanism.
    loads: objectives under lateral forces: stiffness, load capacity, peak tension.
    margins: validity as smooth margins.
    mechanism_space: vectors to changes of one mechanism of any kind.
    numbering: which dimensions of a mechanism change together.
    numbers: the numbers of designs, shared by links.
    objectives: bending shapes, tip travel and rotation, tendon travel.
    problem: a space, objectives and limits as a problem, and its evaluation.
    ranges: the fields of a design space, checked.
    refined: curvatures in pieces that end at the knots of changes.
    settings: design spaces from plain settings.
    space: vectors to chains in the plane and back.
    spatial_objectives: stiffness and reach of the tip of chains in space, margins of their contact lines.
    spatial_space: vectors to chains in space.
    sweeps: sweeps of tensions, shared by objectives.
"""

from rollingjoint.errors import naming_extras

with naming_extras():
    from rollingjoint.design.box import DesignBox
    from rollingjoint.design.chain_margins import CHAIN_MARGINS
    from rollingjoint.design.comparison import measure, nondominated
    from rollingjoint.design.loads import LateralStiffness, LoadCapacity, PeakTension
    from rollingjoint.design.margins import MARGINS
    from rollingjoint.design.mechanism_space import MechanismSpace
    from rollingjoint.design.objectives import BendingShapes, Measured, Objective, TendonTravel, TipRotation, TipTravel
    from rollingjoint.design.problem import Evaluation, Limit, Problem, Term
    from rollingjoint.design.settings import space_of_settings
    from rollingjoint.design.space import DesignSpace
    from rollingjoint.design.spatial_objectives import (
        FrictionRequired,
        PlacementError,
        PressingMargin,
        TiltingMargin,
        TipReach,
        TipStiffness,
        ToothMargin,
    )
    from rollingjoint.design.spatial_space import SPATIAL_MARGINS, SpatialDesignSpace

__all__ = [
    "CHAIN_MARGINS",
    "MARGINS",
    "SPATIAL_MARGINS",
    "BendingShapes",
    "DesignBox",
    "DesignSpace",
    "Evaluation",
    "FrictionRequired",
    "LateralStiffness",
    "Limit",
    "LoadCapacity",
    "Measured",
    "MechanismSpace",
    "Objective",
    "PeakTension",
    "PlacementError",
    "PressingMargin",
    "Problem",
    "SpatialDesignSpace",
    "TendonTravel",
    "Term",
    "TiltingMargin",
    "TipReach",
    "TipRotation",
    "TipStiffness",
    "TipTravel",
    "ToothMargin",
    "measure",
    "nondominated",
    "space_of_settings",
]
