"""The driver: hands units to an executor as it has room, tries lost ones again, stops in good order."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, MutableSequence, Sequence
from concurrent.futures import Future
from dataclasses import dataclass, field
from queue import Empty, SimpleQueue
from signal import SIGINT
from typing import Any, Generic, TypeVar

from agents.executors.progress import Progress
from agents.executors.protocol import Executor, UnitFailed, UnitStopped, WorkerLost
from agents.runs.consent import call_with, consent
from rollingjoint.errors import RollingJointError

POLL = 0.2  # seconds between two looks at signals and display
RETRIES = 3  # of a unit after a lost worker


@dataclass(frozen=True)
class Unit:
    """A unit of work: a name, and a function with arguments.

    Subclasses can change the call after a loss, and the treatment of a result.

    Args:
        note: a line to show when it begins in the place of another.
        is_part: of something larger, which the display counts in its place.
    """

    name: str
    function: Callable[..., Any]
    arguments: tuple[Any, ...] = ()
    note: str = field(default="", kw_only=True)
    is_part: bool = field(default=False, kw_only=True)

    def call(self, attempt: int) -> tuple[Callable[..., Any], tuple[Any, ...]]:
        """Function and arguments of this attempt, 0 for the first; an error raised here fails the unit."""
        return self.function, self.arguments

    def received(self, value: Any) -> Any:
        """The unit's result, from the function's; a Unit: that is done in its place."""
        return value


U = TypeVar("U", bound=Unit)


@dataclass(frozen=True)
class Ended(Generic[U]):
    """A unit that has ended: with its value, or with why it failed in one line (and the error)."""

    unit: U
    value: Any = None
    failure: str = ""
    error: BaseException | None = None


def work_through(
    executor: Executor, units: Iterable[U | None], progress: Progress, signals: MutableSequence[int]
) -> Iterator[Ended[U]]:
    """The units as they end; those that are stopped are left out.

    A unit with a lost worker is tried again, up to three times. One that raised is not.

    Args:
        units: taken one by one as there is room; None: there is none before one that runs has ended.
        progress: is kept up to date.
        signals: grows from outside, as agents.runs.command_line.signals_seen lets it; with the first, running units
            are asked to stop and no others begin; with every further one they are asked again. A unit that stops by
            itself counts as Ctrl-C.
    """
    work = _Work[U](executor, progress)
    queue, n_signals, is_all = iter(units), 0, False
    while True:
        while not (is_all or signals or work.early) and len(work.running) < executor.slots:
            try:
                unit = next(queue)
            except StopIteration:
                is_all = True
                break
            if unit is None:
                break
            work.begin(unit)
        if len(signals) > n_signals:
            n_signals = len(signals)
            work.stop()
        yield from work.ended(signals)
        progress.running = min(len(work.running), executor.slots)
        progress.show()
        if not (work.running or work.early) and (is_all or signals):
            return


def values_of(
    executor: Executor, units: Sequence[Unit], progress: Progress, signals: MutableSequence[int]
) -> list[Any]:
    """The values of all units, in their order.

    Raises:
        RollingJointError: the first unit that failed; the others have been asked to stop.
        KeyboardInterrupt: stopped by a signal.
    """
    values: dict[int, Any] = {}
    places = {id(unit): place for place, unit in enumerate(units)}
    failed: Ended[Unit] | None = None
    for ended in work_through(executor, units, progress, signals):
        values[places[id(ended.unit)]] = ended.value
        if ended.failure and failed is None:
            failed = ended
            signals.append(SIGINT)
    if failed is not None:
        raise UnitFailed(failed.failure) from failed.error
    if len(values) < len(units):
        raise KeyboardInterrupt
    return [values[place] for place in range(len(units))]


class _Work(Generic[U]):
    """Units that an executor works on."""

    def __init__(self, executor: Executor, progress: Progress) -> None:
        self.executor, self.progress = executor, progress
        self.running: dict[Future[Any], tuple[U, U, int]] = {}
        self.finished: SimpleQueue[Future[Any]] = SimpleQueue()
        self.early: list[Ended[U]] = []

    def begin(self, unit: U, attempt: int = 0, origin: U | None = None) -> None:
        """Submit a unit, which may stand for the one that was asked for."""
        try:
            function, arguments = unit.call(attempt)
        except (RollingJointError, OSError) as error:
            self.early.append(self._failed(origin or unit, error))
            return
        future = self.executor.submit(call_with, consent(), function, *arguments)
        self.running[future] = unit, origin or unit, attempt
        future.add_done_callback(self.finished.put)

    def stop(self) -> None:
        """Ask all units to stop."""
        for future in list(self.running):
            self.executor.cancel(future)

    def ended(self, signals: MutableSequence[int]) -> Iterator[Ended[U]]:
        """Those that have ended by now, or within the next moment."""
        while self.early:
            yield self.early.pop()
        if not self.running:
            return
        try:
            future = self.finished.get(timeout=POLL)
        except Empty:
            return
        while True:
            yield from self._settled(future, signals)
            try:
                future = self.finished.get_nowait()
            except Empty:
                return

    def _settled(self, future: Future[Any], signals: MutableSequence[int]) -> Iterator[Ended[U]]:
        unit, origin, attempt = self.running.pop(future)
        error = future.exception()
        if isinstance(error, UnitStopped):
            if not signals:
                signals.append(SIGINT)
        elif isinstance(error, WorkerLost) and signals:
            pass  # lost while it stopped: it goes on when the work does
        elif isinstance(error, WorkerLost) and attempt < RETRIES:
            self.progress.lost += 1
            self.progress.write(f"{origin.name}: {error}; it goes on elsewhere, attempt {attempt + 2} of {RETRIES + 1}")
            self.begin(unit, attempt + 1, origin)
        elif isinstance(error, WorkerLost):
            yield self._failed(origin, WorkerLost(f"{error}, {attempt + 1} times; the same command goes on with it"))
        elif error is not None:
            yield self._failed(origin, error)
        else:
            yield from self._done(unit, origin, attempt, future.result())

    def _done(self, unit: U, origin: U, attempt: int, value: Any) -> Iterator[Ended[U]]:
        try:
            value = unit.received(value)
        except (RollingJointError, OSError) as error:
            yield self._failed(origin, error)
            return
        if isinstance(value, Unit):
            if value.note:
                self.progress.write(f"{origin.name}: {value.note}")
            self.begin(value, attempt, origin)  # type: ignore[arg-type]
            return
        self.progress.done += not origin.is_part
        yield Ended(origin, value)

    def _failed(self, unit: U, error: BaseException) -> Ended[U]:
        self.progress.failed += not unit.is_part
        is_expected = isinstance(error, UnitFailed | WorkerLost | RollingJointError | OSError)
        return Ended(unit, failure=" ".join((str(error) if is_expected else repr(error)).split()), error=error)
