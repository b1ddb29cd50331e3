"""Mechanisms as YAML files, equilibria as tables and JSON.

Modules:
    loop_report: loops as tables, JSON and CSV.
    mechanism_file: YAML <-> mechanism.
    path_file: CSV or YAML -> inputs of every step.
    report: tables and JSON.
    surroundings_file: YAML -> surroundings.
    trace_report: paths as tables, JSON and CSV.
"""
