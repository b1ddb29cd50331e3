"""Steps with friction of the reference chains in space, recomputed from geometry, alone and in batches."""

import numpy as np
import pytest

from rollingjoint import CapstanFriction, FrictionState, Status, solve_lengths, solve_tensions, solve_tensions_batch
from rollingjoint.load import spatial_load_table
from tests.attack.solves import Case
from tests.second_opinions import spatial_reference as reference

CASES = reference.cases()[1:10]
STEPS = 5
FIELDS = (
    "joint_angles", "poses", "tensions", "lengths", "contact_points", "reactions", "gap_tensions", "friction_states",
    "slip", "residual",
)  # fmt: skip


def rubbed(case, number):
    """The mechanism of a case with friction, in two cases with rolling resistance."""
    return reference.chain(case).replace(friction=CapstanFriction(0.15, 0.05, rolling=0.2 if number in (1, 4) else 0.0))


def commands(case, given):
    """Tensions or lengths of five steps, there and back."""
    rng, law = np.random.default_rng(len(case["tendons"])), case["law"]
    base = np.array(law["low"] if given == "tensions" else law["command"], float)
    changes = rng.uniform(-0.4, 0.4, (STEPS, len(base)))
    return base * (1.0 + changes) if given == "tensions" else base + changes


def history(state):
    """The state of one step as that of a batch of one row."""
    return FrictionState(*(np.asarray(array)[None] for array in state))


@pytest.mark.parametrize("number", range(len(CASES)))
def test_steps_of_reference_chains_obey_the_laws_of_friction_and_balance(number):
    """Gap tensions, states, slips and the balance of joints and links, from curvatures and holes alone."""
    case = CASES[number]
    chain, loads, given = rubbed(case, number), reference.loads(case), case["given"]
    solve, before, moved = solve_tensions if given == "tensions" else solve_lengths, reference.solved(case), 0.0
    before = solve(chain, commands(case, given)[0], loads, before)
    for inputs in commands(case, given):
        at = solve(chain, inputs, loads, before, history=before)
        assert at.status in (Status.CONVERGED, Status.AT_LIMIT)
        table = spatial_load_table(loads, chain.n_links)[None]
        past, start = history(before.friction_state), np.array(before.joint_angles)[None]
        step = Case(chain, given, inputs[None], table, start, (0.0, np.inf), past)
        faults, checked = step.faults(step.solve(), np.zeros(1, bool))
        assert not faults and checked == 1
        moved = max(moved, np.abs(at.gap_tensions - np.where(at.gap_tensions > 0, at.tensions, 0.0)).max())
        before = at
    assert moved > 0.05  # N that friction takes


@pytest.mark.parametrize("number", [1, 4, 7])
def test_rows_of_a_batch_of_steps_are_single_steps_to_the_last_bit(number):
    rng, case = np.random.default_rng(number), CASES[number]
    chain, loads, rows = rubbed(case, number), reference.loads(case), 6
    pulls = rng.uniform(1.0, 4.0, (3, rows, chain.n_tendons))
    batch = solve_tensions_batch(chain, pulls[0], loads)
    singles = [solve_tensions(chain, row, loads) for row in pulls[0]]
    for inputs in pulls[1:]:
        batch = solve_tensions_batch(chain, inputs, loads, batch, history=batch)
        for row, single in enumerate(singles):
            singles[row] = single = solve_tensions(chain, inputs[row], loads, single, history=single)
            for name in FIELDS:
                assert np.array_equal(getattr(batch.row(row), name), getattr(single, name)), name
            for one, other in zip(batch.friction_state.row(row), single.friction_state, strict=True):
                assert np.array_equal(one, other)
