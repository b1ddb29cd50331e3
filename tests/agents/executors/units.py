"""What units of the tests do; workers import it."""

import contextlib
import os
import signal
import time
from pathlib import Path


def double(number):
    return 2 * number


def fail(folder):
    with (folder / "calls").open("a") as calls:
        calls.write("x")
    raise ValueError("two\nlines")


def die(folder, times):
    """Kill this process the first few times; how often it was called."""
    with (folder / "calls").open("a") as calls:
        calls.write("x")
    called = len((folder / "calls").read_text())
    if called <= times:
        os.kill(os.getpid(), signal.SIGKILL)
    return called


def wait_for_interrupt(folder, name):
    """Run until SIGINT; say when it begins and that it saved."""
    seen = []
    before = signal.signal(signal.SIGINT, lambda number, frame: seen.append(number))
    (folder / f"{name}.runs").touch()
    until = time.monotonic() + 60
    while not seen and time.monotonic() < until:
        time.sleep(0.02)
    signal.signal(signal.SIGINT, before)
    (folder / f"{name}.saved").touch()
    raise KeyboardInterrupt


def count_in(folder: Path, step: int) -> int:
    """Add to a count in the folder, and a line to the log beside it."""
    count = folder / "count"
    total = (int(count.read_text()) if count.exists() else 0) + step
    count.write_text(str(total))
    folder.with_name(f"{folder.name}.log").write_text("counted")
    return total


def threads():
    """Settings of this process that let libraries use one thread."""
    return {name: os.environ.get(name) for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")}


def busy(seconds):
    time.sleep(seconds)
    return os.getpid()


class SlowToArrive:
    """An argument that takes a minute to unpickle: a process that has it does not begin its unit before."""

    def __reduce__(self):
        return time.sleep, (60.0,)


def press_ctrl_c():
    signal.raise_signal(signal.SIGINT)
    return "went on"


def swallow_ctrl_c(folder):
    """Go on for a minute whatever is raised."""
    (folder / "begun").touch()
    until = time.monotonic() + 60
    while time.monotonic() < until:
        with contextlib.suppress(KeyboardInterrupt):
            time.sleep(60)
