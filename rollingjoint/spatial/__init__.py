"""Spatial arms of beads on elastic hinges.

Modules:
    batch: batches solved into arrays that the caller keeps.
    chain: beads and tendons, and the arrays that kernels read.
    constant_curvature: piecewise constant curvature, the usual kinematics of such arms.
    equilibrium: what a solve returns.
    family: the family, as statics.families takes it.
    file: the content of mechanism files.
    presets: named arms.
    published: the published iterations, an independent second opinion.
    report: equilibria in words, tables and JSON.
    se3: spatial rigid-body motions.
"""
