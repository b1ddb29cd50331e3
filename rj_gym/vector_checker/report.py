"""The report of the checker: one outcome per check and autoreset mode, and a table of them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from gymnasium.vector import AutoresetMode

from rollingjoint.errors import RollingJointError
from rollingjoint.tables import text_table

Result = Literal["passed", "failed", "skipped"]


@dataclass(frozen=True)
class Outcome:
    """One check in one autoreset mode.

    Attributes:
        check: name of the check.
        claim: its claim about the environment.
        mode: the environment's autoreset mode; None if it states none.
        result: "passed", "failed" or "skipped".
        detail: why it failed or was skipped.
    """

    check: str
    claim: str
    mode: AutoresetMode | None
    result: Result
    detail: str = ""


@dataclass(frozen=True)
class Report:
    """Everything the checker found; `print(report)` shows a table, then each failure and each reason to skip.

    Attributes:
        env: the environment, in words.
        outcomes: one per check and autoreset mode, in the order in which they ran.
    """

    env: str
    outcomes: tuple[Outcome, ...]

    @property
    def passed(self) -> tuple[Outcome, ...]:
        """Outcomes of checks with a claim that holds."""
        return self._with("passed")

    @property
    def failed(self) -> tuple[Outcome, ...]:
        """Outcomes of checks with a claim that does not hold; `detail` says where."""
        return self._with("failed")

    @property
    def skipped(self) -> tuple[Outcome, ...]:
        """Outcomes of checks that did not apply; `detail` says why."""
        return self._with("skipped")

    @property
    def modes(self) -> tuple[AutoresetMode | None, ...]:
        """The autoreset modes that were checked."""
        return tuple(dict.fromkeys(outcome.mode for outcome in self.outcomes))

    def raise_if_failed(self) -> None:
        """Raise VectorEnvError, with every failure in its message, if a check failed."""
        if self.failed:
            raise VectorEnvError(self)

    def __str__(self) -> str:
        counts = f"{len(self.passed)} passed, {len(self.failed)} failed, {len(self.skipped)} skipped"
        notes = _notes(self.failed) + _notes(self.skipped)
        return "\n".join([f"{self.env}: {counts}", self._table(), *notes])

    def _with(self, result: Result) -> tuple[Outcome, ...]:
        return tuple(outcome for outcome in self.outcomes if outcome.result == result)

    def _table(self) -> str:
        names = dict.fromkeys(outcome.check for outcome in self.outcomes)
        results = {(outcome.check, outcome.mode): outcome.result for outcome in self.outcomes}
        rows = [[name, *(results.get((name, mode), "") for mode in self.modes)] for name in names]
        return text_table(["check", *map(_mode_name, self.modes)], rows, left=1 + len(self.modes))


class VectorEnvError(RollingJointError, RuntimeError):
    """A vector environment that does not keep Gymnasium's contract; `report` has the outcome of every check."""

    def __init__(self, report: Report) -> None:
        self.report = report
        super().__init__(report)

    def __str__(self) -> str:
        return "\n".join([f"{self.report.env} fails {len(self.report.failed)} checks:", *_notes(self.report.failed)])


def _mode_name(mode: AutoresetMode | None) -> str:
    return mode.value if mode else "no mode"


def _notes(outcomes: tuple[Outcome, ...]) -> list[str]:
    """One line per check and detail, with the modes that share it."""
    shared: dict[tuple[str, str, str], list[str]] = {}
    for outcome in outcomes:
        shared.setdefault((outcome.result, outcome.check, outcome.detail), []).append(_mode_name(outcome.mode))
    return [f"- {result}: {check} ({', '.join(modes)}): {detail}" for (result, check, detail), modes in shared.items()]
