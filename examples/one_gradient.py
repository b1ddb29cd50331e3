"""Surfaces and a policy by one gradient: an instrument and how it yields are trained together to press less in lumens.

Run: python examples/one_gradient.py [--updates N]
"""

import argparse
from pathlib import Path

import numpy as np
import torch

from agents.codesign.lumen import LumenPush
from agents.codesign.pair import PairSettings, Splits, trained
from rollingjoint.design import DesignSpace, LateralStiffness, Limit, Problem, measure
from rollingjoint.io.mechanism_file import load_mechanism

INSTRUMENT = Path(__file__).resolve().parents[1] / "configs/mechanism/lumen_instrument.yaml"
PAYLOAD = LateralStiffness(tensions=((5.0, 5.0, 5.0, 5.0),), force=0.05)


def main(argv: list[str] | None = None) -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--updates", type=int, default=20)
    options = parser.parse_args(argv)
    torch.set_num_threads(1)
    mechanism = load_mechanism(INSTRUMENT)
    space = DesignSpace.of(mechanism, convexity=(-0.1, 0.12), hole_radius=(-1.0, 0.6), symmetric=True)
    task = LumenPush(family="hard", mu=0.3, low=2.0, hidden=()).on(space)
    least = float(measure(mechanism, [PAYLOAD])[0])
    problem = Problem(space, (), (Limit(PAYLOAD, low=least),))
    splits = Splits(task.episodes(range(24)), 24, task.episodes(range(100, 112)), task.episodes(range(200, 224)))
    settings = PairSettings(updates=options.updates, batch=12, check_every=5)
    start = np.asarray(space.reference()), task.policy.initial(1)
    print(f"passive: {task.scores(*start, splits.test).values.mean():.2f} N")
    for name, by_design in (("policy alone", False), ("surfaces, holes and policy", True)):
        pair = trained(task, problem, start, settings, splits, 1, by_design)
        force = task.scores(pair.x, pair.parameters, splits.test).values.mean()
        stiffness = float(problem.evaluate(pair.x[None]).limited[0, 0])
        print(f"{name}: {force:.2f} N, as stiff as {stiffness / least:.2f} instruments")


if __name__ == "__main__":
    main()
