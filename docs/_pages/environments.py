"""One page for every registered environment, made of its docstrings, spaces and settings."""

from __future__ import annotations

import inspect
import re
from collections.abc import Iterator
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any

import griffe
import gymnasium
import replays

import rj_gym
from rj_gym.core.settings import Settings
from rj_gym.registry import TABLE, Registration

CHAIN_TASKS = ("fixed_target", "moving_target", "drifting_load", "stepping_load", "noisy", "two_segment")
TASKS = {  # of the results page, by the stem of the classes
    "RollingJoint": CHAIN_TASKS,
    "RollingJointGoal": ("fixed_target",),
    "Instrument": ("instrument",),
    "InstrumentShift": ("instrument_shift",),
    "SlowCamera": ("slow_camera",),
    "LatePose": ("late_pose",),
    "FlexibleArm": ("flexible_arm",),
    "FlexibleArmGoal": ("flexible_arm",),
    "ArmInstrument": ("arm_instrument",),
    "PitchYaw": ("pitch_yaw",),
    "ManyMechanisms": (),
    "ManyMechanismsInSpace": (),
    "CurvatureDesign": (),
    "CoDesign": (),
    "Lumen": (),
    "Obstacles": (),
    "HiddenWall": (),
}
TASKS |= {row.stem: () for row in TABLE if row.version}
PICTURES = {  # of environments without a task: file and caption
    "ManyMechanisms": ("generalist.gif", "One policy on six mechanisms that it has not seen."),
    "ManyMechanismsInSpace": ("generalist_space.gif", "One policy on six mechanisms in space that it has not seen."),
    "CurvatureDesign": ("design_environment.png", "First and last design of a policy."),
    "CoDesign": ("codesign.png", "The design at the start, and the mechanism in the control phase."),
    "Lumen": ("surroundings_lumen.gif", "A controller that knows the centre line, in a hard lumen."),
    "Obstacles": ("surroundings_obstacles.gif", "The way that the search of the episode has found."),
    "HiddenWall": ("surroundings_hidden_wall.gif", "A controller that is told the force touches the wall with 0.5 N."),
}
GUIDES = {"planar": "environment.md", "arm": "arm_environment.md", "design": "design_environment.md"}
GUIDES |= {"many": "generalist.md", "surroundings": "surroundings_tasks.md"}
PAGES = {f"{row.stem}Env": f"{row.env_id.split('/')[1]}.md" for row in TABLE}
TITLE = "# {name}\n\n`{env_id}`"


def pages() -> dict[str, str]:
    """A page for every id, and one that shows them all, by their path on the site."""
    every = {PAGES[f"{row.stem}Env"]: page(row) for row in TABLE} | {"index.md": overview()}
    return {f"environments/{name}": text for name, text in every.items()}


def page(row: Registration) -> str:
    """The page of an environment."""
    kind = environment_class(row)
    parts = [
        TITLE.format(name=row.stem, env_id=row.env_id),
        opening(kind),
        pictures(row),
        replay(row),
        facts(row),
        body(kind),
        "## Settings and their defaults",
        settings_table(rj_gym.settings_of(row.env_id)()),
        results(row),
    ]
    return "\n\n".join(filter(None, parts)) + "\n"


def overview() -> str:
    """The page of all environments: a card each."""
    cards = [
        f"- [![{row.stem}](../images/{moving(row)}){{ loading=lazy }}]({PAGES[f'{row.stem}Env']})\n\n"
        f"    **[{row.stem}]({PAGES[f'{row.stem}Env']})**\n\n    {first_line(row)}"
        for row in TABLE
    ]
    return "\n\n".join(["# Environments", '<div class="grid cards" markdown>', *cards, "</div>\n"])


def environment_class(row: Registration) -> type[gymnasium.Env[Any, Any]]:
    """The class of an environment; its import may need torch."""
    kind: type[gymnasium.Env[Any, Any]] = getattr(rj_gym, f"{row.stem}Env")
    return kind


def opening(kind: type) -> str:
    """The first paragraph of a docstring, with links."""
    return linked(inspect.cleandoc(kind.__doc__ or "")).partition("\n\n")[0]


def sections(kind: type) -> dict[str, str]:
    """The sections of a docstring by their heading, "" before the first; what it leaves to its base links there."""
    text = linked(inspect.cleandoc(kind.__doc__ or "")).partition("\n\n")[2]
    before, *parts = re.split(r"^## (.*)\n", text, flags=re.MULTILINE)
    own = {"": before.strip()} | {name: body.strip() for name, body in zip(parts[::2], parts[1::2], strict=True)}
    base = next((each for each in kind.__mro__[1:] if each.__name__ in PAGES), None)
    if base is None:
        return own
    page = PAGES[base.__name__]
    names = ["", *[name for name in sections(base) if name], *own]
    elsewhere = {name: f"As [{base.__name__}]({page}#{name.lower().replace(' ', '-')})." for name in names if name}
    return {name: (elsewhere | own)[name] for name in dict.fromkeys(names)}


def body(kind: type) -> str:
    """The sections one below the other."""
    parts = sections(kind).items()
    return "\n\n".join(f"## {name}\n\n{text}" if name else text for name, text in parts)


def first_line(row: Registration) -> str:
    """What the environment is, without links."""
    line = inspect.cleandoc(environment_class(row).__doc__ or "").partition("\n\n")[0]
    return re.sub(r": as \w+ but for what follows", "", " ".join(line.split()))


def linked(text: str) -> str:
    """A docstring whose names of rj_gym are links: environments to their page, others to the reference."""

    def link(found: re.Match[str]) -> str:
        name = found[1]
        if name in PAGES:
            return f"[{name}]({PAGES[name]})"
        return f"[{name}][rj_gym.{name}]" if name in rj_gym.__all__ else name

    lines = [re.sub(r"(?<![\w`./\[])([A-Z]\w+(?:Env|Config))(?![\w`(])", link, line) for line in text.splitlines()]
    return "\n".join(lines)


def moving(row: Registration) -> str:
    """The picture that stands for an environment; of all versions that of the first."""
    stem = row.stem.removesuffix(f"V{row.version}")
    return f"results_{TASKS[stem][0]}.gif" if TASKS[stem] else PICTURES[stem][0]


def caption(row: Registration) -> str:
    """What the picture shows."""
    stem, where = row.stem.removesuffix(f"V{row.version}"), " in version 0" if row.version else ""
    words = "Best, median and worst test episode of a policy." if TASKS[stem] else PICTURES[stem][1]
    return words.replace(".", f"{where}.")


def pictures(row: Registration) -> str:
    """Its first picture; those of its other tasks stand below, beside the results."""
    return f"![{caption(row)}](../images/{moving(row)})\n\n<small>{caption(row)}</small>"


def replayed() -> list[str]:
    """The tasks of which an episode is shown in space: the first of every environment that has one."""
    return list(dict.fromkeys(tasks[0] for tasks in TASKS.values() if tasks))


def replay(row: Registration) -> str:
    """An episode to look at from all sides, where it can be recorded."""
    if not TASKS[row.stem] or not replays.can_be_recorded():
        return ""
    task = TASKS[row.stem][0]
    page, words = f"../replays/{task}.html", " ".join(replays.words(task, Path(f"{task}.html")))
    return (
        f'<iframe class="replay" src="{page}" title="An episode in space" loading="lazy"></iframe>\n\n'
        f"<small>An episode of the shipped policy; drag to turn it, or [open it alone]({page}). "
        f"`rj view {words}` made this page.</small>"
    )


def facts(row: Registration) -> str:
    """How to make it, its spaces and its classes."""
    env = gymnasium.make(row.env_id)
    rows = {
        "make": f'`gymnasium.make("{row.env_id}")`',
        "make many": f'`gymnasium.make_vec("{row.env_id}", 64, "vector_entry_point")`',
        "action space": f"`{env.action_space}`",
        "observation space": f"`{space(env.observation_space)}`",
        "classes": " ".join(f"[{name}][rj_gym.{name}]" for name in row.classes),
        "needs": 'torch: `pip install ".[design]"`' if row.family == "design" else "nothing but the base install",
        "guide": f"[{GUIDES[row.family]}](../{GUIDES[row.family]})",
    }
    env.close()
    return "\n".join(["| | |", "|:--|:--|", *(f"| {name} | {value} |" for name, value in rows.items())])


def space(of: gymnasium.Space[Any]) -> str:
    """A space in one line; bounds of its entries are in the table below it."""
    if isinstance(of, gymnasium.spaces.Dict):
        return "Dict(" + ", ".join(f"{key}: {space(part)}" for key, part in of.spaces.items()) + ")"
    return f"Box({of.shape}, {of.dtype})"


@dataclass(frozen=True)
class Setting:
    """One setting: its name, with those of the settings around it, its default and its meaning."""

    name: str
    default: Any
    meaning: str


def settings_table(settings: Settings) -> str:
    """Every setting with its default and meaning."""
    rows = [f"| `{each.name}` | `{each.default!r}` | {each.meaning} |" for each in every_setting(settings)]
    return "\n".join(["| setting | default | meaning |", "|:--|:--|:--|", *rows])


def every_setting(settings: Settings, section: str = "") -> Iterator[Setting]:
    """Settings in the order of their fields, nested ones where they stand."""
    meanings = arguments(type(settings))
    for field in fields(settings):  # type: ignore[arg-type]
        value = getattr(settings, field.name)
        if isinstance(value, Settings):
            yield from every_setting(value, f"{section}{field.name}.")
        else:
            yield Setting(section + field.name, value, meanings.get(field.name, ""))


def arguments(kind: type) -> dict[str, str]:
    """What docstrings of a class and its bases say about its arguments."""
    found: dict[str, str] = {}
    for base in kind.__mro__:
        sections = griffe.Docstring(inspect.cleandoc(base.__doc__ or "")).parse("google", warnings=False)
        for section in sections:
            if isinstance(section, griffe.DocstringSectionParameters):
                said = {name: each.description for each in section.value for name in each.name.split(", ")}
                found = {name: " ".join(text.split()) for name, text in said.items()} | found
    return found


def results(row: Registration) -> str:
    """The tasks of the results page that are played in this environment, each with its animation."""
    tasks = TASKS[row.stem]
    if not tasks or row.stem.endswith("Goal"):
        return ""
    lines = [f"- [{name.replace('_', ' ')}](../results.md#{name.replace('_', '-')})" for name in tasks]
    films = [f"![{name.replace('_', ' ')}](../images/results_{name}.gif){{ loading=lazy }}" for name in tasks[1:]]
    return "\n\n".join(["## Results", "How well controllers do in it:", "\n".join(lines), *films])
