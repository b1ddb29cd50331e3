"""Tuning: studies that search for hyper-parameters, by any number of processes at once.

Modules:
    study: what a study searches, read from YAML.
    folder: the folder of a study.
    journal: Optuna's journal, with a lock that ends with its process.
    trials: the trials of a study.
    controllers: the command that tunes settings of controllers.
    report: what a study found, as text and pictures.

Nothing is imported here: torch, Stable-Baselines3 and Optuna are loaded by the modules that need them.
"""
