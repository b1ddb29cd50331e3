"""PPO of TorchRL: python examples/libraries/torchrl_ppo.py. Needs torchrl."""

import argparse

import gymnasium
import torch
from tensordict.nn import TensorDictModule
from tensordict.nn.distributions import NormalParamExtractor
from torch import nn
from torchrl.collectors import Collector
from torchrl.envs import GymWrapper, RewardSum, TransformedEnv
from torchrl.modules import ProbabilisticActor, TanhNormal, ValueOperator
from torchrl.objectives import ClipPPOLoss
from torchrl.objectives.value import GAE

import rj_gym  # noqa: F401  (registers the environments)


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("--env", default="rj_gym/RollingJoint-v0")
    parser.add_argument("--steps", type=int, default=20_000)
    arguments = parser.parse_args()
    torch.manual_seed(1)
    env = TransformedEnv(GymWrapper(gymnasium.make(arguments.env)), RewardSum())
    entries, actions = env.observation_spec["observation"].shape[-1], env.action_spec.shape[-1]
    network = nn.Sequential(nn.Linear(entries, 64), nn.Tanh(), nn.Linear(64, 2 * actions), NormalParamExtractor())
    actor = ProbabilisticActor(
        TensorDictModule(network, in_keys=["observation"], out_keys=["loc", "scale"]),
        in_keys=["loc", "scale"],
        distribution_class=TanhNormal,
        return_log_prob=True,
    )
    critic = ValueOperator(nn.Sequential(nn.Linear(entries, 64), nn.Tanh(), nn.Linear(64, 1)), in_keys=["observation"])
    estimate = GAE(gamma=0.95, lmbda=0.95, value_network=critic)
    loss = ClipPPOLoss(actor, critic, clip_epsilon=0.2, entropy_coeff=0.0)
    optimiser = torch.optim.Adam(loss.parameters(), lr=1e-3)
    batch = min(1000, arguments.steps)
    collector = Collector(env, actor, frames_per_batch=batch, total_frames=arguments.steps)
    for count, data in enumerate(collector, 1):
        estimate(data)
        for _ in range(4):
            for rows in torch.randperm(len(data)).chunk(4):
                losses = loss(data[rows])
                optimiser.zero_grad()
                (losses["loss_objective"] + losses["loss_critic"]).backward()
                optimiser.step()
        print(f"{count * batch:>7} steps: mean reward {data['next', 'reward'].mean():.3f}")
    collector.shutdown()


if __name__ == "__main__":
    main()
