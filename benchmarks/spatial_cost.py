"""Cost of an equilibrium in space: a hinge arm, rolling joints, and both in turn, of as many joints and tendons.

Run: python benchmarks/spatial_cost.py [--rows N] [--repeats N]
"""

import argparse
import time

import numpy as np

import rollingjoint as rj
from rollingjoint.tables import text_table


def main(argv: list[str] | None = None) -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--rows", type=int, default=400, help="equilibria of a batch (default 400)")
    parser.add_argument("--repeats", type=int, default=7, help="batches of each chain, of which the fastest counts")
    args = parser.parse_args(argv)
    rj.set_threads(1)
    chains = {
        "arm of 32 hinges": rj.flexible_arm(),
        "the same hinges as joints": rj.SpatialChain.from_arm(rj.flexible_arm()),
        "32 rolling joints": rj.pitch_yaw_two_segment(16, 16),
        "rolling joints and hinges in turn": mixed(rj.pitch_yaw_two_segment(16, 16)),
        "pitch_yaw_two_segment, 14 joints": rj.pitch_yaw_two_segment(),
    }
    times = {name: np.inf for name in chains}
    steps = {}
    commands = {name: two_steps(chain, args.rows) for name, chain in chains.items()}
    for _ in range(args.repeats):
        for name, chain in chains.items():
            lengths, starts = commands[name]
            begin = time.process_time()
            batch = rj.solve_lengths_batch(chain, lengths, starts=starts)
            times[name] = min(times[name], (time.process_time() - begin) / args.rows)
            steps[name] = float(np.mean(batch.iterations[batch.ok]))
    rows = [
        [name, f"{1e6 * times[name]:.1f}", f"{steps[name]:.1f}", f"{1e6 * times[name] / (1.0 + steps[name]):.1f}"]
        for name in chains
    ]
    print(text_table(["lengths given, from the step before", "µs", "steps", "µs per evaluation"], rows))


def two_steps(chain: rj.HingeChain | rj.SpatialChain, rows: int) -> tuple[np.ndarray, np.ndarray]:
    """Lengths at which tendons pull with 2 to 8 N, (rows, m) [mm], and joint angles where they pull a tenth more."""
    rng = np.random.default_rng(0)
    pulls = np.exp(rng.uniform(np.log(2.0), np.log(8.0), (rows, chain.n_tendons)))
    there = rj.solve_tensions_batch(chain, pulls)
    before = rj.solve_tensions_batch(chain, pulls * rng.uniform(1.0, 1.1, pulls.shape))
    return there.lengths - pulls / [tendon.stiffness for tendon in chain.tendons], before.joint_angles


def mixed(chain: rj.SpatialChain) -> rj.SpatialChain:
    """The chain with a hinge at the apex of the surfaces in place of every second joint."""
    joints: list[rj.RollingContact | rj.PointHinge] = list(chain.joints)
    for i in range(1, len(joints), 2):
        joint = joints[i]
        below, above = (0.0, 0.0, joint.child.start[1]), (0.0, 0.0, joint.parent.start[1])
        joints[i] = rj.PointHinge(joint.frame[2], below, above, joint.stiffness, limits=(-0.5, 0.5))
    return chain.replace(joints=joints, name="mixed")


if __name__ == "__main__":
    main()
