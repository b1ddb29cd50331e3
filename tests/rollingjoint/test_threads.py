"""Threads: the same numbers on any count of them, in any process, and none that works on after the call has ended."""

import inspect
import itertools
import os
import signal
import subprocess
import sys
import threading
import time

import numpy as np
import pytest

from rollingjoint import InvalidInput, Status, WorldForce, five_link, set_threads, solve_lengths_batch, threads
from rollingjoint.threads import run_in_threads

SHORT, LONG = 4, 2000  # joints: in pieces on this thread and waiting ones, or row by row on threads of its own
CASES = pytest.mark.parametrize(("rows", "joints"), [(40_000, SHORT), (40, LONG)], ids=["short", "long"])

FORKED = """
import multiprocessing
import numpy as np
from rollingjoint import five_link, set_threads, solve_lengths_batch

chain = five_link()
lengths = chain.neutral_lengths - np.linspace(0, 3, 1000)[:, None] * [1.0, 0.5]

def solve(_):
    return solve_lengths_batch(chain, lengths).poses

if __name__ == "__main__":
    set_threads(2)
    expected = solve(0)
    with multiprocessing.get_context("fork").Pool(2) as pool:
        print(all(np.array_equal(poses, expected) for poses in pool.map(solve, range(4))))
"""


@pytest.fixture(autouse=True)
def two_threads_afterwards():
    yield
    set_threads(2)


class Work:
    """Work that takes a moment a piece, and keeps which pieces were begun, and which of them are at work."""

    def __init__(self, seconds=0.001):
        self.begun, self.running, self._seconds = [], set(), seconds

    def __call__(self, first, last):
        self.begun.append(first)
        self.running.add(first)
        try:
            time.sleep(self._seconds)
        finally:
            self.running.remove(first)


class CtrlCAt:
    """KeyboardInterrupt as this thread comes to an instruction of threads.py, or has just started a thread.

    Which of these moments is counted from 0.
    """

    _LINES, _FIRST = inspect.getsourcelines(threading.Thread.start)
    _STARTED = _FIRST + next(i for i, line in enumerate(_LINES) if "_started.wait" in line)

    def __init__(self, moment):
        self._left = moment

    def __enter__(self):
        self._before = sys.gettrace()
        sys.settrace(self._enter)

    def __exit__(self, *_):
        sys.settrace(self._before)

    def _enter(self, frame, event, argument):
        if frame.f_code.co_filename == threads.__file__:
            frame.f_trace_opcodes, frame.f_trace_lines = True, False
            return self._count
        return self._count_started if frame.f_code is threading.Thread.start.__code__ else None

    def _count(self, frame, event, argument):
        self._left -= event in ("opcode", "line")
        if self._left < 0:
            sys.settrace(None)
            time.sleep(0.0003)  # jobs begin
            raise KeyboardInterrupt
        return self._count

    def _count_started(self, frame, event, argument):
        if frame.f_lineno == self._STARTED:
            self._count(frame, event, argument)
        return self._count_started


def test_results_do_not_depend_on_the_number_of_threads_or_the_size_of_the_batch():
    chain, rng = five_link(), np.random.default_rng(0)
    lengths = chain.neutral_lengths + rng.uniform(-6, 2, (1000, 2))
    lengths[33] = np.nan
    loads = [WorldForce(-1, (0.4, -0.2))]
    runs = []
    for count in (1, 2, 3):
        set_threads(count)
        runs.append(solve_lengths_batch(chain, lengths, loads))
    for run in runs[1:]:
        assert np.array_equal(run.poses, runs[0].poses)
        assert np.array_equal(run.status, runs[0].status)
    part = solve_lengths_batch(chain, lengths[30:40], loads)
    assert np.array_equal(part.poses, runs[0].poses[30:40])
    assert part.status[3] == Status.INVALID_INPUT


def test_work_is_spread_over_threads_where_it_is_worth_it():
    covered, names = np.zeros(1000, int), set()

    def work(first, last):
        covered[first:last] += 1
        names.add(threading.current_thread().ident)

    set_threads(3)
    run_in_threads(work, 1000, 4)
    assert np.all(covered == 1)
    assert len(names) >= 2  # the third may have taken over a second piece
    names.clear()
    run_in_threads(work, 100, 4)
    assert names == {threading.current_thread().ident}


def test_calls_for_different_numbers_of_threads_share_those_that_wait():
    before = set(threading.enumerate())
    for count in (7, 2, 3, 5, 4, 6, 7):
        set_threads(count)
        run_in_threads(Work(), 40_000, SHORT)
    assert len(set(threading.enumerate()) - before) <= 6


def test_an_error_on_any_thread_reaches_the_caller_and_the_next_call_works():
    def fail(first, last):
        if first == 0:
            raise ValueError("on another thread")

    set_threads(2)
    with pytest.raises(ValueError, match="on another thread"):
        run_in_threads(fail, 1000, 4)
    seen = []
    run_in_threads(lambda first, last: seen.append((first, last)), 1000, 4)
    assert sorted(seen) == [(0, 500), (500, 1000)]


@CASES
def test_of_errors_on_several_threads_one_is_raised_once_all_have_ended(rows, joints):
    together, work = threading.Barrier(3, timeout=60), Work()

    def fail(first, last):
        together.wait()
        work(first, last)
        raise ValueError(f"from row {first}")

    set_threads(3)
    with pytest.raises(ValueError, match="from row"):
        run_in_threads(fail, rows, joints)
    assert len(work.begun) == 3 and not work.running


@CASES
def test_an_error_ends_the_pieces_of_all_threads(rows, joints):
    done = []

    def fail(first, last):
        if first == 0:
            raise ValueError("at the first row")
        time.sleep(0.001)
        done.append(last - first)

    set_threads(2)
    with pytest.raises(ValueError, match="at the first row"):
        run_in_threads(fail, rows * 10, joints)
    assert sum(done) < rows * 5


@pytest.mark.skipif(sys.platform == "win32", reason="sends itself SIGINT")
@CASES
def test_after_ctrl_c_the_pieces_at_work_are_finished_and_no_others(rows, joints):
    work, finished = Work(0.05), []

    def pressing(first, last):
        if first == 0:  # on another thread than the caller's
            os.kill(os.getpid(), signal.SIGINT)
        work(first, last)
        finished.append(last - first)

    set_threads(3)
    with pytest.raises(KeyboardInterrupt):
        run_in_threads(pressing, rows * 10, joints)
    begun = len(work.begun)
    assert not work.running and 0 < sum(finished) < rows * 10 // 3
    run_in_threads(Work(), rows, joints)
    assert len(work.begun) == begun


@pytest.mark.skipif(sys.platform == "win32", reason="sends itself SIGINT")
def test_ctrl_c_does_not_wait_for_work_that_is_abandoned():
    end, ended = threading.Event(), threading.Event()

    def wait(first, last):
        os.kill(os.getpid(), signal.SIGINT)
        end.wait(10)
        ended.set()

    with pytest.raises(KeyboardInterrupt):
        run_in_threads(wait, 1, LONG, abandon=True)
    assert not ended.is_set()
    end.set()
    assert ended.wait(60)


@pytest.mark.parametrize(("rows", "joints"), [(6000, SHORT), (3, LONG)], ids=["short", "long"])
def test_ctrl_c_at_any_instruction_leaves_no_thread_at_work_and_the_next_call_works(rows, joints):
    set_threads(3)
    for moment in itertools.count():
        work, covered, interrupted = Work(0.002), np.zeros(rows, int), False
        try:
            with CtrlCAt(moment):
                run_in_threads(work, rows, joints)
        except KeyboardInterrupt:
            interrupted = True
        running, begun = len(work.running), len(work.begun)

        def cover(first, last, covered=covered):
            covered[first:last] += 1

        run_in_threads(cover, rows, joints)
        assert (running, len(work.begun)) == (0, begun), f"interrupted at moment {moment}"
        assert np.all(covered == 1)
        if not interrupted:
            break
    assert moment > 100


@pytest.mark.slow
@pytest.mark.skipif(sys.platform == "win32", reason="there is no fork on Windows")
def test_a_forked_process_solves_on_threads_of_its_own(tmp_path):
    program = tmp_path / "forked.py"
    program.write_text(FORKED)
    done = subprocess.run(
        [sys.executable, "-W", "ignore", str(program)], capture_output=True, text=True, timeout=120, check=False
    )
    assert done.stdout == "True\n", done.stderr


@pytest.mark.parametrize("count", [0, -1, 1.5, "two"])
def test_a_thread_count_that_makes_no_sense_is_refused(count):
    with pytest.raises(InvalidInput, match="1 or more"):
        set_threads(count)
