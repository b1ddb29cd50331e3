"""PPO in one file, the way of CleanRL, on the native vector environment: python examples/libraries/cleanrl_ppo.py.

Needs torch and gymnasium. The environments of rj_gym restart in the step in which an episode ends (SAME_STEP), so that
`next_observation` is the first one of the next episode and the return of the last one is in `infos["final_info"]`.
"""

import argparse

import gymnasium
import numpy as np
import torch
from torch import nn
from torch.distributions import Normal

import rj_gym  # noqa: F401  (registers the environments)

GAMMA, LAMBDA, CLIP, EPOCHS, MINIBATCHES = 0.95, 0.95, 0.2, 4, 4


class Agent(nn.Module):
    """Actor and critic."""

    def __init__(self, observations: int, actions: int) -> None:
        super().__init__()
        self.actor = nn.Sequential(nn.Linear(observations, 64), nn.Tanh(), nn.Linear(64, actions))
        self.critic = nn.Sequential(nn.Linear(observations, 64), nn.Tanh(), nn.Linear(64, 1))
        self.log_std = nn.Parameter(-torch.ones(actions))

    def look(self, observation, action=None):
        """Action, its log-probability, the value of the state."""
        normal = Normal(self.actor(observation), self.log_std.exp())
        action = normal.sample() if action is None else action
        return action, normal.log_prob(action).sum(-1), self.critic(observation)[..., 0]


def rollout(agent, envs, observation, done, steps):
    """What was seen and done in `steps` steps, (steps, lanes, ...), and where the next rollout begins."""
    rows = []
    for _ in range(steps):
        with torch.no_grad():
            action, log_probability, value = agent.look(observation)
        following, reward, terminated, truncated, _ = envs.step(action.clamp(-1, 1).numpy())
        rows.append((observation, action, log_probability, value, torch.tensor(reward, dtype=torch.float32), done))
        observation = torch.tensor(following)
        done = torch.tensor(terminated | truncated, dtype=torch.float32)
    return [torch.stack(column) for column in zip(*rows, strict=True)], observation, done


def advantages(rewards, values, done, last_value, last_done):
    """Generalised advantage estimates, (steps, lanes)."""
    found, running = torch.zeros_like(rewards), torch.zeros_like(last_value)
    following, ended = last_value, last_done
    for step in reversed(range(len(rewards))):
        error = rewards[step] + GAMMA * following * (1 - ended) - values[step]
        running = error + GAMMA * LAMBDA * (1 - ended) * running
        found[step], following, ended = running, values[step], done[step]
    return found


def update(agent, optimiser, batch):
    """A few epochs of PPO over a batch of (rows, ...)."""
    observation, action, before, advantage, target = batch
    for _ in range(EPOCHS):
        for rows in torch.randperm(len(observation)).chunk(MINIBATCHES):
            _, log_probability, value = agent.look(observation[rows], action[rows])
            ratio, gain = (log_probability - before[rows]).exp(), advantage[rows]
            gain = (gain - gain.mean()) / (gain.std() + 1e-8)
            policy = -torch.min(ratio * gain, ratio.clamp(1 - CLIP, 1 + CLIP) * gain).mean()
            optimiser.zero_grad()
            (policy + 0.5 * (value - target[rows]).square().mean()).backward()
            nn.utils.clip_grad_norm_(agent.parameters(), 0.5)
            optimiser.step()


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("--env", default="rj_gym/RollingJoint-v0")
    parser.add_argument("--steps", type=int, default=100_000)
    parser.add_argument("--lanes", type=int, default=16)
    parser.add_argument("--seed", type=int, default=1)
    arguments = parser.parse_args()
    torch.manual_seed(arguments.seed)
    envs = gymnasium.make_vec(arguments.env, arguments.lanes, "vector_entry_point")
    observation = torch.tensor(envs.reset(seed=arguments.seed)[0])
    done = torch.zeros(arguments.lanes)
    agent = Agent(envs.single_observation_space.shape[0], envs.single_action_space.shape[0])
    optimiser = torch.optim.Adam(agent.parameters(), lr=1e-3, eps=1e-5)
    for count in range(1, max(1, arguments.steps // (128 * arguments.lanes)) + 1):
        columns, observation, done = rollout(agent, envs, observation, done, 128)
        seen, action, log_probability, value, reward, ended = columns
        with torch.no_grad():
            gain = advantages(reward, value, ended, agent.look(observation)[2], done)
        batch = [column.flatten(0, 1) for column in (seen, action, log_probability, gain, gain + value)]
        update(agent, optimiser, batch)
        print(f"{count * 128 * arguments.lanes:>7} steps: mean reward {float(np.mean(reward.numpy())):.3f}")
    envs.close()


if __name__ == "__main__":
    main()
