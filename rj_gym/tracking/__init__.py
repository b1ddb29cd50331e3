"""The tracking tasks: bring the tip of a mechanism to a target under loads that are not known.

Chains in the plane and arms in space are one task; the differences are in `planar`, in `arm`, and in the parts of
`measuring` for either.

Modules:
    arm: the task of arms in space.
    arrays: the arrays that a step works on.
    config: settings of all tasks.
    draws: random numbers of every episode.
    env: the scalar environments, with the decision processes in their docstrings.
    episodes: running episodes side by side, the episode buffer.
    hardware: random numbers and arrays of motors and sensors.
    kernels: a step, compiled: step, finish, observe.
    measuring: measurements and observations, compiled.
    motors: motors in a step and their limits, compiled.
    observation: entries of observations and of the privileged state.
    options: options of reset.
    planar: the task of chains in the plane.
    render: the drawings.
    sensing: settings of motors and sensors.
    solver: equilibria of an episode buffer's lanes.
    tangent: how a step answers its motors.
    task: the base of both tasks.
    terms: own reward terms, observation entries, ends, targets, loads and memory.
    vector: the native vector environments.
    worlds: settings of worlds in which the tip is not seen, or late.
"""
