"""A mechanism as a layer: a small network learns which tendon lengths bring the tip to a target.

Nobody tells it the right lengths. Its commands go into the mechanism, and the miss of the tip comes back through the
equilibria to its weights.

Run: python examples/equilibrium_layer.py [--out DIR] [--steps N] [--seed N]
"""

import argparse
from pathlib import Path

import matplotlib
import torch

matplotlib.use("Agg")
from matplotlib import pyplot

import rollingjoint as rj
from rollingjoint.differentiable import DifferentiableChain, Equilibria, solve_lengths
from rollingjoint.plotting import PALETTE, save_figure

TRAVEL = 16.0  # mm that a pair of tendons may be pulled and released
FOLLOWS = 2 / 3  # of what the first pair moves, the second moves when only the first segment bends: their holes' ratio
MIDDLE, SPREAD = (-24.0, 83.0), (20.0, 6.0)  # mm, of the targets
STRETCH = 4.0  # mm by which every tendon is stretched before any is pulled


class LengthCommand(torch.nn.Module):
    """From targets (B, 2) [mm] to unstretched lengths of the four tendons (B, 4) [mm]."""

    def __init__(self, mechanism: rj.RollingChain, hidden: int = 64) -> None:
        super().__init__()
        self.register_buffer("neutral", torch.as_tensor(mechanism.neutral_lengths - STRETCH))
        layers = torch.nn.Linear(2, hidden), torch.nn.Linear(hidden, hidden), torch.nn.Linear(hidden, 2)
        self.network = torch.nn.Sequential(layers[0], torch.nn.Tanh(), layers[1], torch.nn.Tanh(), layers[2])

    def forward(self, targets: torch.Tensor) -> torch.Tensor:
        """The lengths."""
        scaled = (targets - torch.tensor(MIDDLE)) / torch.tensor(SPREAD)
        return self.pulled(torch.sigmoid(self.network(scaled.float())))

    def pulled(self, share: torch.Tensor) -> torch.Tensor:
        """Lengths for shares (B, 2) in [0, 1] of the travel: what one tendon of a pair gains, the other loses.

        The first segment bends to the left and the second one to the right of it: else a tip has two commands.
        """
        first, second = TRAVEL * share.double().T
        second = second - FOLLOWS * first
        return self.neutral + torch.stack([-first, first, second, -second], -1)


def main(argv: list[str] | None = None) -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, default=Path("out"))
    parser.add_argument("--steps", type=int, default=150)
    parser.add_argument("--seed", type=int, default=0)
    arguments = parser.parse_args(argv)
    torch.set_num_threads(1)
    torch.manual_seed(arguments.seed)
    errors, targets, tips = learn(rj.two_segment(), arguments.steps)
    arguments.out.mkdir(parents=True, exist_ok=True)
    figure = draw(errors, targets, tips)
    print(f"wrote {save_figure(figure, arguments.out / 'equilibrium_layer.png')}")
    pyplot.close(figure)


def learn(mechanism: rj.RollingChain, steps: int) -> tuple[list[float], torch.Tensor, torch.Tensor]:
    """Root mean square miss of every step [mm]; targets never trained on and the tips that reach for them, (64, 2)."""
    design = DifferentiableChain.from_mechanism(mechanism)
    command = LengthCommand(mechanism)
    optimiser = torch.optim.Adam(command.parameters(), lr=2e-2)
    schedule = torch.optim.lr_scheduler.CosineAnnealingLR(optimiser, max(steps, 1))
    errors = []
    for step in range(steps):
        targets = reachable(design, command, 64)
        equilibria = equilibrium(design, command(targets))
        miss = (equilibria.tip - targets)[equilibria.ok].square().sum(-1).mean()
        optimiser.zero_grad()
        miss.backward()
        optimiser.step()
        schedule.step()
        errors.append(float(miss.detach().sqrt()))
        if step % 25 == 0:
            print(f"step {step:4d}: the tip misses by {errors[-1]:6.2f} mm")
    targets = reachable(design, command, 64)
    with torch.no_grad():
        tips = equilibrium(design, command(targets)).tip
    print(f"new targets: {float((tips - targets).square().sum(-1).mean().sqrt()):.2f} mm")
    return errors, targets, tips


def equilibrium(design: DifferentiableChain, lengths: torch.Tensor) -> Equilibria:
    """The layer. One mechanism, again and again: its table is built once, for the compiled solver."""
    return solve_lengths(design, lengths, solver="compiled")


def reachable(design: DifferentiableChain, command: LengthCommand, count: int) -> torch.Tensor:
    """Tips of random length commands, away from the edges of what can be reached, (count, 2) [mm]."""
    with torch.no_grad():
        return equilibrium(design, command.pulled(0.2 + 0.7 * torch.rand(count, 2))).tip


def draw(errors: list[float], targets: torch.Tensor, tips: torch.Tensor) -> pyplot.Figure:
    """The falling error, and targets with the tips that reach for them."""
    figure, (left, right) = pyplot.subplots(1, 2, figsize=(10, 4.5), layout="constrained")
    left.semilogy(errors, color=PALETTE[0])
    left.set_xlabel("step")
    left.set_ylabel("root mean square miss of the tip [mm]")
    right.plot(*targets.T, "o", color=PALETTE[1], fillstyle="none", label="target")
    right.plot(*tips.T, ".", color=PALETTE[0], label="tip")
    right.set_aspect("equal")
    right.set_xlabel("x [mm]")
    right.set_ylabel("y [mm]")
    right.legend(loc="lower center")
    right.set_title("targets that were not trained on")
    return figure


if __name__ == "__main__":
    main()
