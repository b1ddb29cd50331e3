"""Planar chains of links that roll on each other.

Modules:
    batch: batches solved into arrays that the caller keeps.
    chain: links, surfaces and tendons, and the arrays that kernels read.
    equilibrium: what a solve returns.
    family: the family, as statics.families takes it.
    file: the content of mechanism files.
    joint_table: a joint's geometry over its angle as polynomials.
    outline: outlines of links, for any drawing.
    presets: named chains.
    random_chain: random valid chains, loads and inputs.
    report: equilibria in words, tables and JSON.
    se2: planar rigid-body motions.
    variations: many chains that differ by surfaces and stiffness, as one stack of arrays.
"""
