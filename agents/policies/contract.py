"""The contract of a policy in a foreign format: its inputs and outputs, as plain values."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator
from typing import Any, cast

from agents.policies.shipped import ShippedPolicy
from rj_gym.core.task import Entry
from rj_gym.registry import task_of
from rj_gym.tracking.task import TrackingTask

CONTRACT = 1  # version of the keys
WIDTH = 220  # of printed lines: an entry with its normaliser
VECTOR, ACTION, MEMORY, NEXT_MEMORY = "observation", "action", "memory", "next_memory"


def contract(policy: ShippedPolicy) -> dict[str, Any]:
    """Inputs, outputs and origin of a policy, ready for JSON; docs/interchange.md lists the keys.

    A physical quantity is `scale` times the entry, in `unit`. The normaliser turns an entry x into
    clip((x - mean) / scale of the normaliser, -clip, clip); files in foreign formats have it inside.
    """
    content = policy.to_dict()
    memory = 0 if (start := policy.network.start(1)) is None else start.shape[1]
    remembered = [{"name": MEMORY, "size": memory, "start": 0.0}] if memory else []
    values = {
        "contract": CONTRACT,
        "name": policy.name,
        "algorithm": policy.algorithm,
        "sha256": policy.sha256,
        "environment": {"id": policy.env_id, "settings": content["environment"]["settings"]},
        "inputs": [*_observations(policy), *remembered],
        "outputs": [
            {"name": ACTION, "size": len(policy.network.low), "entries": _actions(policy)},
            *([{"name": NEXT_MEMORY, "size": memory}] if memory else []),
        ],
        "memory": memory,
        "training": content["training"],
        "score": content["score"],
    }
    return cast(dict[str, Any], json.loads(json.dumps(values, allow_nan=False)))  # no tuples: as it is read back


def contract_text(values: Any, indent: str = "") -> str:
    """A contract as JSON for people: short values, such as an entry, in one line."""
    text = json.dumps(values)
    if not isinstance(values, (dict, list)) or len(indent) + len(text) <= WIDTH:
        return text
    inner = f"{indent}  "
    if isinstance(values, dict):
        lines = [f"{inner}{json.dumps(key)}: {contract_text(value, inner)}" for key, value in values.items()]
    else:
        lines = [f"{inner}{contract_text(value, inner)}" for value in values]
    first, last = "{}" if isinstance(values, dict) else "[]"
    return "\n".join([first, ",\n".join(lines), f"{indent}{last}"])


def _observations(policy: ShippedPolicy) -> list[dict[str, Any]]:
    """The inputs that an environment gives: one vector, or the parts of a dictionary in the order of concatenation."""
    task, network, first = task_of(policy.settings), policy.network, 0
    parts = []
    for name, size in (dict(network.inputs) or {VECTOR: network.entries}).items():
        named = task.entries(policy.goal) if name == VECTOR else _goal_entries(task, name)
        places = range(first, first + size)
        entries = [_entry(entry, task.length) | _normaliser(policy, i) for entry, i in zip(named, places, strict=True)]
        parts.append({"name": name, "size": size, "entries": entries})
        first += size
    return parts


def _goal_entries(task: TrackingTask, name: str) -> Iterator[Entry]:
    """The entries of a goal: a position in units of the length, and, where the task has one, an orientation."""
    point = "target" if name.startswith("desired") else "tip"
    for i, bound in enumerate(task.goal_bounds()):
        axis = "xyz"[i] if i < task.dimension else f"orientation {i - task.dimension}"
        yield Entry(f"{point} {axis}", "L" if i < task.dimension else "1", -float(bound), float(bound))


def _actions(policy: ShippedPolicy) -> list[dict[str, Any]]:
    """The actions: the pull of each tendon, in units of action_scale_mm, negative ones let out; then the feed."""
    scale = policy.settings.action_scale_mm
    bounds = zip(policy.network.low, policy.network.high, strict=True)
    actions = [
        {"name": f"tendon {j} pulled in", "unit": "mm", "scale": scale, "low": float(low), "high": float(high)}
        for j, (low, high) in enumerate(bounds)
    ]
    if len(actions) > policy.mechanism.n_tendons:
        actions[-1] |= {"name": "base moved on", "scale": getattr(policy.settings, "feed_scale_mm", scale)}
    return actions


def _entry(entry: Entry, length: float) -> dict[str, Any]:
    """Name, unit, scale and bounds of an entry; L, the unit of positions, is the length of the mechanism in mm."""
    number = re.fullmatch(r"(\d\S*) (\w+)", entry.unit)
    scale, unit = (float(number[1]), number[2]) if number else (1.0, entry.unit)
    if unit == "L":
        scale, unit = length, "mm"
    return {"name": entry.name, "unit": unit, "scale": scale, "low": float(entry.low), "high": float(entry.high)}


def _normaliser(policy: ShippedPolicy, place: int) -> dict[str, Any]:
    network = policy.network
    newest = network.mean.size - network.entries  # of several observations the last one
    values = {name: float(getattr(network, name)[newest + place]) for name in ("mean", "scale", "clip")}
    return {"normaliser": values}
