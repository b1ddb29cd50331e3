"""The afternoon of docs/rig.md on simulated rigs outside the training range: home, bench, identify, fine-tune, deploy.

    python benchmarks/rig_afternoon.py --robots 10

Every rig is a robot of the test bed (docs/robots.md) behind a simulated bus, on the virtual clock. Homing, bench and
adapting are the commands rj rig home, rj rig bench and rj adapt --recording. Then the shipped policy, and the adapted
one with the identified offsets, drive the same episodes, with targets and unknown loads of rj_gym/Instrument-v1; errors
are the true ones of the tip, means over the last 10 steps.
"""

from __future__ import annotations

import argparse
import contextlib
import io
import tempfile
import time
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import yaml

from agents import adapt
from agents.adaptation.driving import seeds_of
from agents.adaptation.robot import robot
from agents.policies.loading import load_policy
from agents.results.statistics import Bootstrap
from agents.rig.__main__ import main as rj_rig
from agents.rig.env import RigEnv
from agents.rig.settings import connected, load_rig
from rollingjoint import WorldForce

RIG = "mechanism: five_link\nmotors: {{radius_mm: 10, current_limit: 27}}\nsimulated: {{robot: {number}}}\n"
TRUE = {"play": "play_mm", "sheath": "sheath_friction", "mu": "mu", "stiffness": "stiffness"}


def main() -> None:
    """Print a row per rig, and means over them."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--robots", type=int, default=10)
    parser.add_argument("--first", type=int, default=0, help="number of the first robot")
    parser.add_argument("--steps", type=int, default=600, help="on the bench")
    parser.add_argument("--updates", type=int, default=100, help="of fine-tuning")
    parser.add_argument("--episodes", type=int, default=8, help="before and after")
    arguments = parser.parse_args()
    rows = []
    print(
        "| robot | play [mm] | sheath | mu | stiffness | offsets [mm] | left [sd] | before [mm] | after [mm] | time |"
    )
    print("|---|---|---|---|---|---|---|---|---|---|")
    for number in range(arguments.first, arguments.first + arguments.robots):
        with tempfile.TemporaryDirectory() as folder:
            rows.append(afternoon(number, Path(folder), arguments))
    before, after = np.array(rows).T
    resampled = Bootstrap(len(rows))
    for name, errors in (("before", before), ("after", after)):
        interval = resampled.mean(errors)
        print(f"{name}: {interval.value:.2f} [{interval.low:.2f}, {interval.high:.2f}] mm over {len(rows)} rigs")


def afternoon(number: int, folder: Path, arguments: argparse.Namespace) -> tuple[float, float]:
    """Mean tip errors of a rig before and after [mm]; prints its row, found / true."""
    begun = time.process_time()
    file, found = folder / "rig.yaml", folder / "found"
    file.write_text(RIG.format(number=number))
    run(rj_rig, "home", file)
    run(rj_rig, "bench", file, "--steps", arguments.steps, "--seed", number, "--out", folder / "bench.jsonl")
    before = driven(file, "instrument", number, arguments.episodes)
    words = ("--controller", "instrument", "--updates", arguments.updates, "--policies", found)
    run(adapt.main, "--recording", folder / "bench.jsonl", *words)
    file.write_text(RIG.format(number=number) + "identified: found\n")
    after = driven(file, str(found / "instrument_rig.safetensors"), number, arguments.episodes)
    seconds = time.process_time() - begun
    content = yaml.safe_load((found / "identified.yaml").read_text())
    cells = compared(content, number, true_offsets(file, content["offsets"]))
    cells += [f"{content['residual']['before']:.1f} -> {content['residual']['after']:.2f}"]
    cells += [f"{before.mean():.2f}", f"{after.mean():.2f} (median {np.median(after):.2f})", f"{seconds:.0f} s"]
    print("| " + " | ".join([str(number), *cells]) + " |", flush=True)
    return float(before.mean()), float(after.mean())


def run(command: Any, *words: object) -> None:
    """Run a command without its output; SystemExit with it where the command fails."""
    with contextlib.redirect_stdout(io.StringIO()) as output, contextlib.redirect_stderr(output):
        code = command([str(word) for word in words])
    if code != 0:
        raise SystemExit(f"{words[0]}: exit code {code}\n{output.getvalue()}")


def driven(file: Path, name: str, number: int, episodes: int) -> np.ndarray:
    """Tip errors of a policy on the rig of a file, (episodes,) [mm]."""
    policy, errors = load_policy(name), []
    simulated = gymnasium.make(policy.env_id, config=policy.settings).unwrapped
    with connected(load_rig(file)) as (rig, _):
        env, bus = RigEnv(policy.settings, rig), rig.poses.bus
        for seed in seeds_of(robot(number), episodes):
            _, info = simulated.reset(seed=seed)
            sampled, target = info["sampled"], info["target"]
            with bus.lock:
                bus.plant.carry([WorldForce(int(sampled["link"]), tuple(sampled["forces"][0]))])
            observation, _ = env.reset(options={"target": target})
            policy.reset()
            done, tips = False, []
            while not done:
                observation, _, _, done, _ = env.step(policy(observation))
                with bus.lock:
                    tips.append(bus.plant.tip)
            errors.append(np.linalg.norm(np.array(tips[-10:]) - target, axis=1).mean())
    simulated.close()
    return np.array(errors)


def true_offsets(file: Path, found: list[float]) -> np.ndarray:
    """True unstretched length minus position of the motors as they were recorded, (m,) [mm]."""
    with connected(load_rig(file)) as (rig, _):
        plant = rig.poses.bus.plant
        recorded = rig.state.motors - np.array(found)  # without the identified offsets, as on the bench
        return plant.q + plant.offsets - recorded


def compared(content: dict[str, Any], number: int, offsets: np.ndarray) -> list[str]:
    """Cells with numbers found and true, by kind."""
    one, parameters = robot(number), content["parameters"]
    cells = []
    for kind, digits in (*((kind, 2 if kind == "play" else 3) for kind in TRUE), ("offsets", 2)):
        truth = offsets if kind == "offsets" else getattr(one, TRUE[kind])
        numbers = [[parameters[f"{kind}[{j}]"]["value"] for j in range(len(truth))], truth]
        cells.append(" / ".join(" ".join(f"{value:.{digits}f}" for value in values) for values in numbers))
    return cells


if __name__ == "__main__":
    main()
