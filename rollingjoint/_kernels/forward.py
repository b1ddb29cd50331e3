"""Kinematics without statics, over many configurations."""

from __future__ import annotations

import numpy as np

from rollingjoint._jit import kernel
from rollingjoint._kernels.arrays import ANGLE, new_state
from rollingjoint._kernels.chain import evaluate_kinematics
from rollingjoint._kernels.joint import arc_length, evaluate_joint


@kernel
def joint_angles_of(chain, s):
    """phi at arc lengths s, (B, J) both."""
    phi, joint = np.empty_like(s), np.empty((s.shape[1], 10))
    for lane in range(s.shape[0]):
        for i in range(s.shape[1]):
            evaluate_joint(chain, i, s[lane, i], joint)
            phi[lane, i] = joint[i, ANGLE]
    return phi


@kernel
def arc_lengths_of(chain, phi):
    """s at joint angles phi, (B, J) both."""
    s = np.empty_like(phi)
    for lane in range(phi.shape[0]):
        for i in range(phi.shape[1]):
            s[lane, i] = arc_length(chain, i, phi[lane, i])
    return s


@kernel
def poses_of(chain, phi):
    """(poses (B, n, 3), tendon lengths (B, m)) at joint angles phi, (B, J)."""
    n_lanes, n_joints = phi.shape
    n_tendons = chain.channels.size
    poses, lengths = np.empty((n_lanes, n_joints + 1, 3)), np.empty((n_lanes, n_tendons))
    state, s = new_state(n_joints, n_tendons), np.empty(n_joints)
    for lane in range(n_lanes):
        for i in range(n_joints):
            s[i] = arc_length(chain, i, phi[lane, i])
        evaluate_kinematics(chain, s, state)
        poses[lane] = state.pose[:, :3]
        lengths[lane] = state.length
    return poses, lengths
