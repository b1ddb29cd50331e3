"""The results of a study: best.yaml, report.md and two pictures."""

from __future__ import annotations

import json
import warnings
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.axis import Axis
from matplotlib.figure import Figure
from matplotlib.ticker import LogLocator, MaxNLocator, NullLocator
from optuna.exceptions import ExperimentalWarning
from optuna.importance import PedAnovaImportanceEvaluator, get_param_importances
from optuna.study import Study
from optuna.trial import FrozenTrial, TrialState

from agents.evaluation.pictures import figure_of, png, tidy
from agents.runs.files import write_bytes, write_text
from agents.runs.folder import versions
from agents.tuning.study import Choices, StudyConfig, with_values
from rollingjoint.checked_yaml import dump_yaml
from rollingjoint.tables import markdown_table

DONE, PRUNED, FAILED, BEST = "#0072b2", "#e69f00", "#7f7f7f", "#d55e00"  # Okabe and Ito
SHOWN = 10


def write_results(study: Study, config: StudyConfig, folder: Path, command: Sequence[str]) -> None:
    """Write the results so far into the folder of the study; best.yaml and pictures once a trial has a score."""
    done = sorted(_trials(study, TrialState.COMPLETE), key=lambda trial: trial.value or 0.0)
    importance = _importance(study)
    if done:
        values = config.values(done[0].params)
        head = (
            f"# Trial {done[0].number} of {folder}: {config.score} = {done[0].value:.4f} on its own evaluation seeds.\n"
        )
        write_text(folder / "best.yaml", head + dump_yaml(with_values(config.train, values).to_dict()))
        write_bytes(folder / "history.png", history(study, config.score))
        write_bytes(folder / "parameters.png", parameters(done, config, importance))
    write_text(folder / "report.md", _report(study, config, done, importance, command))


def history(study: Study, score: str) -> bytes:
    """PNG: the score of every trial, the best so far, and where trials were ended early or failed."""
    figure = figure_of(8, 4.5)
    axes = _axes(figure, None, f"{score.removesuffix('_mm')} tip error [mm]")
    done = _trials(study, TrialState.COMPLETE)
    numbers, scores = [t.number for t in done], np.array([t.value for t in done])
    axes.scatter(numbers, scores, color=DONE, s=24, label="trial", zorder=3)
    axes.step(numbers, np.minimum.accumulate(scores), where="post", color=BEST, label="best so far")
    early = [t for t in _trials(study, TrialState.PRUNED) if t.intermediate_values]
    if early:
        last = [t.intermediate_values[max(t.intermediate_values)] for t in early]
        label = "ended early, at its last score"
        axes.scatter([t.number for t in early], last, color=PRUNED, marker="x", s=28, label=label)
    failed = [t.number for t in _trials(study, TrialState.FAIL)]
    if failed:
        top = axes.get_xaxis_transform()
        axes.plot(failed, [1.0] * len(failed), "|", color=FAILED, markersize=12, transform=top, label="failed")
    axes.set_xlabel("trial")
    axes.xaxis.set_major_locator(MaxNLocator(integer=True))
    figure.legend(loc="outside upper center", ncols=4, frameon=False)
    return png(figure)


def parameters(done: Sequence[FrozenTrial], config: StudyConfig, importance: dict[str, float]) -> bytes:
    """PNG: a panel per parameter, in the order of importance: its value and the score of every finished trial."""
    keys = sorted(config.space, key=lambda key: -importance.get(key, 0.0))
    columns = min(4, len(keys))
    rows = -(-len(keys) // columns)
    figure = figure_of(3.2 * columns, 2.8 * rows)
    shared: Axes | None = None
    for place, key in enumerate(keys):
        axes = _axes(figure, (rows, columns, place + 1), "tip error [mm]" if place % columns == 0 else "", shared)
        shared = shared or axes
        _panel(axes, key, done, config)
        share = f"  {100 * importance[key]:.0f} %" if key in importance else ""
        axes.set_title(f"{_short(key)}{share}", fontsize=10)
    return png(figure)


def _panel(axes: Axes, key: str, done: Sequence[FrozenTrial], config: StudyConfig) -> None:
    values = config.space[key]
    x: list[Any] = [trial.params[key] for trial in done]
    if isinstance(values, Choices):
        places = [json.dumps(choice) for choice in values.choices]
        x = [places.index(value) for value in x]
        axes.set_xticks(range(len(places)), [place.strip('"') for place in places])
        axes.set_xlim(-0.5, len(places) - 0.5)
    elif values.log:
        axes.set_xscale("log")
        _label_one_two_five(axes.xaxis)
    scores = np.array([trial.value for trial in done])
    axes.tick_params(labelsize=8)
    axes.scatter(x, scores, color=DONE, s=16, alpha=0.7, linewidths=0)
    axes.scatter(x[:1], scores[:1], color=BEST, marker="*", s=120, zorder=3)


def _axes(figure: Figure, place: tuple[int, int, int] | None, label: str, shared: Axes | None = None) -> Axes:
    """Axes with a logarithmic scale of tip errors."""
    axes = figure.add_subplot(*(place or (1, 1, 1)), sharey=shared)
    axes.set_yscale("log")
    _label_one_two_five(axes.yaxis)
    axes.set_ylabel(label)
    tidy(axes, "y")
    return axes


def _label_one_two_five(axis: Axis) -> None:
    axis.set_major_locator(LogLocator(subs=(1, 2, 5)))
    axis.set_major_formatter("{x:g}")
    axis.set_minor_locator(NullLocator())


def _importance(study: Study) -> dict[str, float]:
    """Importance of every parameter for good trials, as a share; empty for fewer than four finished ones."""
    scores = {trial.value for trial in _trials(study, TrialState.COMPLETE)}
    if len(scores) < 4:
        return {}
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ExperimentalWarning)  # which it was until Optuna 4.8
        return get_param_importances(study, evaluator=PedAnovaImportanceEvaluator())


def _trials(study: Study, state: TrialState) -> list[FrozenTrial]:
    return study.get_trials(deepcopy=False, states=[state])


def _report(
    study: Study, config: StudyConfig, done: Sequence[FrozenTrial], importance: dict[str, float], command: Sequence[str]
) -> str:
    counts = {name: len(_trials(study, state)) for name, state in STATES.items()}
    seconds = sum(trial.user_attrs.get("seconds", 0.0) for trial in study.get_trials(deepcopy=False))
    last = config.first_seed + config.episodes - 1
    about = {
        "command": " ".join(command),
        "trials": ", ".join(f"{count} {name}" for name, count in counts.items() if count),
        "time": f"{seconds / 60:.1f} minutes of all trials together",
        "training": f"{config.train.algorithm}, {config.train.total_timesteps} steps of {config.train.env.id}, "
        f"seeds {', '.join(map(str, config.training_seeds))}",
        "score": f"{config.score} after training, {config.episodes} episodes, seeds {config.first_seed} to {last}",
        "versions": ", ".join(f"{name} {version}" for name, version in versions().items()),
    }
    parts = ["# Study", "\n".join(f"- {name}: {text}" for name, text in about.items())]
    if done:
        parts += [_best(done, config), _importances(config, importance)]
    failed = _trials(study, TrialState.FAIL)
    if failed:
        lines = [f"- trial {trial.number}: {trial.user_attrs.get('reason', 'unknown')}" for trial in failed]
        parts += ["## Failed trials", "\n".join(lines)]
    return "\n\n".join(parts) + "\n"


STATES = {
    "finished": TrialState.COMPLETE,
    "ended early": TrialState.PRUNED,
    "failed": TrialState.FAIL,
    "running": TrialState.RUNNING,
    "waiting": TrialState.WAITING,
}


def _best(done: Sequence[FrozenTrial], config: StudyConfig) -> str:
    keys = list(config.space)
    rows = []
    for trial in done[:SHOWN]:
        values = config.values(trial.params)
        rows.append([str(trial.number), f"{trial.value:.3f}", *(_text(values[key]) for key in keys)])
    table = markdown_table(["trial", config.score, *map(_short, keys)], rows)
    note = "The best of many scores is a little too good: score best.yaml anew on seeds of its own."
    picture = "![Score of every trial](history.png)"
    return f"## The best {min(SHOWN, len(done))} trials\n\n{table}\n\n{note}\n\n{picture}"


def _importances(config: StudyConfig, importance: dict[str, float]) -> str:
    lines = [f"- {key}: {100 * share:.0f} %" for key, share in importance.items()]
    shares = "\n".join(lines) or "Too few finished trials to say."
    note = "How much each parameter sets the better trials apart from the others (PED-ANOVA)."
    picture = "![Score against every parameter; star: the best trial](parameters.png)"
    return f"## Importance of the parameters\n\n{note}\n\n{shares}\n\n{picture}"


def _short(key: str) -> str:
    return key.removeprefix("parameters.")


def _text(value: Any) -> str:
    return f"{value:.3g}" if isinstance(value, float) else json.dumps(value)
