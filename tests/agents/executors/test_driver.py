"""Units on the executors of one machine: values, failures, lost workers, Ctrl-C, folders that travel."""

import os
import subprocess
import sys
import threading
import time
from contextlib import ExitStack, contextmanager
from pathlib import Path
from signal import SIGINT

import pytest

from agents.executors import driver, folders, local, options
from agents.executors.driver import RETRIES, Unit, work_through
from agents.executors.folders import FolderUnit, marked
from agents.executors.local import InlineExecutor, LocalExecutor
from agents.executors.progress import Progress
from agents.executors.protocol import UnitFailed, UnitStopped
from agents.runs.command_line import exit_code, signals_seen
from agents.runs.locks import alone_in, file_lock
from rollingjoint.errors import ConfigError
from tests.agents.executors import units
from tests.agents.forked import CONTEXT
from tests.conftest import sources_first


@pytest.fixture
def executor(monkeypatch):
    """Two processes, forked from one that has imported everything."""
    monkeypatch.setattr(local, "get_context", lambda method: CONTEXT)
    made = LocalExecutor(2)
    yield made
    made.shutdown()


def worked(executor, *given, signals=None):
    """Values by name, failures by name, and the display."""
    with Progress(len(given), "unit") as progress:
        ended = list(work_through(executor, given, progress, [] if signals is None else signals))
    values = {one.unit.name: one.value for one in ended if not one.failure}
    return values, {one.unit.name: one.failure for one in ended if one.failure}, progress


def test_values_come_back_and_a_failure_is_one_line_that_is_not_tried_again(executor, tmp_path):
    some = [Unit(f"unit {i}", units.double, (i,)) for i in range(5)]
    values, failures, progress = worked(executor, *some, Unit("bad", units.fail, (tmp_path,)))
    assert values == {f"unit {i}": 2 * i for i in range(5)}
    assert failures == {"bad": "ValueError('two\\nlines')"}
    assert (tmp_path / "calls").read_text() == "x"
    assert (progress.done, progress.failed, progress.lost, progress.running) == (5, 1, 0, 0)


def test_the_error_of_a_unit_keeps_the_traceback(tmp_path):
    future = InlineExecutor().submit(units.fail, tmp_path)
    with pytest.raises(UnitFailed) as caught:
        future.result()
    assert "units.py" in caught.value.__notes__[0]


@pytest.mark.slow
def test_a_unit_whose_worker_is_killed_is_tried_again_elsewhere(executor, tmp_path, capsys):
    values, failures, progress = worked(
        executor, Unit("hit", units.die, (tmp_path, 2)), Unit("other", units.double, (4,))
    )
    assert (values, failures) == ({"hit": 3, "other": 8}, {})
    assert progress.lost == 2
    assert "hit: its process was ended by SIGKILL" in capsys.readouterr().out


def test_a_unit_that_kills_every_worker_fails_in_the_end(executor, tmp_path):
    values, failures, progress = worked(executor, Unit("hit", units.die, (tmp_path, 99)))
    assert values == {} and "the same command goes on with it" in failures["hit"]
    assert len((tmp_path / "calls").read_text()) == RETRIES + 1 == progress.lost + 1


def test_ctrl_c_lets_running_units_save_and_begins_no_other(executor, tmp_path):
    given = [Unit(name, units.wait_for_interrupt, (tmp_path, name)) for name in "abcd"]
    signals = []

    def interrupt():
        while len(list(tmp_path.glob("*.runs"))) < 2:
            time.sleep(0.02)
        signals.append(SIGINT)

    thread = threading.Thread(target=interrupt)
    thread.start()
    values, failures, _ = worked(executor, *given, signals=signals)
    thread.join()
    assert (values, failures) == ({}, {})
    assert sorted(path.name for path in tmp_path.iterdir()) == ["a.runs", "a.saved", "b.runs", "b.saved"]


def test_a_worker_is_used_again_after_its_unit_was_stopped(monkeypatch, tmp_path):
    monkeypatch.setattr(local, "get_context", lambda method: CONTEXT)
    executor = LocalExecutor(1)
    running = executor.submit(units.wait_for_interrupt, tmp_path, "a")
    waiting = executor.submit(units.double, 1)
    while not (tmp_path / "a.runs").exists():
        time.sleep(0.02)
    executor.cancel(waiting)
    executor.cancel(running)
    assert type(running.exception()) is type(waiting.exception()) is local.UnitStopped
    assert executor.submit(units.double, 2).result() == 4
    executor.shutdown()


def wait_for(condition, seconds=30.0):
    until = time.monotonic() + seconds
    while not condition() and time.monotonic() < until:
        time.sleep(0.02)
    assert condition()


def test_a_unit_that_is_stopped_before_it_begins_never_does_and_takes_no_time(executor):
    future = executor.submit(units.double, units.SlowToArrive())
    wait_for(lambda: executor._busy)
    begin = time.monotonic()
    executor.cancel(future)
    assert type(future.exception(30)) is UnitStopped
    assert time.monotonic() - begin < 20
    assert executor.submit(units.double, 2).result() == 4


def test_an_interrupt_between_two_units_stops_neither(executor):
    assert executor.submit(units.double, 1).result() == 2
    (worker,) = executor._idle
    os.kill(worker._process.pid, SIGINT)
    assert executor.submit(units.double, 2).result() == 4
    assert executor._idle == [worker]


def test_shutdown_stops_what_is_left(monkeypatch, tmp_path):
    monkeypatch.setattr(local, "get_context", lambda method: CONTEXT)
    executor = LocalExecutor(1)
    running = executor.submit(units.wait_for_interrupt, tmp_path, "a")
    waiting = executor.submit(units.wait_for_interrupt, tmp_path, "b")
    wait_for(lambda: (tmp_path / "a.runs").exists())
    executor.shutdown()
    assert type(running.exception()) is type(waiting.exception()) is UnitStopped
    assert sorted(path.name for path in tmp_path.iterdir()) == ["a.runs", "a.saved"]


def test_a_unit_that_swallows_its_interrupt_is_ended_with_its_process(executor, tmp_path):
    future = executor.submit(units.swallow_ctrl_c, tmp_path)
    wait_for(lambda: (tmp_path / "begun").exists())
    begin = time.monotonic()
    executor.cancel(future)
    assert type(future.exception(50)) is UnitStopped
    assert time.monotonic() - begin < 30


def test_ctrl_c_stops_a_unit_in_this_process_too():
    with signals_seen() as signals:
        future = InlineExecutor().submit(units.press_ctrl_c)
    assert type(future.exception()) is UnitStopped and not signals


FIRST = """
import signal
from multiprocessing import resource_tracker
from agents.executors.local import _interrupts_blocked

with _interrupts_blocked():
    resource_tracker.getfd()  # as the first process that is started does
    print(signal.SIGINT in signal.pthread_sigmask(signal.SIG_BLOCK, []))
"""


@pytest.mark.slow
def test_the_first_process_is_started_with_interrupts_blocked_too(run_python):
    assert run_python("-c", FIRST) == "True\n"


PARENT = """
import time
from agents.executors.local import LocalExecutor
from tests.agents.executors import units

executor = LocalExecutor(1)
executor.submit(units.double, units.SlowToArrive())
while not executor._busy:
    time.sleep(0.02)
(worker,) = executor._busy.values()
print(worker._process.pid, flush=True)
time.sleep(60)
"""


@pytest.mark.slow  # imports twice
@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="reads /proc")
def test_a_process_whose_parent_is_killed_before_its_unit_begins_ends():
    with subprocess.Popen([sys.executable, "-c", PARENT], env=sources_first(), stdout=subprocess.PIPE) as parent:
        worker = int(parent.stdout.readline())
        parent.kill()
    wait_for(lambda: not runs(worker))


def runs(pid):
    try:
        os.kill(pid, 0)
    except ProcessLookupError:
        return False
    return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] != "Z"


def test_libraries_of_workers_use_one_thread(executor):
    assert set(executor.submit(units.threads).result().values()) == {"1"}


def test_what_does_not_pickle_is_a_failure(executor):
    _, failures, _ = worked(executor, Unit("lambda", lambda: 1), Unit("good", units.double, (1,)))
    assert "pickle" in failures["lambda"]


@pytest.fixture
def elsewhere(monkeypatch):
    """Machines that do not see the folder."""
    monkeypatch.setattr(folders.Home, "is_here", False)


def counting(home, step=1, function=units.count_in):
    return FolderUnit("unit", function, (step,), home, "group/one")


@pytest.mark.parametrize("place", ["here", "elsewhere"])
def test_a_folder_holds_the_same_wherever_its_unit_ran(place, request, tmp_path):
    if place == "elsewhere":
        request.getfixturevalue(place)
    folder = tmp_path / "group/one"
    folder.mkdir(parents=True)
    (folder / "count").write_text("40")
    with marked(tmp_path) as home:
        assert worked(InlineExecutor(), counting(home, 2))[0] == {"unit": 42}
    assert (folder / "count").read_text() == "42"
    assert folder.with_name("one.log").read_text() == "counted"
    assert sorted(path.name for path in tmp_path.rglob("*")) == ["count", "group", "one", "one.log"]


def count_alone(folder, step):
    """Count, alone in the folder."""
    with alone_in(folder, "run", "one in which nobody counts"):
        return units.count_in(folder, step)


@contextmanager
def somebody_in(folder, seconds):
    """The lock of the folder is held inside, by another, for so long at most."""
    folder.mkdir(parents=True)
    held = ExitStack()
    held.enter_context(file_lock(folder / "lock"))
    timer = threading.Timer(seconds, held.close)
    timer.start()
    yield
    timer.cancel()
    held.close()


def test_a_first_attempt_waits_for_a_process_that_is_about_to_end_and_says_so(tmp_path, capsys):
    with somebody_in(tmp_path / "group/one", 0.3), marked(tmp_path) as home:
        assert worked(InlineExecutor(), counting(home, 2, count_alone))[0] == {"unit": 2}
    assert capsys.readouterr().out == "unit: another process works in its folder; waiting for up to 30 s\n"


def test_a_first_attempt_gives_up_when_the_time_is_over(tmp_path, monkeypatch):
    monkeypatch.setattr(folders, "FIRST_WAIT", 0.3)
    with somebody_in(tmp_path / "group/one", 60.0), marked(tmp_path) as home:
        values, failures, _ = worked(InlineExecutor(), counting(home, 2, count_alone))
    assert values == {} and failures["unit"].endswith("one in which nobody counts. Wait for it to end, or stop it.")
    assert not (tmp_path / "group/one/count").exists()


def fail_midway(folder, step):
    units.count_in(folder, step)
    raise OSError("no space left")


def test_of_a_unit_that_fails_elsewhere_nothing_travels_home(elsewhere, tmp_path):
    (tmp_path / "group/one").mkdir(parents=True)
    with marked(tmp_path) as home:
        _, failures, _ = worked(InlineExecutor(), counting(home, function=fail_midway))
    assert failures == {"unit": "no space left"}
    assert list((tmp_path / "group").iterdir()) == [tmp_path / "group/one"]
    assert list((tmp_path / "group/one").iterdir()) == []


def test_a_folder_that_cannot_be_unpacked_leaves_the_old_one(tmp_path):
    (tmp_path / "one").mkdir()
    (tmp_path / "one/count").write_text("1")
    parcel = folders.pack(tmp_path, "one")
    with pytest.raises((OSError, folders.tarfile.TarError)):
        folders.unpack(parcel[:600], tmp_path, "one")
    assert (tmp_path / "one/count").read_text() == "1" and len(list(tmp_path.iterdir())) == 1


def test_a_display_without_a_terminal_is_a_plain_line_now_and_then(monkeypatch, capsys):
    clock = [0.0]
    monkeypatch.setattr("agents.executors.progress.time.monotonic", lambda: clock[0])
    with Progress(10, "run") as progress:
        clock[0], progress.done, progress.failed, progress.running = 10.0, 3, 1, 2
        progress.show()
        clock[0] = 40.0
        progress.show()
    assert capsys.readouterr().err == "3 of 10 runs done, 2 running, 1 failed, 6/min, about 1 min 00 s left\n"


@pytest.mark.parametrize(
    ("cluster", "jobs", "complaint"),
    [
        ("local", 0, "--jobs = 0"),
        ("ray://head:1", 1, "HOST:PORT"),
        ("head", 1, "HOST:PORT"),
    ],
)
def test_what_names_no_executor_is_refused(cluster, jobs, complaint):
    with pytest.raises(ConfigError, match=complaint), options.executor_of(cluster, jobs):
        pass


def test_without_ray_the_line_names_its_extra(monkeypatch, tmp_path, capsys):
    monkeypatch.setitem(sys.modules, "ray", None)

    def command():
        with options.executor_of("127.0.0.1:1"):
            return 0

    assert exit_code(command) == 2
    assert capsys.readouterr().err.endswith('ray is not installed: run pip install "rollingjoint[cluster]"\n')


class Refused(Unit):
    def call(self, attempt):
        raise ConfigError("folder", "unit", "one that can be used")


def test_units_that_cannot_begin_fail_alone():
    given = [Refused("first", units.double), Unit("second", units.double, (2,)), Refused("third", units.double)]
    values, failures, progress = worked(InlineExecutor(), *given)
    assert (values, failures.keys(), progress.failed) == ({"second": 4}, {"first", "third"}, 2)


def test_the_driver_waits_no_longer_than_it_has_units():
    assert worked(InlineExecutor())[0] == {} and driver.POLL < 1


def test_units_can_depend_on_what_has_ended_and_parts_do_not_count(executor):
    """Every unit but the last asks for the next; none is ready before."""
    ready = [Unit("1", units.double, (1,), is_part=True)]

    def given():
        while ready is not None:
            yield ready.pop() if ready else None

    with Progress(1, "unit") as progress:
        values = []
        for ended in work_through(executor, given(), progress, []):
            values.append(ended.value)
            if ended.value < 8:
                ready.append(Unit("next", units.double, (ended.value,), is_part=ended.value < 4))
            else:
                ready = None
    assert values == [2, 4, 8] and progress.done == 1
