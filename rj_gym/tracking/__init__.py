"""The tracking tasks: bring the tip of a mechanism to a target under loads that are not known.

Chains in the plane and arms in space are one task: what they share is here once, and what differs is in `planar`, in
`arm`, and in the parts of `measuring` for either.

Modules:
    arm: what only the task of arms in space has.
    arrays: the arrays that a step works on.
    config: settings of all tasks.
    draws: what is drawn for every episode.
    env: the scalar environments, with the decision processes in their docstrings.
    episodes: running episodes side by side, the episode buffer.
    hardware: what is drawn of motors and sensors, and their arrays.
    kernels: a step, compiled: step, finish, observe.
    measuring: what is measured and observed, compiled.
    observation: entries of observations and of the privileged state.
    options: options of reset.
    planar: what only the task of chains in the plane has.
    render: the drawings.
    sensing: settings of motors and sensors.
    solver: equilibria of an episode buffer's lanes.
    tangent: how a step answers its motors.
    task: the base of both tasks.
    vector: the native vector environments.
    worlds: settings of worlds in which the tip is not seen, or late.
"""
