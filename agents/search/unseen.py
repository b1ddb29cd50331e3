"""A design policy compared with other methods on unseen tasks: python -m agents.search.unseen runs/design.

Tasks are episodes of the policy's environment. Every method evaluates the same number of designs, the policy the
first design of the episode and its changes. A result is the smallest error of a valid design among them. With --page
the table goes between the two marks of a page.
"""

from __future__ import annotations

import argparse
import shlex
import sys
import time
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from agents.runs.checks import integer
from agents.runs.command_line import exit_code, typed_command
from agents.runs.consent import add_consent, consent_of
from agents.runs.environment import EnvConfig
from agents.runs.files import write_text
from agents.runs.folder import RunFolder
from agents.search.compare import around
from agents.search.methods import make
from agents.search.optimiser import Array, Setup
from agents.search.run import evaluated_by
from rollingjoint.errors import ConfigError
from rollingjoint.tables import markdown_table

if TYPE_CHECKING:
    from rj_gym import CurvatureDesignVectorEnv

BEGIN, END = "<!-- begin: python -m agents.search.unseen -->", "<!-- end -->"
FIRST_SEED = 3_000_000  # of the tasks; used for no other purpose
METHODS: Mapping[str, Mapping[str, Any]] = {  # and settings for a budget of a few designs
    "random": {},
    "latin_hypercube": {},
    "cma_es": {},
    "gradient": {"starts": 2},
    "sqp": {"starts": 2},
}


def main(argv: Sequence[str] | None = None) -> int:
    """Exit code of the command: 0 compared, 2 an error."""
    parser = argparse.ArgumentParser(prog="python -m agents.search.unseen", description="Judge a policy that designs.")
    parser.add_argument("run", type=Path, help="run folder of a policy trained on rj_gym/CurvatureDesign-v0")
    parser.add_argument("--tasks", type=int, default=100, help="tasks (default 100)")
    parser.add_argument("--budget", type=int, default=20, help="designs that each method evaluates (default 20)")
    parser.add_argument("--page", type=Path, help="page with the two marks")
    add_consent(parser)
    arguments = parser.parse_args(argv)
    command = typed_command("python -m agents.search.unseen", argv)
    return exit_code(lambda: _command(arguments, command), consent_of(arguments))


def _command(arguments: argparse.Namespace, command: Sequence[str]) -> int:
    tasks = integer(1)("--tasks", arguments.tasks)
    run = RunFolder.open(arguments.run)
    env = run.config().env
    from rj_gym import DESIGN_IDS

    if DESIGN_IDS.get(env.id) != "CurvatureDesign":
        raise ConfigError("env.id", env.id, "a policy trained on rj_gym/CurvatureDesign-v0")
    budget = integer(2, env.arguments()["config"].episode_steps + 1)("--budget", arguments.budget)
    parts = around(arguments.page, BEGIN, END) if arguments.page else ("", "")
    text = compared(run, env, tasks, budget)
    print(text)
    if arguments.page:
        about = f"```sh\n{shlex.join(command)}\n```"
        write_text(arguments.page, "\n\n".join([parts[0] + BEGIN, about, text, END + parts[1]]))
    return 0


def compared(run: RunFolder, env: EnvConfig, tasks: int, budget: int) -> str:
    """The smallest errors of the policy and of every method on the tasks, as a table with a sentence."""
    import torch

    torch.set_num_threads(1)
    results = {"policy": _timed(lambda: _policy_errors(run, env, tasks, budget))}
    for name in METHODS:
        results[name] = _timed(lambda name=name: _method_errors(name, env, tasks, budget))  # type: ignore[misc]
    head = ["method", "mean", "median", "95 % below", "better than the policy", "seconds a task"]
    rows = [_row(name, errors, results["policy"][0], seconds / tasks) for name, (errors, seconds) in results.items()]
    says = (
        f"Smallest error [mm] of a valid design among {budget}, on {tasks} tasks (seeds from {FIRST_SEED:,}); a method "
        "has the seed of its task. Seconds are processor time; the policy works on all tasks at once."
    )
    return f"{markdown_table(head, rows)}\n\n{says}"


def _timed(work: Callable[[], Array]) -> tuple[Array, float]:
    begin = time.process_time()
    return work(), time.process_time() - begin


def _row(name: str, errors: Array, policy: Array, seconds: float) -> list[str]:
    numbers = [f"{value:.2f}" for value in (errors.mean(), np.median(errors), np.percentile(errors, 95))]
    better = "" if name == "policy" else f"{100 * np.mean(errors < policy):.0f} %"
    return [name.replace("_", " "), *numbers, better, f"{seconds:.2f}"]


def _policy_errors(run: RunFolder, env: EnvConfig, tasks: int, budget: int) -> Array:
    """Smallest error of the policy on every task, (tasks,) [mm]."""
    from agents.policies.trained import check_unwrapped, load_trained

    check_unwrapped(run.config())
    policy, envs = load_trained(run), _environments(env, tasks)
    observation, info = envs.reset(seed=FIRST_SEED)
    errors = [info["error_mm"]]
    for _ in range(budget - 1):
        observation, _, _, _, info = envs.step(policy.act(observation))
        errors.append(info["error_mm"])
    return np.min(errors, axis=0)


def _method_errors(name: str, env: EnvConfig, tasks: int, budget: int) -> Array:
    """Smallest error of a method on every task, (tasks,) [mm]; where no design was valid, the environment's largest."""
    from rollingjoint.design import BendingShapes, Problem, Term

    envs = _environments(env, tasks)
    sampled = envs.reset(seed=FIRST_SEED)[1]["sampled"]
    space, errors = envs.config.space, np.full(tasks, envs.config.largest_error_mm)
    for task in range(tasks):
        origins = np.pad(sampled["targets"][task], ((0, 0), (1, 0), (0, 0)))  # the base stays at the origin
        shapes = (sampled["tensions"][task], origins, sampled["forces"][task])
        problem = Problem(space, (Term(BendingShapes(*(part.tolist() for part in shapes))),))
        optimiser, remaining = make(name, Setup(space.dimensions, seed=FIRST_SEED + task), METHODS[name]), budget
        while remaining:
            evaluated = evaluated_by(problem, optimiser.wants, optimiser.ask(remaining))
            optimiser.tell(evaluated)
            remaining -= len(evaluated)
            errors[task] = min([errors[task], *evaluated.cost[evaluated.feasible].tolist()])
    return errors


def _environments(env: EnvConfig, count: int) -> CurvatureDesignVectorEnv:
    from rj_gym import CurvatureDesignVectorEnv

    return CurvatureDesignVectorEnv(count, **env.arguments())


if __name__ == "__main__":
    sys.exit(main())
