"""Processor seconds of one thread that an update of apg takes: to play the episodes, and to learn from them.

    OMP_NUM_THREADS=1 NUMBA_NUM_THREADS=1 python benchmarks/updates.py configs/train/apg_instrument.yaml env.n_envs=64

Behind the configuration come changes, as `rj train --set` takes them. Lessons are left out. The smallest of UPDATES
updates counts: other processes only add.
"""

from __future__ import annotations

import sys
import time
from typing import Any

from agents.runs.config import load_config
from agents.training.build import build_model, close

UPDATES = 24


def main() -> int:
    """Print the seconds."""
    config = load_config(sys.argv[1], [*sys.argv[2:], "parameters.lessons=0.0"])
    model: Any = build_model(config)
    times, update = [time.process_time()], model._update

    def timed(played: Any) -> None:
        times.append(time.process_time())
        update(played)
        times.append(time.process_time())

    model._update = timed
    steps = model.n_envs * model.get_env().get_attr("task", [0])[0].config.episode_steps
    model.learn((UPDATES + 1) * steps)
    close(model)
    played, learned = (
        [after - before for before, after in zip(times[k:], times[k + 1 :], strict=False)][2::2] for k in (0, 1)
    )
    whole = min(sum(pair) for pair in zip(played, learned, strict=True))
    print(f"{model.n_envs} lanes: {min(played):.4f} to play, {min(learned):.4f} to learn, {whole:.4f} s together")
    return 0


if __name__ == "__main__":
    sys.exit(main())
