"""Ctrl-C ends every long call at once, and what cannot end at once ends in a stated time (docs/reliability.md)."""

import itertools
import os
import signal
import sys
import threading
import time

import numpy as np
import pytest

from rollingjoint import (
    BodyWrench,
    CapstanFriction,
    Status,
    five_link,
    set_threads,
    small_arm,
    solve_lengths,
    solve_lengths_batch,
    solve_tensions,
    solve_tensions_batch,
    trace,
    uniform,
)
from rollingjoint.chain import batch
from rollingjoint.statics import slot
from rollingjoint.threads import run_in_threads

pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="sends itself SIGINT")


class CtrlCWithin:
    """Work during whose call of this number, on any thread, another thread presses Ctrl-C."""

    def __init__(self, work, call):
        self._work, self._call, self._caller, self._numbers = work, call, threading.get_ident(), itertools.count(1)
        self.pressed, self.ended = threading.Event(), threading.Event()
        self.begun_afterwards = 0  # calls on the caller's thread
        self.longest = 0.0  # s of processor time of its thread

    def __call__(self, *arguments):
        self.begun_afterwards += self.pressed.is_set() and threading.get_ident() == self._caller
        if next(self._numbers) == self._call:
            threading.Thread(target=self._press).start()
        begin = time.thread_time()
        self._work(*arguments)
        self.longest = max(self.longest, time.thread_time() - begin)
        self.ended.set()

    def _press(self):
        os.kill(os.getpid(), signal.SIGINT)
        self.pressed.set()


@pytest.fixture(autouse=True)
def two_threads_afterwards():
    yield
    set_threads(2)


@pytest.mark.parametrize("threads", [1, 2])
def test_ctrl_c_ends_a_large_batch_after_the_pieces_in_work(threads, monkeypatch):
    arm, tensions = small_arm(8), np.random.default_rng(0).uniform(0.1, 10.0, (50_000, 4))
    set_threads(threads)
    solve_tensions_batch(arm, tensions[:1])
    begun, pinned = [], batch.PinnedRange
    monkeypatch.setattr(batch, "PinnedRange", lambda *inputs: begun.append(CtrlCWithin(pinned(*inputs), 3)) or begun[0])
    with pytest.raises(KeyboardInterrupt):
        solve_tensions_batch(arm, tensions)
    (pieces,) = begun
    assert pieces.begun_afterwards <= 1 and pieces.longest < 0.25


def test_ctrl_c_does_not_wait_for_the_solve_of_a_long_chain(monkeypatch):
    chain, force = uniform(150), np.random.default_rng(1).normal(0.0, 1.0, 2)
    solve_tensions(uniform(20), (1.0, 1.0), [BodyWrench(-1, (1e-3, 0.0))])
    _ = chain.arrays
    solves, pinned = [], slot.PinnedRange
    monkeypatch.setattr(
        slot, "PinnedRange", lambda *inputs: solves.append(CtrlCWithin(pinned(*inputs), 1)) or solves[0]
    )
    with pytest.raises(KeyboardInterrupt):
        solve_tensions(chain, (3.0, 7.0), [BodyWrench(-1, tuple(force))])  # half a second
    assert not solves[0].ended.is_set()
    monkeypatch.undo()
    assert solve_tensions(five_link(), (1.0, 1.0)).ok
    light = (1.0, 1.0), [BodyWrench(-1, (1e-3, 0.0))]  # in other memory than that which is still written into
    assert np.array_equal(solve_tensions(chain, *light).poses, solve_tensions(uniform(150), *light).poses)
    assert solves[0].ended.wait(60)


def test_pieces_cover_every_row_once_and_grow_while_they_are_brief():
    for rows, joints, threads in ((100_000, 4, 1), (100_000, 4, 3), (7, 4, 2), (5, 200, 2), (1, 200, 1), (1, 4, 1)):
        set_threads(threads)
        covered, pieces = np.zeros(rows, int), []

        def work(first, last, covered=covered, pieces=pieces):
            covered[first:last] += 1
            pieces.append(last - first)

        run_in_threads(work, rows, joints)
        assert np.all(covered == 1)
    set_threads(1)
    run_in_threads(lambda first, last: pieces.append(last - first), 1_000_000, 4)
    assert max(pieces) > 4 * pieces[-2] or len(pieces) < 40


def test_batches_are_the_same_to_the_last_bit_however_they_are_cut(monkeypatch):
    from rollingjoint import threads

    chain = five_link()
    lengths = chain.neutral_lengths + np.random.default_rng(0).uniform(-6, 2, (3000, 2))
    whole = solve_lengths_batch(chain, lengths)
    monkeypatch.setattr(threads, "_JOINTS_OF_A_PIECE", 40)
    monkeypatch.setattr(threads, "_BRIEF", 0.0)
    parts = solve_lengths_batch(chain, lengths)
    for name in ("poses", "tensions", "status"):
        assert np.array_equal(getattr(parts, name), getattr(whole, name))


@pytest.mark.parametrize("build", [uniform, small_arm])
def test_a_follower_force_on_more_than_a_thousand_joints_is_given_up_at_once(build):
    chain, force = build(1002), (0.1, 0.0) if build is uniform else (0.1, 0.0, 0.0)
    solve_tensions(build(20), np.ones(chain.n_tendons), [BodyWrench(-1, force)])  # compiled
    _ = chain.arrays
    begin = time.process_time()
    result = solve_tensions(chain, np.ones(chain.n_tendons), [BodyWrench(-1, force)])
    assert time.process_time() - begin < 30.0  # takes 1 to 3
    assert result.status is Status.NOT_CONVERGED and result.iterations == 0
    balanced = solve_tensions(chain, np.ones(chain.n_tendons), [BodyWrench(-1, (0.0,) * (len(force) - 1) + (0.1,))])
    assert balanced.status is Status.NOT_CONVERGED and balanced.residual < 1e-9


@pytest.mark.slow
@pytest.mark.parametrize("beads", [200, 300])
def test_a_follower_force_on_a_long_arm_takes_a_bounded_number_of_dense_steps(beads):
    """These steps take the seconds of docs/reliability.md: 24 and 39 before the bound, 10 and 11 with it."""
    arm, rng = small_arm(beads), np.random.default_rng(0)
    tensions, force = rng.uniform(0.1, 10, 4), rng.normal(0, 1.0, 3)
    result = solve_tensions(arm, tensions, [BodyWrench(-1, tuple(force))])
    assert 0 < result.iterations < 1000 * (300 / beads) ** 3 + 600


WHILE_LAPACK_IS_IMPORTED = """
import signal, sys
import numpy as np
from rollingjoint import solve_tensions_batch, two_segment

class PressesCtrlC:
    def find_spec(self, name, path=None, target=None):
        if name.startswith("scipy.linalg"):
            sys.meta_path.remove(self)
            signal.raise_signal(signal.SIGINT)

sys.meta_path.insert(0, PressesCtrlC())
rng = np.random.default_rng(0)
tensions = rng.uniform(0, 3, (300, 4)) * (rng.random((300, 4)) < 0.5)  # slack: LAPACK is asked for eigenvalues
try:
    solve_tensions_batch(two_segment(), tensions)
except KeyboardInterrupt:
    print("interrupted")
print(len(solve_tensions_batch(two_segment(), tensions).status))
"""


@pytest.mark.slow
def test_ctrl_c_while_lapack_is_imported_is_no_fatal_error(run_python):
    assert run_python("-c", WHILE_LAPACK_IS_IMPORTED) == "interrupted\n300\n"


def callees(call):
    """What a call calls in Python: file name, function name and text of its arguments."""
    seen = []

    def look(frame, event, argument):
        if event == "call":
            code = frame.f_code
            values = [str(frame.f_locals.get(name)) for name in code.co_varnames[1 : code.co_argcount]]
            seen.append((code.co_filename, code.co_name, values))

    call()  # whatever is made once
    sys.setprofile(look)
    try:
        call()
    finally:
        sys.setprofile(None)
    return seen


def calls_of_compiled_code():
    chain, arm = five_link(), small_arm()
    lengths, tensions = chain.neutral_lengths - 1.0, np.ones(arm.n_tendons)
    bent, batch = solve_lengths(chain, lengths), solve_lengths_batch(chain, [lengths] * 3)
    rubbing = chain.replace(friction=CapstanFriction(0.1, 0.05))
    return {
        "poses": lambda: chain.poses(bent.joint_angles),
        "tendon lengths": lambda: chain.tendon_lengths(bent.joint_angles),
        "arc lengths": lambda: chain.arc_lengths(bent.joint_angles),
        "a solve": lambda: (solve_lengths(chain, lengths).smallest_eigenvalue, batch.row(1).smallest_eigenvalue),
        "what a solve returns": lambda: (
            bent.ok,
            repr(bent),
            bent.require(),
            solve_lengths(chain, lengths).arc_lengths,
        ),
        "a batch": lambda: (solve_lengths_batch(chain, [lengths] * 3).smallest_eigenvalue, batch.ok, repr(batch)),
        "an arm": lambda: solve_tensions(arm, tensions).smallest_eigenvalue,
        "a path with friction": lambda: trace(rubbing, [lengths, lengths - 0.1]).stiffness,
    }


@pytest.mark.parametrize("name", calls_of_compiled_code())
def test_nothing_that_drops_exceptions_runs_python_code(name):
    """numba drops what is raised while it makes arrays, NumPy what is raised while it looks at the class of an enum."""
    called = callees(calls_of_compiled_code()[name])
    assert called
    for file, function, arguments in called:
        assert function != "_numba_unpickle", file
        assert not (function == "__getattr__" and any(word.startswith("__array") for word in arguments)), arguments
