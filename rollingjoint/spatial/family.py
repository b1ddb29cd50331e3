"""Spatial hinge chains as a family of mechanisms."""

from __future__ import annotations

from collections.abc import Sequence

from rollingjoint.family import Family
from rollingjoint.load import SPATIAL_LOAD_COLUMNS, spatial_load_table
from rollingjoint.spatial import batch, file, report
from rollingjoint.spatial.chain import HingeChain
from rollingjoint.spatial.equilibrium import HingeEquilibrium
from rollingjoint.spatial.presets import PRESETS


class SpatialFamily(Family[HingeChain, HingeEquilibrium]):
    """Spatial arms of beads on elastic hinges."""

    kind = HingeChain
    title = "an arm of beads"
    dimension = 3
    load_columns = SPATIAL_LOAD_COLUMNS
    batch_arrays = batch.BatchArrays
    presets = PRESETS
    file_parts = "beads"
    file_keys = file.KEYS
    file_header = "# An arm of beads on elastic hinges, base first. Units: mm, rad, N, N·mm/rad; tendons in N/mm.\n"

    load_table = staticmethod(spatial_load_table)
    solve_one = staticmethod(batch.solve_one)
    new_results = staticmethod(batch.new_results)
    solve_range = staticmethod(batch.solve_range)
    pack = staticmethod(batch.pack)
    from_dict = staticmethod(file.from_dict)
    to_dict = staticmethod(file.to_dict)
    travel = staticmethod(report.travel)
    tables = staticmethod(report.tables)
    to_json = staticmethod(report.to_json)
    remark = staticmethod(report.remark)
    own_weight = staticmethod(HingeChain.gravity)

    @staticmethod
    def start_angles(mechanism: HingeChain, places: Sequence[float]) -> Sequence[float]:
        """The angles themselves."""
        return places
