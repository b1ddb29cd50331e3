"""The arm's tracking task: bring the tip of a hanging arm to a target under unknown gravity and payload.

Modules:
    columns: columns of readings that only it has.
    config: its settings.
    env: its scalar environments, with the decision process in their docstrings.
    episodes: its episode buffer.
    kernels: its formulas, compiled.
    measuring: what is measured, and the privileged state, compiled.
    observation: entries of its observation.
    options: options of reset.
    render: its drawing.
    rotations: of frames, compiled.
    sampling: its random episodes.
    task: the task.
    vector: its native vector environments.
    worlds: settings of a world in which the tip is not seen.
"""
