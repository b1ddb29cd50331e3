"""The report of a co-design. Every figure and every verdict is computed from the finished units."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from agents.codesign.study import JOINT, REFERENCE, Opposite, Results, Study, read_study, results_of
from agents.codesign.task import Array
from agents.results.statistics import Bootstrap, Interval
from agents.runs.files import RunFolderError, write_bytes, write_json, write_text
from rollingjoint.io.mechanism_file import dump_mechanism
from rollingjoint.tables import markdown_table

_GOAL = 0.3  # share of the measure by which a co-designed pair should be better to be worth its while
_RESAMPLES = 10_000


def write_report(out: Path) -> None:
    """Write report.md, report.json, winner.yaml, pictures and the film into the folder of a co-design, from its units.

    Raises:
        RunFolderError: no folder of a co-design, or one without a co-designed pair.
    """
    from agents.codesign import pictures

    study = read_study(out)
    results = results_of(study)
    if JOINT not in results:
        raise RunFolderError("run", str(out), "a co-design with a pair that is finished", "Run rj codesign.")
    write_text(out / "winner.yaml", dump_mechanism(study.space.mechanism(winner(study, results)["x"])))
    write_bytes(out / "designs.png", pictures.designs(study, results))
    pictures.film(study, winner(study, results), out / "morph.gif")
    write_json(out / "report.json", summary(study, results))
    write_text(out / "report.md", markdown(study, results))


def winner(study: Study, results: Results) -> dict[str, Any]:
    """The co-designed pair that is best in the validation episodes."""
    sign = _sign(study)
    return min(
        results[JOINT], key=lambda found: math.inf if found["validation"] is None else sign * found["validation"]
    )


def names(results: Results) -> list[str]:
    """The kinds of pairs with scores, the co-designed first; not the first policies of the reference."""
    return [JOINT, *(name for name in results if name not in (JOINT, "first", "design", "random"))]


def tested(results: Results, name: str) -> Array:
    """The test scores of all pairs of a kind, (S, E)."""
    return np.array([found["test"] for found in results[name]])


def best_rival(study: Study, results: Results) -> str | None:
    """The rival that is best in the validation episodes, a mean over its seeds; None where there is none."""
    sign, rivals = _sign(study), [name for name in (REFERENCE, *study.rivals) if name in results]
    means = {name: sign * _mean([found["validation"] for found in results[name]]) for name in rivals}
    return min(means, key=means.__getitem__) if means else None


def gain(study: Study, results: Results, rival: str) -> Interval:
    """By which share of the rival's measure the co-designed pair is better, with a 95 % interval."""
    ours, theirs = tested(results, JOINT), tested(results, rival)
    ratio = Bootstrap(ours.shape[1]).compare(ours, theirs).ratio
    sign = -_sign(study)
    ends = sorted((sign * ratio.low, sign * ratio.high))
    return Interval(sign * ratio.value, *ends)


def correlations(study: Study, results: Results) -> dict[str, Interval]:
    """Spearman's rank correlation of every objective with the measure over random designs, with 95 % intervals."""
    found = [entry for entry in results.get("random", []) if entry["validation"] is not None]
    if len(found) < 4:
        return {}
    control = np.array([np.mean(entry["test"]) for entry in found])
    rng = np.random.default_rng(0)
    rows = rng.integers(0, len(found), (_RESAMPLES // 10, len(found)))
    intervals = {}
    for name, problem in study.rivals.items():
        if isinstance(problem.objectives[0].objective, Opposite):
            continue  # the same values as those of the objective itself
        values = np.array([entry["objectives"][name] for entry in found])
        resampled = np.nan_to_num([spearman(values[row], control[row]) for row in rows])
        ends = np.percentile(resampled, (2.5, 97.5)).tolist() if np.ptp(values) > 0.0 else [math.nan] * 2
        intervals[name] = Interval(spearman(values, control), *ends)
    return intervals


def spearman(one: Array, other: Array) -> float:
    """Spearman's rank correlation, equal values with mean ranks; NaN where one of both does not vary."""
    ranks = [_ranks(one), _ranks(other)]
    if min(np.ptp(ranks[0]), np.ptp(ranks[1])) == 0.0:
        return math.nan
    return float(np.corrcoef(ranks[0], ranks[1])[0, 1])


def _ranks(values: Array) -> Array:
    _, places, counts = np.unique(values, return_inverse=True, return_counts=True)
    return np.asarray((np.cumsum(counts) - 0.5 * (counts - 1))[places], float)


def verdict(study: Study, results: Results) -> str:
    """Whether co-design pays, in one sentence."""
    rival, settings = best_rival(study, results), study.task.settings
    if rival is None:
        return "Nothing to compare the co-designed pair with has been finished."
    better = gain(study, results, rival)
    if better.low >= _GOAL:
        word = "pays"
    elif better.low > 0.0:
        word = "pays, by less than 30 % or not surely by more"
    else:
        word = "does not pay" if better.high < _GOAL else "is not shown to pay"
    return (
        f"Co-design {word}: the {settings.name} of the co-designed pairs is {_percent(better)} better than that of the "
        f"best rival, {_word(rival)} with policies of its own ({len(results[JOINT])} and {len(results[rival])} seeds, "
        f"{study.config.episodes[2]} test episodes, 95 % interval)."
    )


def markdown(study: Study, results: Results) -> str:
    """The report in Markdown."""
    parts = [
        f"# Co-design: {study.path.name}",
        verdict(study, results),
        "## Pairs",
        markdown_table(*_pairs(study, results)),
        "Means over seeds and test episodes, with 95 % intervals of a bootstrap of both. Better: share of the measure "
        "by which the co-designed pairs are better. All policies begin as the same policy of the reference and are "
        "trained with the same settings; a pair is chosen in the validation episodes.",
        "![The reference, the best design of every objective, and the co-designed one](designs.png)",
        "![The design while it is trained, and the measure in the validation episodes](morph.gif)",
        _correlated(study, results),
    ]
    return "\n\n".join(part for part in parts if part) + "\n"


def summary(study: Study, results: Results) -> dict[str, Any]:
    """Plain values for report.json."""
    return {
        "verdict": verdict(study, results),
        "best_rival": best_rival(study, results),
        "means": {name: float(tested(results, name).mean()) for name in names(results)},
        "gains": {name: gain(study, results, name) for name in names(results)[1:]},
        "correlations": correlations(study, results),
        "seconds": {name: float(np.sum([found["seconds"] for found in every])) for name, every in results.items()},
        "winner": winner(study, results)["x"],
    }


def _pairs(study: Study, results: Results) -> tuple[list[str], list[list[str]]]:
    settings = study.task.settings
    limits = [f"{limit.objective.name.replace('_', ' ')} [{limit.objective.unit}]" for limit in study.problem.limits]
    extra = list(results[JOINT][0]["extra"])
    head = ["design", f"{settings.name} [{settings.unit}]", "better", *extra, *limits, "seeds", "seconds of one"]
    rows = []
    for name in names(results):
        found, values = results[name], tested(results, name)
        mean = Bootstrap(values.shape[1]).mean(values)
        row = [_word(name), f"{_figure(mean.value)} [{_figure(mean.low)}, {_figure(mean.high)}]"]
        row.append("" if name == JOINT else _percent(gain(study, results, name)))
        row += [_figure(_mean([entry["extra"][column] for entry in found])) for column in extra]
        row += [_figure(_mean([entry["limited"][place] for entry in found])) for place in range(len(limits))]
        rows.append([*row, str(len(found)), f"{_mean([entry['seconds'] for entry in found]):.1f}"])
    return head, rows


def _correlated(study: Study, results: Results) -> str:
    found = correlations(study, results)
    if not found:
        return ""
    rows = [
        [
            name.replace("_", " "),
            *(
                ["", "the same for all"]
                if math.isnan(one.value)
                else [f"{one.value:+.2f}", f"{one.low:+.2f} to {one.high:+.2f}"]
            ),
        ]
        for name, one in found.items()
    ]
    table = markdown_table(["objective", "Spearman", "95 % interval"], rows)
    count = len(results["random"])
    text = (
        f"Rank correlation of what an objective measures with the {study.task.settings.name} of the design's own "
        f"policy, over {count} random designs that keep the limits:"
    )
    return f"## Which objective predicts control\n\n{text}\n\n{table}"


def _sign(study: Study) -> float:
    return -1.0 if study.task.settings.maximise else 1.0


def _word(name: str) -> str:
    known = {JOINT: "co-designed", REFERENCE: "the reference"}
    if name in known or name.startswith("search "):
        return known.get(name, name.replace("_", " "))
    return f"best {name.replace('_', ' ')}"


def _percent(better: Interval) -> str:
    return f"{100 * better.value:z.0f} % [{100 * better.low:z.0f}, {100 * better.high:z.0f}]"


def _figure(value: float) -> str:
    return f"{value:.3g}"


def _mean(values: Sequence[float | None]) -> float:
    return float(np.mean([math.inf if value is None else value for value in values]))
