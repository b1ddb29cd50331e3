"""How fast predictive control is: python benchmarks/mpc.py.

Per step of one episode, ten steps ahead, on one thread: microseconds of processor time of a plan and of a whole action
(its reading and belief, too), at the median and the 99th percentile, the number of equilibria that are solved, and
plans per second at the median. With --lanes 64 it times episodes side by side, per lane.
"""

from __future__ import annotations

import argparse
import time
from typing import Any

import numpy as np

from agents.controllers.mpc import Mpc, MpcFeedbackSettings
from agents.runs.environment import EnvConfig, make_vector_env
from rollingjoint import set_threads
from rollingjoint.tables import text_table

TASKS: dict[str, tuple[str, dict[str, Any]]] = {
    "five_link": ("rj_gym/RollingJoint-v0", {}),
    "two_segment": ("rj_gym/RollingJoint-v0", {"mechanism": "two_segment"}),
    "pitch_yaw_two_segment": ("rj_gym/PitchYaw-v0", {}),
}


def timed(env: EnvConfig, settings: dict[str, Any], lanes: int, episodes: int) -> tuple[np.ndarray, np.ndarray]:
    """Microseconds of every plan and of every action, per lane; the first episode is left out."""
    controller, envs = Mpc(MpcFeedbackSettings.from_dict({"mpc": settings})), make_vector_env(env, lanes)
    plans, actions = list[float](), list[float]()
    for episode in range(episodes + 1):
        observation, _ = envs.reset(seed=[episode * lanes + lane for lane in range(lanes)])
        controller.begin(envs, lanes)  # type: ignore[arg-type]
        plan = controller.planner.moves

        def watched(*arguments: Any, plan: Any = plan) -> Any:
            start = time.thread_time()
            moves = plan(*arguments)
            plans.append(time.thread_time() - start)
            return moves

        controller.planner.moves = watched  # type: ignore[method-assign]
        for _ in range(50):
            start = time.thread_time()
            action = controller.act(observation)
            actions.append(time.thread_time() - start)
            observation, *_ = envs.step(action)
        if episode == 0:
            plans.clear()
            actions.clear()
    envs.close()
    return 1e6 * np.array(plans) / lanes, 1e6 * np.array(actions) / lanes


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--lanes", type=int, default=1)
    parser.add_argument("--episodes", type=int, default=20)
    arguments = parser.parse_args()
    set_threads(1)
    rows = []
    for title, (env_id, changes) in TASKS.items():
        for solves in (2, 4, 8):
            env = EnvConfig(env_id, settings=changes)
            plans, actions = timed(env, {"horizon": 10, "solves": solves}, arguments.lanes, arguments.episodes)
            figures = (*np.percentile(plans, [50, 99]), *np.percentile(actions, [50, 99]))
            shown = (f"{value:.0f}" for value in figures)
            rows.append([title, str(solves * 11), *shown, f"{1e6 / figures[0]:,.0f}"])
    head = ["mechanism", "equilibria", "plan p50 [µs]", "p99", "action p50 [µs]", "p99", "plans per second"]
    print(text_table(head, rows))


if __name__ == "__main__":
    main()
