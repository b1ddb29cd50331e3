"""What a class of chains says of itself is all that the rest asks: another class needs no other change."""

import pytest

from rollingjoint import (
    PRESETS,
    Equilibrium,
    HingeEquilibrium,
    SpatialEquilibrium,
    prepare,
    preset,
    solve_tensions,
    solve_tensions_batch,
)
from rollingjoint.errors import InvalidInput

ANOTHER = '''
"""Arms whose beads are called segments, as another class of chains."""
from dataclasses import dataclass, fields
import numpy as np
import rollingjoint as rj
from rollingjoint.chain.chain import Chain, kinds
from rollingjoint.chain.equilibrium import HingeEquilibrium
from rollingjoint.chain.file import HingeFormat
from rollingjoint.io import report
from rollingjoint.io.mechanism_file import dump_mechanism, load_mechanism

class WireEquilibrium(HingeEquilibrium):
    remark = ", a wire"

@dataclass(frozen=True, eq=False, repr=False)
class Wire(rj.HingeChain):
    title = "a wire"
    equilibrium = WireEquilibrium

class WireFormat(HingeFormat):
    kind, header = Wire, "# A wire.\\n"

arm = rj.small_arm(3)
wire = Wire(**{each.name: getattr(arm, each.name) for each in fields(arm)})
found = rj.solve_tensions(wire, (3.0, 2.0, 1.0, 1.0), start=[0.0] * 3)
assert type(found) is WireEquilibrium and "a wire" in report.status_line(found)
assert np.array_equal(found.poses, rj.solve_tensions(arm, (3.0, 2.0, 1.0, 1.0)).poses)
batch = rj.solve_tensions_batch([wire, wire], np.ones((2, 4)))
assert type(batch) is WireEquilibrium and batch.mechanism == (wire, wire)
assert dump_mechanism(wire).startswith("# A wire.") and dump_mechanism(arm).startswith("# An arm")
'''


@pytest.mark.parametrize("name", PRESETS)
def test_a_class_names_the_class_of_its_equilibria(name):
    mechanism = preset(name)
    found = solve_tensions(mechanism, [1.0] * mechanism.n_tendons)
    assert type(found) is mechanism.equilibrium in (Equilibrium, HingeEquilibrium, SpatialEquilibrium)
    assert found.tip.shape == (mechanism.dimension,) and found.positions.shape[-1] == mechanism.dimension
    assert mechanism.load_table(()).shape == (0, len(mechanism.load_columns))


@pytest.mark.slow
def test_another_class_is_solved_reported_and_written_without_a_change_elsewhere(run_python):
    run_python("-c", ANOTHER)


@pytest.mark.parametrize("wrong", [None, "five_link", PRESETS, type(preset("uniform"))])
def test_what_is_no_mechanism_is_refused_by_name(wrong):
    for call in (solve_tensions, solve_tensions_batch):
        with pytest.raises(InvalidInput, match="a RollingChain or a HingeChain"):
            call(wrong, [[1.0, 1.0]])
    with pytest.raises(InvalidInput, match="a RollingChain or a HingeChain"):
        prepare(wrong)
