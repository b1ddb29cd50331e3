"""Kinematics without statics, over many configurations of one design."""

from __future__ import annotations

from rollingjoint._numba.jit import kernel
from rollingjoint.kernels.planar.arrays import design, new_state
from rollingjoint.kernels.planar.chain import evaluate_poses
from rollingjoint.kernels.planar.joint import arc_length, evaluate_joints


@kernel(short_loops=True, title="the geometry of planar chains")
def arc_lengths_of(chain, designs, phi, s):
    """Fill s at joint angles phi, (B, J) both, of every lane's design."""
    for lane in range(phi.shape[0]):
        one = design(chain, designs[lane])
        for i in range(phi.shape[1]):
            s[lane, i] = arc_length(one, i, phi[lane, i])


@kernel(short_loops=True, title="the geometry of planar chains")
def poses_of(chain, phi, poses, lengths):
    """Fill poses (B, n, 3) and tendon lengths (B, m) at joint angles phi, (B, J), clipped to the surface limits."""
    n_lanes, n_joints = phi.shape
    only, n_tendons = design(chain, 0), chain.tendon_joints.size
    state = new_state(n_joints, n_tendons)
    for lane in range(n_lanes):
        for i in range(n_joints):
            state.angle[i] = min(max(phi[lane, i], only.joints[i, 0]), only.joints[i, 1])
        evaluate_joints(only, state)
        evaluate_poses(only.holes, only.channels, only.tendon_joints, state)
        for k in range(n_joints + 1):
            for column in range(3):
                poses[lane, k, column] = state.pose[k, column]
        for j in range(n_tendons):
            lengths[lane, j] = state.length[j]
