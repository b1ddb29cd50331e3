"""Threads: the same numbers on any count of them, in any process."""

import subprocess
import sys
import threading

import numpy as np
import pytest

from rollingjoint import InvalidInput, Status, WorldForce, five_link, set_threads, solve_lengths_batch
from rollingjoint.threads import run_in_threads

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


def test_results_do_not_depend_on_the_number_of_threads_or_the_size_of_the_batch():
    chain, rng = five_link(), np.random.default_rng(0)
    lengths = chain.neutral_lengths + rng.uniform(-6, 2, (1000, 2))
    lengths[33] = np.nan
    loads = [WorldForce(-1, (0.4, -0.2))]
    runs = []
    for threads in (1, 2, 3):
        set_threads(threads)
        runs.append(solve_lengths_batch(chain, lengths, loads))
    set_threads(2)
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
    set_threads(2)
    assert names == {threading.current_thread().ident}


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
