"""Training runs: their configuration, their folder, and the tools with which every command handles both.

Modules:
    checked_json: JSON read with limits.
    checks: checks of configuration values.
    schedules: hyper-parameters that change during training.
    algorithms: learning algorithms and the hyper-parameters that a configuration may set.
    environment: the environment of a run, how Gymnasium makes it, and the columns of evaluations.csv.
    additions: wrappers, callbacks and trackers by their names.
    ready_made: the files of configs/ by their names, and copies of them.
    config: the whole configuration, read from YAML.
    seeds: seeds and their purposes.
    files: files that are written whole or not at all; tables read back.
    locks: locks between processes.
    state_file: plain values, arrays and tensors in one safetensors file.
    consent: permissions that only the command line gives: pickles, and modules that files name.
    folder: the run folder.
    command_line: exit codes, error lines and signals of the commands.

This package imports no modules; torch and Stable-Baselines3 are loaded by the functions that need them.
"""
