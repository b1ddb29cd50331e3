"""How far one driver reaches: python benchmarks/scaling.py [--cluster auto].

The real driver hands 100,000 units to 1,000 workers that only sleep: as long as recorded trainings took, times a number
that gives them a mean. With --cluster units that do nothing go through Ray, so that what is left is overhead. Figures
on docs/scaling.md are from here.
"""

from __future__ import annotations

import argparse
import heapq
import itertools
import json
import resource
import threading
import time
from concurrent.futures import Future
from pathlib import Path

from agents.executors.driver import Unit, work_through
from agents.executors.options import LOCAL, executor_of
from agents.executors.progress import Progress
from rollingjoint.tables import markdown_table

RECORDED = Path(__file__).parent / "training_seconds.json"
MEAN_SECONDS = (2.0, 1.0, 0.5, 0.2, 0.1)


def recorded_seconds() -> list[float]:
    """Wall times of the trainings of a campaign [s]."""
    times: list[float] = json.loads(RECORDED.read_text())["seconds"]
    return times


class SleepingWorkers:
    """An executor whose workers sleep for as long as their unit says; one thread wakes them all."""

    def __init__(self, slots: int) -> None:
        self.slots = slots
        self.asleep: list[tuple[float, int, Future[float]]] = []
        self.count = itertools.count()
        self.changed = threading.Condition()
        threading.Thread(target=self.wake, daemon=True).start()

    def submit(self, function, *arguments):
        """The future of function(*arguments), which returns the seconds to sleep."""
        seconds, future = function(*arguments), Future()
        with self.changed:
            heapq.heappush(self.asleep, (time.monotonic() + seconds, next(self.count), future))
            if self.asleep[0][2] is future:
                self.changed.notify()
        return future

    def wake(self) -> None:
        """End units when their time has come."""
        while True:
            with self.changed:
                left = self.asleep[0][0] - time.monotonic() if self.asleep else None
                if left is None or left > 0:
                    self.changed.wait(left)
                    continue
                _, _, future = heapq.heappop(self.asleep)
            future.set_result(None)

    def cancel(self, future) -> None:
        """Nothing: nobody stops a simulation."""

    def shutdown(self) -> None:
        """Nothing."""


def seconds_of(seconds: float) -> float:
    """What a unit of the simulation does."""
    return seconds


def nothing() -> None:
    """What a unit does whose overhead is measured."""


def simulated(count: int, workers: int, mean: float) -> list[str]:
    """A row: wall time, share of it in which workers worked, processor time of the driver per unit, memory."""
    times = recorded_seconds()
    scale = mean * len(times) / sum(times)
    units = (Unit(str(i), seconds_of, (scale * times[i % len(times)],)) for i in range(count))
    begun, used = time.monotonic(), time.process_time()
    with Progress(count, "unit") as progress:
        done = sum(not ended.failure for ended in work_through(SleepingWorkers(workers), units, progress, []))
    wall, used = time.monotonic() - begun, time.process_time() - used
    assert done == count
    memory = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    share = mean * count / workers / wall
    return [
        f"{mean:g}",
        f"{wall:.1f}",
        f"{100 * share:.0f} %",
        f"{count / wall:,.0f}",
        f"{1e6 * used / count:.0f}",
        f"{memory:.0f}",
    ]


def overhead(cluster: str, jobs: int, count: int) -> list[str]:
    """A row: units per second that do nothing, processor time of the driver per unit."""
    with executor_of(cluster, jobs) as executor, Progress(count, "unit") as progress:
        warm = [Unit(str(i), nothing) for i in range(2 * executor.slots)]
        list(work_through(executor, warm, Progress(0, "unit").__enter__(), []))
        begun, used = time.monotonic(), time.process_time()
        units = (Unit(str(i), nothing) for i in range(count))
        done = sum(not ended.failure for ended in work_through(executor, units, progress, []))
        wall, used = time.monotonic() - begun, time.process_time() - used
        assert done == count
        return [
            cluster,
            str(executor.slots),
            f"{count / wall:,.0f}",
            f"{1e3 * wall / count:.2f}",
            f"{1e3 * used / count:.2f}",
        ]


def main() -> None:
    parser = argparse.ArgumentParser(description="How far one driver reaches.")
    parser.add_argument("--units", type=int, default=100_000)
    parser.add_argument("--workers", type=int, default=1_000)
    parser.add_argument("--mean", type=float, nargs="*", default=MEAN_SECONDS, help="mean seconds of a unit")
    parser.add_argument("--overhead", type=int, default=2_000, help="units that do nothing; 0: do not measure them")
    parser.add_argument("--cluster", default=LOCAL)
    parser.add_argument("--jobs", type=int, default=2)
    arguments = parser.parse_args()
    if arguments.overhead:
        head = ["cluster", "workers", "units/s", "ms per unit", "ms of the driver's processor per unit"]
        print(markdown_table(head, [overhead(arguments.cluster, arguments.jobs, arguments.overhead)]), flush=True)
        print()
    head = ["mean unit [s]", "wall [s]", "workers busy", "units/s", "driver [µs/unit]", "memory [MB]"]
    rows = [simulated(arguments.units, arguments.workers, mean) for mean in arguments.mean]
    if rows:
        print(markdown_table(head, rows))


if __name__ == "__main__":
    main()
