"""Inverse design by linear feedback: a matrix from shape deviations to design changes, fitted to random changes.

The matrix is fitted by least squares to changes that the environment shows, then used as a controller on new tasks.
"""

import numpy as np
import torch

import rj_gym

torch.set_num_threads(1)


def main() -> None:
    envs = rj_gym.CurvatureDesignVectorEnv(128)
    scale, rng = envs.config.action_scale, np.random.default_rng(0)

    _, before = envs.reset(seed=0)
    shapes, designs = [], []
    for _ in range(12):
        _, _, _, _, after = envs.step(rng.uniform(-0.5, 0.5, envs.action_space.shape))
        both = before["valid"] & after["valid"]
        shapes.append((after["positions"] - before["positions"])[both].reshape(both.sum(), -1))
        designs.append((after["design"] - before["design"])[both])
        before = after
    changes, wanted = np.concatenate(shapes), np.concatenate(designs)
    gram = changes.T @ changes + 1e3 * np.eye(changes.shape[1])  # mm²: what is hardly seen changes little
    matrix = np.linalg.solve(gram, changes.T @ wanted)

    _, info = envs.reset(seed=1_000_000)
    targets, start = info["sampled"]["targets"], info["error_mm"]
    actions, gains = np.zeros(envs.action_space.shape), np.full((envs.num_envs, 1), 0.5)
    for _ in range(envs.config.episode_steps):
        deviations = (targets - info["positions"]).reshape(envs.num_envs, -1)
        valid = info["valid"][:, None]
        gains = np.where(valid, gains, 0.3 * gains)  # smaller changes after a design that was not valid
        actions = np.where(valid, np.clip(gains * deviations @ matrix / scale, -1, 1), -actions)
        _, _, _, _, info = envs.step(actions)
    print(f"mean error at the start {start.mean():.2f} mm, after {envs.config.episode_steps} changes", end=" ")
    print(f"{info['error_mm'].mean():.2f} mm; valid: {info['valid'].mean():.0%}")


if __name__ == "__main__":
    main()
