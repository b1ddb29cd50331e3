"""The text of the results page. Every figure and every verdict is computed from the scores."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from statistics import mean
from textwrap import fill

import numpy as np

from agents.evaluation.controller import Array
from agents.evaluation.score import CLOSE_MM, FLOOR, HELD_STEPS, Score
from agents.results.description import description, load_range
from agents.results.runs import HEAVIER, Benchmark, Recipe
from agents.results.scores import FEEDBACK, Comparison, Scored, Scores
from rollingjoint.tables import markdown_table

CLEAR = 3.0  # standard errors: smaller differences do not count
ERRORS = ("mean [mm]", "median [mm]", "95 % below [mm]")
SHARES = (f"within {CLOSE_MM:g} mm [%]", f"held {HELD_STEPS} steps [%]")
REGRET = "regret [mm]"
TRAINING = ("steps", "training [min]", "seeds")
WIDTH = 120
PAYS, BEATS_FEEDBACK, NO_DIFFERENCE, DOES_NOT = ("pays", "beats feedback only", "no clear difference", "does not pay")


@dataclass(frozen=True)
class About:
    """How the page was made.

    Args:
        commands: that rebuild it. seeds: of the episodes. machine, versions: in words.
        trained_with: in words, what the run folders say of the machine that trained.
        left_out: why, by run folder.
        pictures: captions, by file name in images/; animations: the same, by title of a benchmark.
    """

    commands: Sequence[str]
    seeds: range
    machine: str
    versions: str
    trained_with: str
    left_out: Mapping[Path, str]
    pictures: Mapping[str, str]
    animations: Mapping[str, Mapping[str, str]]


def page(scored: Sequence[Scored], about: About) -> str:
    """The Markdown of the whole page."""
    parts = [
        "# Results",
        "Trained policies, controllers that need no training, and the floor, all in the same episodes. This page is "
        "generated from run folders, its verdicts too. Rebuild it:",
        "```bash\n" + "\n".join(about.commands) + "\n```",
        "## In short",
        _summary(scored),
        _reading(about.seeds),
    ]
    for one in scored:
        parts += _section(one, about)
    parts += ["## Pictures", *_pictures(about.pictures)]
    parts += ["## How this was measured", _measured(scored, about)]
    return "\n\n".join(map(_wrapped, parts)) + "\n"


def verdict(scores: Scores) -> str:
    """Whether the best policy beats Jacobian feedback and the best baseline: one of four words."""
    policy = scores.best_policy
    feedback, best = (scores.compare(policy, name).standard_errors for name in (FEEDBACK, scores.best_baseline))
    if best >= CLEAR:
        return PAYS
    if feedback >= CLEAR:
        return BEATS_FEEDBACK
    return NO_DIFFERENCE if best > -CLEAR else DOES_NOT


def _summary(scored: Sequence[Scored]) -> str:
    head = ("task", "best policy", "mean [mm]", FEEDBACK, "best baseline", FLOOR, "learning")
    rows = []
    for benchmark, scores in ((one.benchmark, one.scores) for one in scored):
        policy, baseline = scores.best_policy, scores.best_baseline
        link = f"[{benchmark.title}](#{benchmark.title.replace(' ', '-')})"
        errors = [_mm(scores.errors(name).mean()) for name in (policy, FEEDBACK, baseline)]
        best = f"{baseline} {errors[2]}"
        rows.append((link, policy, errors[0], errors[1], best, _floor_figures(scores)[0], verdict(scores)))
    return markdown_table(head, rows)


def _reading(seeds: range) -> str:
    return (
        f"Errors are distances from tip to target at the end of an episode in mm, over {len(seeds):,} episodes (seeds "
        f"{seeds[0]} to {seeds[-1]}, not used for training or tuning). Within {CLOSE_MM:g} mm: share of episodes that "
        f"end so near; held: that are so near in all of the last {HELD_STEPS} steps. The floor is the smallest error "
        "that any command reaches against the load of the episode; regret is what a controller leaves above it, on "
        "average. A policy's figures are means over its training seeds, in brackets the smallest and the largest. "
        "Comparisons are episode by episode; standard errors are over the episodes, of errors averaged over the "
        f"seeds. A difference of less than {CLEAR:g} standard errors counts as none. The best policy and the best "
        "baseline are those with the smallest mean in the same table."
    )


def _section(scored: Scored, about: About) -> list[str]:
    benchmark, scores, beyond = scored.benchmark, scored.scores, scored.beyond
    parts = [
        f"## {benchmark.title[0].upper()}{benchmark.title[1:]}",
        description(benchmark.config),
        score_table(benchmark, scores),
    ]
    parts += [_early(scores), verdict_text(scores)]
    if beyond:
        low = benchmark.config.load.magnitude[1]
        parts += [
            f"**Heavier loads than in training**, {load_range(benchmark.config.load, low, HEAVIER * low)}:",
            _heavier_table(benchmark, beyond),
            verdict_text(beyond),
        ]
    return [part for part in parts if part] + _pictures(about.animations.get(benchmark.title, {}))


def score_table(benchmark: Benchmark, scores: Scores) -> str:
    """The table of a benchmark: a line per configuration, baseline, and the floor."""
    rows = [
        (recipe.name, *_spread_columns(scores.of_policy(recipe.name)), *_training(recipe))
        for recipe in benchmark.recipes
    ]
    rows += [(name, *_columns(scores.of_baseline(name)), "", "", "") for name in scores.baselines]
    rows.append((FLOOR, *_floor_figures(scores), "", "", "", "", ""))
    return markdown_table(("controller", *ERRORS, *SHARES, REGRET, *TRAINING), rows)


def _heavier_table(benchmark: Benchmark, scores: Scores) -> str:
    def short(columns: Sequence[str]) -> tuple[str, ...]:
        return columns[0], columns[1], columns[3], columns[5]

    rows = [(recipe.name, *short(_spread_columns(scores.of_policy(recipe.name)))) for recipe in benchmark.recipes]
    rows += [(name, *short(_columns(scores.of_baseline(name)))) for name in scores.baselines]
    mean_floor, median, _, share = _floor_figures(scores)
    rows.append((FLOOR, mean_floor, median, share, ""))
    return markdown_table(("controller", *ERRORS[:2], SHARES[0], REGRET), rows)


def _columns(score: Score) -> list[str]:
    shares = (_share(score.within_1_mm), _share(score.held_1_mm))
    regret = "" if score.regret_mm is None else _mm(score.regret_mm)
    return [_mm(score.mean_mm), _mm(score.median_mm), _mm(score.p95_mm), *shares, regret]


def _spread_columns(scores: Sequence[Score]) -> list[str]:
    """Means over the seeds, with the smallest and the largest where there are several."""
    every = {
        _mm: [[getattr(score, name) for score in scores] for name in ("mean_mm", "median_mm", "p95_mm")],
        _share: [[getattr(score, name) for score in scores] for name in ("within_1_mm", "held_1_mm")],
    }
    columns = [_spread(values, form) for form, some in every.items() for values in some]
    regrets = [score.regret_mm for score in scores if score.regret_mm is not None]
    return [*columns, _spread(regrets, _mm) if regrets else ""]


def _training(recipe: Recipe) -> tuple[str, str, str]:
    minutes = [run.seconds / 60 for run in recipe.runs]
    seeds = f"{len(recipe.runs)}" if len(recipe.runs) > 1 else "1 (one run)"
    return f"{recipe.config.total_timesteps:,}", _spread(minutes, "{:.1f}".format), seeds


def _early(scores: Scores) -> str:
    ended = {name: sum(int(run.terminated.sum()) for run in runs) for name, runs in scores.policies.items()}
    ended |= {name: int(run.terminated.sum()) for name, run in scores.baselines.items()}
    told = [f"{name} {count}" for name, count in ended.items() if count]
    unknown = len(scores.floors) - len(_finite(scores.floors))
    text = f"Episodes that ended early, without an equilibrium: {', '.join(told)}. " if told else ""
    return (text + (f"Episodes without a known floor: {unknown}." if unknown else "")).strip()


def verdict_text(scores: Scores) -> str:
    """Whether the best policy beats Jacobian feedback and the best baseline, and by how much."""
    heads = {
        PAYS: "Learning pays here.",
        BEATS_FEEDBACK: "Learning beats Jacobian feedback here, but not the best baseline.",
        NO_DIFFERENCE: "Learning makes no clear difference here.",
        DOES_NOT: "Learning does not pay here.",
    }
    policy = scores.best_policy
    names = [FEEDBACK] + ([scores.best_baseline] if scores.best_baseline != FEEDBACK else [])
    against = [_compared(name, scores.errors(name).mean(), scores.compare(policy, name)) for name in names]
    best = "" if len(names) > 1 else " Jacobian feedback is the best baseline."
    error = f"The best policy, {policy} ({_mm(scores.errors(policy).mean())} mm), ends with"
    return f"**{heads[verdict(scores)]}** {error} {'; with '.join(against)}.{best}"


def _compared(name: str, error: float, found: Comparison) -> str:
    less = "less" if found.gain_mm >= 0 else "more"
    share = f" ({100 * found.share:.0f} %)" if found.share >= 0 else ""
    seeds = f"better with {found.seeds_better} of {found.seeds} seeds" if found.seeds > 1 else "one run"
    return (
        f"{abs(found.gain_mm):.2g} mm{share} {less} than {name} ({_mm(error)} mm): "
        f"{abs(found.standard_errors):.1f} standard errors, {seeds}"
    )


def _pictures(captions: Mapping[str, str]) -> list[str]:
    lines = [(f"![{caption.partition(':')[0]}](images/{name})", caption) for name, caption in captions.items()]
    return [part for both in lines for part in both]


def _measured(scored: Sequence[Scored], about: About) -> str:
    recipes = [recipe for one in scored for recipe in one.benchmark.recipes]
    single = [recipe.name for recipe in recipes if len(recipe.runs) == 1]
    lines = [
        f"Scored on {about.machine}. {about.versions}.",
        f"Trained on {about.trained_with}.",
        "Training time is processor time, evaluations during training included.",
        f"Training seeds: {_seeds_of(recipes)}.",
        f"Seeds of environments: {_used(recipes)}; here {about.seeds[0]} to {about.seeds[-1]}.",
        "Every policy is the one of its run with the smallest error in the evaluations during training (`best/`).",
        f"One run, not a mean over seeds: {', '.join(single)}." if single else "No line of a policy is a single run.",
    ]
    lines += [f"Left out: `{path}`: {reason}" for path, reason in about.left_out.items()]
    return "\n".join(f"- {line}" for line in lines)


def _seeds_of(recipes: Sequence[Recipe]) -> str:
    groups: dict[str, list[str]] = {}
    for recipe in recipes:
        groups.setdefault(", ".join(map(str, recipe.seeds)), []).append(recipe.name)
    return "; ".join(f"{seeds} ({', '.join(names) if len(groups) > 1 else 'all'})" for seeds, names in groups.items())


def _used(recipes: Sequence[Recipe]) -> str:
    texts = []
    for key, text in (("training_environments", "training"), ("evaluation_during_training", "evaluations during it")):
        used = [run.config.seeds[key] for recipe in recipes for run in recipe.runs]
        texts.append(f"{text} {min(seeds[0] for seeds in used)} to {max(seeds[-1] for seeds in used)}")
    return ", ".join(texts)


def _finite(floors: Array) -> Array:
    return floors[np.isfinite(floors)]


def _floor_figures(scores: Scores) -> tuple[str, str, str, str]:
    """Mean, median and 95th percentile of the known floors, and the share of those within 1 mm."""
    floors = _finite(scores.floors)
    if len(floors) == 0:
        return "unknown", "", "", ""
    high, share = np.percentile(floors, 95), float(np.mean(floors <= CLOSE_MM))
    return _mm(floors.mean()), _mm(np.median(floors)), _mm(high), _share(share)


def _mm(value: float) -> str:
    if abs(value) < 0.001:
        return "< 0.001"
    return f"{value:.3f}" if abs(value) < 1 else f"{value:.2f}"


def _share(value: float) -> str:
    return f"{100 * value:.1f}"


def _spread(values: Sequence[float], form: Callable[[float], str]) -> str:
    around = f" ({form(min(values))} to {form(max(values))})" if len(values) > 1 else ""
    return f"{form(mean(values))}{around}"


def _wrapped(part: str) -> str:
    """Paragraphs and lists in lines of limited width; tables, headings, pictures and code as they are."""
    if part.startswith(("|", "#", "```", "![")):
        return part
    lines = part.split("\n")
    indent = "  " if part.startswith("- ") else ""
    return "\n".join(fill(line, WIDTH, subsequent_indent=indent, break_on_hyphens=False) for line in lines)
