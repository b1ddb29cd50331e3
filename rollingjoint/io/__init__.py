"""Mechanisms as YAML files, equilibria as tables and JSON.

Modules:
    mechanism_file: YAML <-> mechanism.
    report: tables and JSON.
"""
