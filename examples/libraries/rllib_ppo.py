"""PPO of RLlib: python examples/libraries/rllib_ppo.py. Needs ray[rllib].

RLlib pins an older gymnasium; the pin is only a pin: install ray[rllib] first, then gymnasium 1.4 again.
"""

import argparse

import gymnasium
import ray
from ray.rllib.algorithms.ppo import PPOConfig
from ray.tune.registry import register_env

import rj_gym  # noqa: F401  (registers the environments)


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("--env", default="rj_gym/RollingJoint-v0")
    parser.add_argument("--iterations", type=int, default=10)
    arguments = parser.parse_args()
    ray.init(address="local", num_cpus=2, include_dashboard=False)
    register_env("rolling joint", lambda config: gymnasium.make(arguments.env))
    config = (
        PPOConfig()
        .environment("rolling joint")
        .env_runners(num_env_runners=0, num_envs_per_env_runner=16)
        .training(lr=1e-3, gamma=0.95, train_batch_size_per_learner=2000, minibatch_size=500, num_epochs=4)
        .learners(num_learners=0)
    )
    algorithm = config.build_algo()
    for count in range(1, arguments.iterations + 1):
        found = algorithm.train()["env_runners"]
        print(f"iteration {count}: mean return {found.get('episode_return_mean', float('nan')):.2f}")
    algorithm.stop()
    ray.shutdown()


if __name__ == "__main__":
    main()
