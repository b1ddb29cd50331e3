"""Mechanisms as YAML files, equilibria as tables and JSON.

Modules:
    loop_report: loops as tables, JSON and CSV.
    mechanism_file: YAML <-> mechanism.
    report: tables and JSON.
    surroundings_file: YAML -> surroundings.
"""
