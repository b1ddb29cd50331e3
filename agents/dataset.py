"""Write episodes of any controller as a Minari dataset: rj dataset CONTROLLER --steps N --out WHERE.

CONTROLLER is a shipped policy, a policy file, a run folder, a baseline or tuned opponent by name, FILE.py:NAME or
MODULE:NAME. docs/interchange.md shows how to read the dataset.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from agents.runs.command_line import exit_code, progress_bar, typed_command
from agents.runs.config import apply_overrides
from agents.runs.consent import add_consent, consent_of
from agents.runs.environment import EnvConfig
from agents.runs.seeds import DATA
from rollingjoint.errors import ConfigError

if TYPE_CHECKING:
    from agents.controllers.controller import Controller
    from agents.evaluation.minari_dataset import read_dataset, write_dataset

__all__ = ["main", "read_dataset", "write_dataset"]

NAMED = "a shipped policy, a policy file, a run folder, a baseline or opponent by name, or FILE.py:NAME"
WHERE = "id of the dataset (joint/feedback-v0, where minari.load_dataset finds it), or a folder"


def __getattr__(name: str) -> Any:
    """`write_dataset` and `read_dataset`, which need the extra `data`."""
    if name not in ("write_dataset", "read_dataset"):
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    from agents.evaluation import minari_dataset

    return getattr(minari_dataset, name)


def main(argv: Sequence[str] | None = None) -> int:
    """Exit code of the command: 0 written, 2 an error."""
    parser = argparse.ArgumentParser(prog="rj dataset", description="Write episodes as a Minari dataset.")
    parser.add_argument("controller", help=NAMED)
    parser.add_argument("--env", help="id of the environment (default: that of the policy, or the plain one)")
    parser.add_argument(
        "--set", action="append", default=[], metavar="KEY=VALUE", help="setting of the environment, repeatable"
    )
    parser.add_argument("--steps", type=int, required=True, help="how many at least; episodes are whole")
    parser.add_argument("--out", required=True, metavar="WHERE", help=WHERE)
    parser.add_argument("--seed", type=int, default=DATA.start, help="of the first episode (default %(default)s)")
    parser.add_argument("--info", action="append", default=[], metavar="NAME", help="info to keep beside error_mm")
    add_consent(parser)
    arguments = parser.parse_args(argv)
    return exit_code(lambda: _command(arguments, typed_command("rj dataset", argv)), consent_of(arguments))


def _command(arguments: argparse.Namespace, command: Sequence[str]) -> int:
    from agents.controllers.controller import env_for
    from agents.evaluation.minari_dataset import write_dataset
    from agents.evaluation.recording import ERROR

    controller, env = _named(arguments.controller, arguments.env)
    env = env_for(replace(env, settings=apply_overrides(dict(env.settings), arguments.set)), controller)
    about = {"algorithm_name": arguments.controller, "description": " ".join(command)}
    infos = tuple(dict.fromkeys([ERROR, *arguments.info]))
    counted = 0
    with progress_bar(max(arguments.steps, 0), " steps", unit_scale=True) as bar:

        def count(steps: int) -> None:
            nonlocal counted
            counted += steps
            bar.update(steps)

        folder = write_dataset(
            env, controller, arguments.steps, arguments.out, arguments.seed, infos, about, progress=count
        )
    size = sum(path.stat().st_size for path in folder.rglob("*") if path.is_file())
    print(f"{folder}: {counted:,} steps of {env.id}, {size / 1e6:.1f} MB")
    return 0


def _named(text: str, env_id: str | None) -> tuple[Controller, EnvConfig]:
    """The controller that the text names, and its environment; raises ConfigError where there is none."""
    from agents.controllers.controller import load_controller
    from agents.controllers.residual import controllers_in
    from agents.controllers.tuned import hint, world_of
    from agents.policies.file import SUFFIX
    from agents.policies.loading import list_policies, load_policy
    from agents.policies.trained import load_driving
    from agents.runs.folder import RunFolder
    from rj_gym.registry import version_of

    env = EnvConfig(env_id or EnvConfig.id)
    if text in list_policies() or text.endswith(SUFFIX):
        policy = load_policy(text, version=version_of(env_id) if env_id and text in list_policies() else None)
        return policy, env if env_id else policy.environment
    if Path(text).is_dir():
        run = RunFolder.open(Path(text))
        return load_driving(run), env if env_id else run.config().env
    controllers = controllers_in(world_of(env))
    if text in controllers:
        return controllers[text], env
    if ":" in text:
        return load_controller(text), env
    names = [*controllers, *list_policies()]
    raise ConfigError("controller", text, f"{NAMED}: {', '.join(names)}", hint(text, names))


if __name__ == "__main__":
    sys.exit(main())
