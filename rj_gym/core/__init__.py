"""What every task shares: the environments around it, its episodes, its settings, and the table of ids.

Modules:
    arguments: checks of seeds, and of what vector environments are given.
    config: settings that the tracking tasks share.
    draws: random episodes, and what every tracking task makes of uniform numbers.
    env: the scalar environment of every task, plain and with goals.
    episodes: the interface of an episode buffer, which keeps running episodes side by side.
    generators: the random generators of many lanes, from which a kernel draws for all of them at once.
    info: infos in Gymnasium's vector form and of a single lane.
    kernels: formulas that the tracking tasks share, compiled, and the columns of readings.
    observation: entries of observation vectors that the tasks share.
    options: options of reset that the tasks share.
    registry: the table of registered environments, their settings and tasks.
    settings: the base of every settings class.
    sole_use: one caller of an environment at a time.
    spaces: observation spaces and observations, plain and with goals.
    task: the interface of a task.
    tracking_episodes: running episodes of a tracking task.
    tracking_task: the base of the tracking tasks.
    vector: the native vector environment of every task, plain and with goals.
"""
