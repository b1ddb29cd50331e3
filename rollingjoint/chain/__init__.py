"""Mechanisms: chains of one-angle joints. Links roll on each other in the plane; beads turn on hinges in space.

Modules:
    batch: batches solved into arrays that the caller keeps.
    chain: the base class of all mechanisms, and the interface that each class fills in.
    contact_line: demands of a contact line on friction and on teeth.
    equilibrium: results of solves, of either class.
    file: the content of mechanism files.
    friction_step: results of friction in a step, and the history with which it begins.
    hinge: beads on elastic hinges, and the arrays that kernels read.
    joint_table: the geometry of a rolling joint over its angle as polynomials.
    outline: outlines of links, for any drawing.
    presets: mechanisms by name.
    random_chain: random valid chains, loads and inputs.
    rolling: links that roll on each other, and the arrays that kernels read.
    se3: spatial rigid-body motions.
    solution: the base class of all equilibria.
    space_outline: outlines of links in space, for any drawing.
    spatial: chains in space: links, and the arrays that kernels read.
    spatial_equilibrium: their equilibria and reactions.
    spatial_joints: their joints.
    stacks: several mechanisms as one stack of arrays.
    status: how a solve ended.
    tendon: which holes tendons pass, where they end, how stiff they are.
    variations: many chains that differ by surfaces and stiffness, as one stack of arrays.
    wall_step: contact with walls at an equilibrium.
    wall_sums: forces of walls on every link, and their rates.
"""
