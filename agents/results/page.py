"""The text of the results page.

Every figure and every verdict is computed from the results; but notes, which worlds.py has, are written by hand.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence

import numpy as np

from agents.controllers.controller import Array
from agents.evaluation.score import CLOSE_MM, FLOOR, HELD_STEPS
from agents.results.record import BASELINE, ENTRY, POLICY, SHIFT, TEST, VALIDATION, BenchmarkRecord, Results
from agents.results.standings import Standings
from agents.results.wording import (
    change_text,
    in_short,
    mm,
    share,
    signed_percent,
    spread,
    verdict_text,
    with_interval,
    wrapped,
)
from agents.results.worlds import KNOWN_MM, NOTES, task_note
from rollingjoint.tables import markdown_table

ERRORS = ("mean [mm]", "IQM [mm]", "median [mm]", "95 % below [mm]")
SHARES = (f"within {CLOSE_MM:g} mm [%]", f"held {HELD_STEPS} steps [%]")
REGRET = "regret [mm]"
ACTION = "µs per action"
SMOOTHER, MPC, PLAIN = "smoother", "mpc", "Plain PPO"
TRAINING = ("steps", "training [min]", "seeds")
CHANGE = "change of the mean [%]"


def page(results: Results, pictures: Mapping[str, str], films: Mapping[str, Mapping[str, str]]) -> str:
    """The Markdown of the whole page.

    Args:
        pictures: captions by file name in images/. films: the same by title of a benchmark.
    """
    tables = [Tables(record) for record in results.benchmarks if record.of_role(TEST)]
    parts = [
        "# Results",
        "Trained policies, controllers that need no training, and the floor, all in the same episodes. This page is "
        "generated from a results file, its verdicts too. Rebuild it:",
        "```bash\n" + "\n".join(results.commands) + "\n```",
        "## In short",
        summary_table(tables),
        _reading(results.benchmarks),
        *_costs(tables),
    ]
    for table in tables:
        parts += [*table.section(), *_pictures(films.get(table.record.title, {}))]
    parts += ["## Pictures", *_pictures(pictures), "## How this was measured", _measured(results)]
    return "\n\n".join(map(wrapped, parts)) + "\n"


class Tables:
    """The tables and verdicts of one benchmark.

    Attributes:
        record: the benchmark. worlds: its standings in the episodes of its table and under every shift.
    """

    def __init__(self, record: BenchmarkRecord) -> None:
        self.record = record
        self.worlds = [Standings(record, world) for role in (TEST, SHIFT) for world in record.of_role(role)]

    def section(self) -> list[str]:
        """Heading, description, tables and verdicts."""
        title = self.record.title
        parts = [f"## {title[0].upper()}{title[1:]}", self.record.description, task_note(self.record)]
        for standing in self.worlds:
            heading = standing.world.heading
            parts += [f"### {heading}", NOTES.get(heading, "")] if heading else []
            parts += [
                self.table(standing),
                self._early(standing),
                verdict_text(standing),
                change_text(standing, self.worlds[0]),
            ]
        reasons: dict[str, list[str]] = {}
        for name, reason in self.record.impossible.items():
            reasons.setdefault(reason, []).append(name)
        parts += [f"Not possible here: {', '.join(names)}. {reason}" for reason, names in reasons.items()]
        return [part for part in parts if part]

    def table(self, standing: Standings) -> str:
        """A line per controller, and the floor; in other worlds than its own with the change of the mean."""
        is_own = standing is self.worlds[0]
        timed = is_own and any(map(self._action_us, standing.names))
        last = ((ACTION,) if timed else ()) + (TRAINING if is_own else (CHANGE,))

        def more(name: str) -> tuple[str, ...]:
            if not is_own:
                return self._change(standing, name)
            return ((self._action_us(name),) if timed else ()) + self._training(name)

        rows = [(self._label(name), *self.columns(standing, name), *more(name)) for name in standing.names]
        floors = standing.world.known_floors
        if len(floors):
            figures = floors.mean(), _iqm(floors), np.median(floors), np.percentile(floors, 95)
            within = share(float(np.mean(floors <= CLOSE_MM)))
            rows.append((FLOOR, *map(mm, map(float, figures)), within, "", "", *("" for _ in last)))
        return markdown_table(("controller", *ERRORS, *SHARES, REGRET, *last), rows)

    @staticmethod
    def columns(standing: Standings, name: str) -> list[str]:
        """The figures of one controller: ERRORS, SHARES, REGRET."""
        summary, regret = standing.summary(name), standing.regret(name)
        errors = [with_interval(interval, mm) for interval in (summary.mean, summary.iqm, summary.median, summary.p95)]
        return [*errors, share(standing.within(name)), share(standing.held(name)), "" if regret is None else mm(regret)]

    def _label(self, name: str) -> str:
        controller = self.record.controller(name)
        marks = [*(["privileged"] if controller.privileged else []), *(["entered"] if controller.kind == ENTRY else [])]
        return f"{name} ({', '.join(marks)})" if marks else name

    def _change(self, standing: Standings, name: str) -> tuple[str]:
        change = standing.change(name, self.worlds[0])
        return ("" if change is None else with_interval(change, signed_percent),)

    def _action_us(self, name: str) -> str:
        """Processor time per action in the task's own episodes, mean of the runs [µs]; empty where it is not known."""
        runs = self.record.controller(name).runs
        times = [run.driven[self.worlds[0].world.name].action_us for run in runs]
        mean = float(np.mean(times))
        return "" if not all(times) else f"{mean:.0f}" if mean >= 10.0 else f"{mean:.1f}"

    def costs(self) -> list[str]:
        """A row: the best learner, the smoother, mpc, the best of the others, plain PPO, feedback on the true state."""
        record, (own, *_) = self.record, self.worlds
        plain = next((name for name in own.names if name.startswith(PLAIN.lower().replace(" ", "_"))), None)
        privileged = next((name for name in own.names if record.controller(name).privileged), None)
        learner, other = own.policy, record.best(BASELINE, but=[SMOOTHER, MPC])

        def cell(name: str | None) -> str:
            if name is None or name not in own.names:
                return ""
            microseconds = self._action_us(name)
            return mm(own.mean(name).value) + (f" / {microseconds}" if microseconds else "")

        known = KNOWN_MM.get(record.env_id)
        cells = [cell(learner), "" if learner is None else self._training(learner)[1], cell(SMOOTHER), cell(MPC)]
        cells += [f"{other}: {cell(other)}" if other else "", cell(plain), cell(privileged)]
        cells.append(f"{known:g}" if known else "")
        return [f"[{record.title}](#{_anchor(record.title)})", *cells]

    def _training(self, name: str) -> tuple[str, str, str]:
        controller = self.record.controller(name)
        if controller.kind != POLICY:
            seeds = [seed for seed in controller.training_seeds if seed is not None]
            return "", "", f"{len(seeds)}" if seeds else ""
        minutes_of_runs = [run.seconds / 60 for run in controller.runs if run.seconds]
        minutes = spread(minutes_of_runs, "{:.1f}".format) if minutes_of_runs else ""
        seeds_text = f"{len(controller.runs)}" if len(controller.runs) > 1 else "1 (one run)"
        return f"{controller.training['steps']:,}", minutes, seeds_text

    def _early(self, standing: Standings) -> str:
        ended = {
            name: sum(run.driven[standing.world.name].ended_early for run in self.record.controller(name).runs)
            for name in standing.names
        }
        counts = [f"{name} {count}" for name, count in ended.items() if count]
        world = standing.world
        unknown = 0 if world.floors is None else world.episodes - len(world.known_floors)
        text = f"Episodes that ended early, without an equilibrium: {', '.join(counts)}. " if counts else ""
        return (text + (f"Episodes without a known floor: {unknown}." if unknown else "")).strip()


def summary_table(tables: Sequence[Tables]) -> str:
    """A line per benchmark: the best trained controller and the best opponent of the validation episodes."""
    head = ("task", "learning", "best learner", "mean [mm]", "best opponent", "mean [mm]", "difference [mm]", FLOOR)
    rows = []
    for standing in (table.worlds[0] for table in tables):
        title, names = standing.record.title, (standing.policy, standing.baseline)
        cells = [f"[{title}](#{_anchor(title)})", in_short(standing)]
        for name in names:
            cells += ["-", ""] if name is None else [name, with_interval(standing.mean(name), mm)]
        difference = None if None in names else standing.compare(*names).difference  # type: ignore[arg-type]
        floors = standing.world.known_floors
        cells += ["" if difference is None else with_interval(difference, mm)]
        rows.append([*cells, mm(float(floors.mean())) if len(floors) else "unknown"])
    return markdown_table(head, rows, left=2)


def _costs(tables: Sequence[Tables]) -> list[str]:
    """Heading and table of what it takes to be so near, of tasks that a smoother drives in; nothing without any."""
    rows = [table.costs() for table in tables if SMOOTHER in table.worlds[0].names]
    if not rows:
        return []
    text = (
        "The mean tip error with, after a slash, the processor time of an action in µs, the episodes side by side, "
        "where it was measured; `benchmarks/opponents.py` times controllers of the other tasks. Plain PPO is a "
        "newcomer's first try: defaults of Stable-Baselines3 and eight stacked observations. What can be known of the "
        "tip is estimated from what sensors tell ([opponents.md](opponents.md#what-can-be-known-at-all)); it is no "
        "bound."
    )
    head = ("task", "best learner", "training [min]", SMOOTHER, MPC, "best other", PLAIN, "true state", "can be known")
    return ["## What it takes", text, markdown_table(head, rows)]


def _anchor(title: str) -> str:
    """The anchor that code hosts give to a heading."""
    return re.sub(r"[^\w\- ]", "", title.lower()).replace(" ", "-")


def _reading(records: Sequence[BenchmarkRecord]) -> str:
    return (
        f"Errors are distances from tip to target in mm, averaged over the last {HELD_STEPS} steps, in "
        f"{_seeds_of_role(records, TEST)}. In square brackets are 95 % intervals by a bootstrap over training seeds and"
        " episodes, both resampled, the episodes the same for all controllers; a policy's figures are means over its "
        "training seeds. Lane k of a training run has the run's seed + k: runs with neighbouring seeds train in mostly "
        "the same episodes, and differ in initial weights. IQM: mean of the middle half of the episodes. Within "
        f"{CLOSE_MM:g} mm: share of episodes that end so near; held: that are so near in all of the last {HELD_STEPS} "
        "steps. The floor is the smallest error that any command reaches against the load at the end of the episode, "
        "where it is known; regret is what a controller leaves above it there, on average. The best learner and the "
        f"best opponent are those with the smallest mean in {_seeds_of_role(records, VALIDATION)}; "
        "nothing is chosen in the tables. Learning pays where the intervals of their two means are separate, narrowly "
        "where only that of the paired difference excludes zero, and does not pay where that excludes zero on the "
        "other side. Controllers marked as privileged see what no robot shows."
    )


def _seeds_of_role(records: Sequence[BenchmarkRecord], role: str) -> str:
    worlds = {(world.first_seed, world.episodes) for record in records for world in record.of_role(role)}
    texts = [f"{count:,} episodes (seeds {first} to {first + count - 1})" for first, count in sorted(worlds)]
    return f"{' or '.join(texts) or 'none'}"


def _pictures(captions: Mapping[str, str]) -> list[str]:
    lines = [(f"![{caption.partition(':')[0]}](images/{name})", caption) for name, caption in captions.items()]
    return [part for pair in lines for part in pair]


def _measured(results: Results) -> str:
    learned = [
        controller for record in results.benchmarks for controller in record.controllers if controller.kind == POLICY
    ]
    single = [controller.name for controller in learned if len(controller.runs) == 1]
    lines = [
        *(f"Scored on {machine}." for machine in results.scored_on),
        *(f"Trained on {machine}." for machine in results.trained_with),
        "Training time is processor time, evaluations during training included.",
        f"Training seeds: {_training_seeds(results)}.",
        f"Seeds of environments: {_used(results)}.",
        "Every policy is the one of its run with the smallest error in the evaluations during training (`best/`).",
        f"One run, not a mean over seeds: {', '.join(single)}." if single else "No line of a policy is a single run.",
    ]
    if shipped := [controller.name for controller in learned if controller.training.get("shipped")]:
        lines.append(f"Shipped policies, one training seed each, trained earlier: {', '.join(shipped)}.")
    lines += [
        f"{controller.name} began as the best policy of "
        f"{', which began as that of '.join(controller.training['began_as'])}; its training time includes that, "
        "its steps and its curve do not."
        for controller in learned
        if "began_as" in controller.training
    ]
    lines += [f"Left out: `{path}`: {reason}" for path, reason in results.left_out.items()]
    return "\n".join(f"- {line}" for line in lines)


def _training_seeds(results: Results) -> str:
    groups: dict[str, list[str]] = {}
    for controller in (
        controller for record in results.benchmarks for controller in record.controllers if controller.kind == POLICY
    ):
        groups.setdefault(", ".join(map(str, controller.training_seeds)), []).append(controller.name)
    return "; ".join(f"{seeds} ({', '.join(names) if len(groups) > 1 else 'all'})" for seeds, names in groups.items())


def _used(results: Results) -> str:
    runs = [run for record in results.benchmarks for controller in record.controllers for run in controller.runs]
    texts = []
    for key, text in (("training_environments", "training"), ("evaluation_during_training", "evaluations during it")):
        ends = [run.seeds[key] for run in runs if key in run.seeds]
        texts += [f"{text} {min(first for first, _ in ends)} to {max(last for _, last in ends)}"] if ends else []
    for role, text in ((VALIDATION, "choosing the best"), (TEST, "tables")):
        texts.append(f"{text} {_seeds_of_role(results.benchmarks, role)}")
    return ", ".join(texts)


def _iqm(values: Array) -> float:
    cut = len(values) // 4
    return float(np.sort(values)[cut : len(values) - cut].mean())
