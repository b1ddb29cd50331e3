"""Spatial hinge chains as a family of mechanisms."""

from __future__ import annotations

from rollingjoint.family import Family
from rollingjoint.load import SPATIAL_LOAD_COLUMNS, spatial_load_table
from rollingjoint.spatial import batch, file, report
from rollingjoint.spatial.chain import HingeChain
from rollingjoint.spatial.presets import PRESETS

SPATIAL = Family(
    kind=HingeChain,
    title="an arm of beads",
    dimension=3,
    presets=PRESETS,
    load_columns=SPATIAL_LOAD_COLUMNS,
    load_table=spatial_load_table,
    batch=batch,
    file=file,
    report=report,
    start_angles=lambda mechanism, angles: mechanism.per_joint("start", angles),
    own_weight=HingeChain.gravity,
)
