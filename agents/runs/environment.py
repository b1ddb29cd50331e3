"""The environment of a run, how Gymnasium makes it, and the columns by which policies are judged there."""

from __future__ import annotations

import copy
import sys
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import asdict, dataclass, field, replace
from functools import partial
from importlib import import_module
from typing import TYPE_CHECKING, Annotated, Any

import gymnasium

from agents.runs.additions import Addition, Unshown, are_scalar, are_shown, of_other_lanes, rendering, wrapped
from agents.runs.checks import check_fields, integer, prefixed
from agents.runs.consent import check_named
from rollingjoint.errors import ConfigError

if TYPE_CHECKING:
    from gymnasium.vector import VectorEnv
    from stable_baselines3.common.vec_env import VecEnv

    from rj_gym.registry import Registration
    from rj_gym.tracking.config import TaskConfig

AT_THE_END, LAST_10 = "mean_mm", "last_10_mm"
"""Mean tip error at the end of the episodes, and over their last 10 steps, as in the tables of results."""

COLUMNS = ("steps", AT_THE_END, "median_mm", "p95_mm", LAST_10, "mean_reward")
_WHEN = {AT_THE_END: "at the end", LAST_10: "over the last 10 steps"}


@dataclass(frozen=True)
class EnvConfig:
    """The environment of a run.

    Args:
        id: its id in Gymnasium.
        n_envs: number of environments that are stepped together.
        settings: keys of the settings class for environments of rj_gym, else arguments of `gymnasium.make`.
    """

    id: str = "rj_gym/RollingJoint-v0"
    n_envs: Annotated[int, integer(1, 1024)] = 16
    settings: Mapping[str, Any] = field(default_factory=dict)

    def __post_init__(self) -> None:
        if not isinstance(self.id, str) or not self.id:
            raise ConfigError("env.id", self.id, "the id of a Gymnasium environment")
        self._check_code()
        check_fields(self, "env.")
        if not isinstance(self.settings, Mapping):
            raise ConfigError("env.settings", self.settings, "a mapping of settings to values")
        self.arguments()

    def _check_code(self) -> None:
        """Raise ConfigError for the id of an environment in code that the command does not allow."""
        module, colon, name = self.id.rpartition(":")
        runs_nothing = module in sys.modules and name in gymnasium.registry
        if colon and not runs_nothing:
            check_named("env.id", self.id, module)
            with suppress(ImportError):  # Gymnasium says so when it makes the environment
                import_module(module)
        for registered, spec in gymnasium.registry.items():
            is_meant = registered == name or registered.startswith(f"{name}-v")  # Gymnasium fills in the newest version
            if is_meant and isinstance(spec.entry_point, str):  # else it is of a module that was imported
                check_named("env.id", self.id, spec.entry_point.partition(":")[0])

    @property
    def registration(self) -> Registration | None:
        """The row of rj_gym's table for its class; None for a class of another package."""
        from rj_gym.registry import row_of

        return row_of(self.id)

    @property
    def is_ours(self) -> bool:
        """Whether its class is one of rj_gym, whoever registered the id."""
        return self.id.startswith("rj_gym/") or self.registration is not None

    @property
    def is_tracking(self) -> bool:
        """Whether its task is to track a target, with a planar chain or an arm: these have baselines and floors."""
        return (row := self.registration) is not None and row.tracks

    @property
    def is_built_in(self) -> bool:
        """Whether rj_gym itself has registered the id."""
        return (row := self.registration) is not None and row.env_id == self.id

    @property
    def is_built_in_tracking(self) -> bool:
        """Whether it is one of the tracking environments that rj_gym itself has registered."""
        return self.is_tracking and self.is_built_in

    @property
    def judged_by(self) -> str:
        """The column of evaluations.csv that policies are chosen by: LAST_10 in tracking tasks, as in tables."""
        return LAST_10 if self.is_tracking else AT_THE_END

    @property
    def has_goals(self) -> bool:
        """Whether it is one of rj_gym's goal environments."""
        return (row := self.registration) is not None and row.has_goals

    @property
    def is_native(self) -> bool:
        """Whether many of it are stepped together by a vector environment of rj_gym."""
        spec = _spec_of(self.id)
        entry = None if spec is None or spec.additional_wrappers else spec.vector_entry_point
        return isinstance(entry, str) and entry.partition(":")[0].partition(".")[0] == "rj_gym"

    @property
    def why_scalar(self) -> str:
        """Why a registered vector environment is not used, one line; empty where it is, or where there is none."""
        spec = _spec_of(self.id)
        if spec is None or spec.vector_entry_point is None or self.is_native:
            return ""
        cause = "its vector_entry_point is a wrapper or not of rj_gym"
        return f"{self.id}: scalar environments are stepped in turn, for {cause}."

    def arguments(self) -> dict[str, Any]:
        """Keyword arguments for gymnasium.make; raises ConfigError for settings the environment does not have."""
        if not self.is_ours:
            return dict(self.settings)
        from rj_gym.registry import making_arguments, registered_settings

        with prefixed("env.settings: "):
            config = registered_settings(self.id, copy.deepcopy(dict(self.settings)))
        return making_arguments(self.id, config)

    @property
    def episode_steps(self) -> int | None:
        """Steps of an episode; None for an environment that is not one of rj_gym."""
        return self.arguments()["config"].episode_steps if self.is_ours else None

    @property
    def observes_past(self) -> bool:
        """Whether observations of this tracking task hold past readings."""
        return bool(self.arguments()["config"].lags)

    def complete_settings(self) -> dict[str, Any]:
        """Plain settings with defaults written in and the mechanism as its numbers.

        Of other ids than rj_gym's tasks of tendons they are as given.
        """
        if not (self.is_built_in and (row := self.registration) and row.has_policies):
            return dict(self.settings)
        from rj_gym.registry import task_of
        from rollingjoint.io.mechanism_file import mechanism_to_dict

        config = self.arguments()["config"]
        return plain_settings(config) | {"mechanism": mechanism_to_dict(task_of(config).mechanism) | {"name": ""}}


def plain_settings(config: TaskConfig) -> dict[str, Any]:
    """All settings of a tracking environment, or of one among walls, except the mechanism, as plain values.

    Raises:
        ConfigError: own terms, which are functions and have no place in a file.
    """
    either_task: Any = config
    if hasattr(config, "terms") and config.terms != type(config.terms)():
        hint = "Register an id of your own that brings them (docs/your_task.md)."
        raise ConfigError("terms", "own functions", "none in a file", hint)
    values = asdict(replace(either_task, mechanism=""))
    del values["mechanism"]
    values.pop("terms", None)
    return values


def make_env(config: EnvConfig, wrappers: Sequence[Addition] = (), **arguments: Any) -> gymnasium.Env:
    """One environment of the run in wrappers; raises ConfigError if Gymnasium cannot make it, or a wrapper."""
    with making(config):
        env = gymnasium.make(config.id, **config.arguments(), **arguments | rendering(wrappers))
    return wrapped(env, wrappers)


def make_vector_env(
    config: EnvConfig, count: int, wrappers: Sequence[Addition] = (), **arguments: Any
) -> VectorEnv[Any, Any, Any]:
    """A native vector environment of rj_gym with `count` copies; for ids without one, scalar ones stepped in turn.

    Scalar ones, too, in wrappers of scalar environments. Raises ConfigError as make_env.
    """
    if are_scalar(wrappers) or not config.is_native:
        return gymnasium.vector.SyncVectorEnv([partial(make_env, config, wrappers, **arguments)] * count)
    with making(config):
        vector, given = "vector_entry_point", arguments | rendering(wrappers)
        envs = gymnasium.make_vec(config.id, count, vector, **config.arguments(), **given)
    return wrapped(envs, wrappers)


def make_lanes(config: EnvConfig, count: int, wrappers: Sequence[Addition] = ()) -> VecEnv:
    """make_vector_env as Stable-Baselines3 wants it; of scalar ones in wrappers the first alone is shown or filmed."""
    if are_scalar(wrappers) or not config.is_native:
        from stable_baselines3.common.vec_env import DummyVecEnv

        one = partial(make_env, config, wrappers)

        def other() -> gymnasium.Env:
            env = make_env(config, of_other_lanes(wrappers), **rendering(wrappers))
            return Unshown(env) if are_shown(wrappers) else env

        return DummyVecEnv([one, *[other] * (count - 1)])
    from rj_gym.sb3 import SB3VecEnv

    same_step = gymnasium.vector.AutoresetMode.SAME_STEP
    return SB3VecEnv(make_vector_env(config, count, wrappers, autoreset_mode=same_step))


def _spec_of(env_id: str) -> Any:
    """The specification that an id is registered with in Gymnasium, or None."""
    import rj_gym  # noqa: F401  (registers its ids)

    return gymnasium.registry.get(env_id.rpartition(":")[2])


@contextmanager
def making(config: EnvConfig) -> Iterator[None]:
    """Registers the ids of rj_gym; a complaint of Gymnasium becomes a ConfigError."""
    if config.is_ours:
        import rj_gym  # noqa: F401
    try:
        yield
    except (gymnasium.error.Error, TypeError) as error:
        raise ConfigError("env", config.id, "an environment that Gymnasium can make", str(error)) from error


def tip_errors(info: Mapping[str, Any]) -> Any:
    """The tip errors in an info [mm]; raises ConfigError for an environment that does not report them."""
    if "error_mm" not in info:
        raise ConfigError("info", sorted(info), 'an environment that reports info["error_mm"], the tip error in mm')
    return info["error_mm"]


def in_words(column: str, error: float) -> str:
    """A mean tip error [mm] of one of these two columns."""
    return f"mean tip error {_WHEN[column]} {error:.3f} mm"
