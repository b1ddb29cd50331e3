"""Tuning: studies that search for hyper-parameters, by any number of processes at once.

Modules:
    study: the configuration of a study, read from YAML.
    folder: the folder of a study.
    journal: Optuna's journal, with a lock that ends with its process.
    trials: the trials of a study.
    controllers: the command that tunes settings of controllers.
    report: the results of a study, as text and pictures.

No module is imported here: torch, Stable-Baselines3 and Optuna are loaded by the modules that need them.
"""
