"""Bayesian search: a model of the cost proposes the next designs; by Optuna.

"tpe" models where good designs lie (Bergstra et al., "Algorithms for hyper-parameter optimization", NeurIPS 2011);
"gp" models the cost itself by a Gaussian process, in time that grows with the cube of the evaluations.
"""

from __future__ import annotations

import warnings
from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated, ClassVar

import numpy as np

from agents.runs.checks import check_fields, choice, integer
from agents.search.optimiser import Array, Derivatives, Evaluated, Setup

if TYPE_CHECKING:
    from optuna.distributions import BaseDistribution


@dataclass
class Bayesian:
    """Optuna's samplers.

    Args:
        sampler: "tpe" or "gp".
        startup: first designs, drawn at random.
        batch: designs asked for at a time.
    """

    setup: Setup
    sampler: Annotated[str, choice("tpe", "gp")] = "tpe"
    startup: Annotated[int, integer(1, 100_000)] = 20
    batch: Annotated[int, integer(1, 100_000)] = 10

    wants: ClassVar[Derivatives] = ""

    def __post_init__(self) -> None:
        import optuna

        check_fields(self)
        optuna.logging.set_verbosity(optuna.logging.WARNING)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", optuna.exceptions.ExperimentalWarning)
            samplers = {
                "tpe": lambda: optuna.samplers.TPESampler(
                    n_startup_trials=self.startup, multivariate=True, constant_liar=True, seed=self.setup.seed
                ),
                "gp": lambda: optuna.samplers.GPSampler(n_startup_trials=self.startup, seed=self.setup.seed),
            }
            self.study = optuna.create_study(sampler=samplers[self.sampler]())
        names = [str(place) for place in range(self.setup.dimensions)]
        self.space: dict[str, BaseDistribution] = dict.fromkeys(
            names, optuna.distributions.FloatDistribution(-1.0, 1.0)
        )

    def ask(self, most: int) -> Array:
        """The next designs, (B, d)."""
        self.trials = [self.study.ask(self.space) for _ in range(min(self.batch, most))]
        return np.array([[trial.params[name] for name in self.space] for trial in self.trials])

    def tell(self, evaluated: Evaluated) -> None:
        """Add the costs to the study."""
        for trial, cost in zip(self.trials, evaluated.cost, strict=True):
            self.study.tell(trial, float(cost))
