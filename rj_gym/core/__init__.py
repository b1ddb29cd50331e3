"""What every task shares: the environments around it, its episodes, its settings, and the table of ids.

Modules:
    arguments: checks of seeds, and of what vector environments are given.
    bound_episodes: arrays of a tracking task's episodes, and the kernels that are bound to them.
    columns: columns of readings.
    config: settings that the tracking tasks share.
    draws: random episodes, and what every tracking task makes of uniform numbers.
    env: the scalar environment of every task, plain and with goals.
    episodes: the interface of an episode buffer, which keeps running episodes side by side.
    friction_steps: friction of running episodes, and what takes the solver's place with it.
    generators: the random generators of many lanes, from which a kernel draws for all of them at once.
    hardware: motors and sensors of the tracking tasks, compiled.
    hardware_draws: what is drawn of them, and their arrays.
    info: infos in Gymnasium's vector form and of a single lane.
    kernels: formulas that the tracking tasks share, compiled.
    observation: entries of observation vectors that the tasks share.
    options: options of reset that the tasks share.
    registry: the table of registered environments, their settings and tasks.
    sensing: settings of what is measured, and of how motors move tendons.
    settings: the base of every settings class.
    sole_use: one caller of an environment at a time.
    spaces: observation spaces and observations, plain and with goals.
    state: saved states of vector environments, checked.
    starting_episodes: how episodes of a tracking task begin.
    tangent: how the last step of a tracking task answers its motors.
    task: the interface of a task.
    tracking_episodes: running episodes of a tracking task.
    tracking_task: the base of the tracking tasks.
    vector: the native vector environment of every task, plain and with goals.
"""
