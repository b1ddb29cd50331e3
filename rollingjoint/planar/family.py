"""Planar rolling chains as a family of mechanisms."""

from __future__ import annotations

from rollingjoint.family import Family
from rollingjoint.load import LOAD_COLUMNS, load_table
from rollingjoint.planar import batch, file, report
from rollingjoint.planar.chain import RollingChain
from rollingjoint.planar.equilibrium import Equilibrium
from rollingjoint.planar.presets import PRESETS


class PlanarFamily(Family[RollingChain, Equilibrium]):
    """Planar chains of links that roll on each other."""

    kind = RollingChain
    title = "a planar chain of rolling links"
    dimension = 2
    load_columns = LOAD_COLUMNS
    batch_arrays = batch.BatchArrays
    length_methods = ("elastic", "least_squares")
    slips = True
    presets = PRESETS
    file_parts = "links"
    file_keys = file.KEYS
    file_header = "# A rolling-contact mechanism, base link first. Units: mm, rad, N/mm; curvature in 1/mm.\n"

    load_table = staticmethod(load_table)
    solve_one = staticmethod(batch.solve_one)
    new_results = staticmethod(batch.new_results)
    solve_range = staticmethod(batch.solve_range)
    pack = staticmethod(batch.pack)
    from_dict = staticmethod(file.from_dict)
    to_dict = staticmethod(file.to_dict)
    travel = staticmethod(report.travel)
    tables = staticmethod(report.tables)
    to_json = staticmethod(report.to_json)
    start_angles = staticmethod(RollingChain.joint_angles)
