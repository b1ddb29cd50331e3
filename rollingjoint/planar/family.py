"""Planar rolling chains as a family of mechanisms."""

from __future__ import annotations

from rollingjoint.family import Family
from rollingjoint.load import LOAD_COLUMNS, load_table
from rollingjoint.planar import batch, file, report
from rollingjoint.planar.chain import RollingChain
from rollingjoint.planar.presets import PRESETS

PLANAR = Family(
    kind=RollingChain,
    title="a planar chain of rolling links",
    dimension=2,
    presets=PRESETS,
    load_columns=LOAD_COLUMNS,
    load_table=load_table,
    batch=batch,
    file=file,
    report=report,
    start_angles=RollingChain.joint_angles,
    length_methods=("elastic", "least_squares"),
    slips=True,
)
