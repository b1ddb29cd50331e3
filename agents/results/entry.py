"""A user's controller among the results: its episodes as a record, and its row in the table."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from agents.controllers.controller import Controller
from agents.evaluation.rollout import run_episodes
from agents.policies.loading import shipped_policies
from agents.results.description import description
from agents.results.environment import changed, environment_of, episodes_key, plain
from agents.results.merging import merged
from agents.results.record import (
    BASELINE,
    ENTRY,
    POLICY,
    SWEEP,
    BenchmarkRecord,
    ControllerRecord,
    EpisodeScores,
    Results,
    RunRecord,
    World,
)
from agents.results.roster import can_drive, is_privileged, opponents
from agents.results.standings import Standings
from agents.results.wording import mm, with_interval
from agents.runs.environment import EnvConfig
from rollingjoint.tables import text_table


def enter(
    env: EnvConfig,
    controllers: Mapping[str, Controller],
    title: str,
    worlds: Sequence[World],
    kind: str = ENTRY,
    training_seed: int | None = None,
    command: Sequence[str] = (),
) -> Results:
    """Results of one benchmark: the episodes of controllers in worlds, without those that a controller refuses.

    Args:
        env: a tracking environment. controllers: by name. title: of the benchmark, where no other results give one.
        kind: of the controllers. training_seed: of a learned controller. command: that made the results.
    """
    records = []
    for name, controller in controllers.items():
        run = RunRecord(
            {
                world.name: EpisodeScores.of(
                    run_episodes(changed(env, world.changes), controller, world.seeds), world.role != SWEEP
                )
                for world in worlds
                if can_drive(env, world, controller)
            },
            training_seed,
        )
        records.append(ControllerRecord(name, kind, [run], is_privileged(controller)))
    text = description(env.arguments()["config"])
    record = BenchmarkRecord(title, text, env.id, plain(env), list(worlds), records)
    return Results([record], [" ".join(command)] if command else [])


def shipped(env: EnvConfig, title: str, world: World) -> Results:
    """Shipped policies that were trained for this task, and opponents, in the same episodes."""
    key = episodes_key(env)
    ours: dict[str, Controller] = {
        policy.name: policy for policy in shipped_policies() if episodes_key(policy.environment) == key
    }
    able, _ = opponents(env)
    return merged([enter(env, ours, title, [world], POLICY), enter(env, able, title, [world], BASELINE)])


def known_in(results: Results, env: EnvConfig, world: World) -> Results | None:
    """The benchmark of this environment in the results, if it has these episodes."""
    key = episodes_key(env)
    for record in results.benchmarks:
        same = any((candidate.name, candidate.seeds) == (world.name, world.seeds) for candidate in record.worlds)
        if same and episodes_key(environment_of(record)) == key:
            return Results([record])
    return None


def comparison_table(entered: Results, others: Results | None, world: World) -> str:
    """The entered controller and all others in the same episodes, for a terminal; the smallest mean first."""
    (record,) = merged([*([others] if others else []), entered]).benchmarks
    (name,) = entered.benchmarks[0].names()
    standing = Standings(record, record.world(world.name))
    rows = []
    for controller in sorted(standing.names, key=lambda controller: standing.mean(controller).value):
        summary = standing.summary(controller)
        figures = [with_interval(figure, mm) for figure in (summary.mean, summary.iqm, summary.median, summary.p95)]
        difference = "" if controller == name else with_interval(standing.compare(name, controller).difference, _signed)
        rows.append(
            [
                f"{controller} <--" if controller == name else controller,
                *figures,
                difference,
                f"{standing.runs(controller)}",
            ]
        )
    head = ["controller", "mean [mm]", "IQM [mm]", "median [mm]", "95 % below [mm]", f"{name} minus it [mm]", "runs"]
    return text_table(head, rows, ruled=True)


def _signed(value: float) -> str:
    return f"{value:+.3f}"
