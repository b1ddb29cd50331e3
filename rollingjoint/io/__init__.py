"""Mechanisms as YAML files, equilibria as tables and JSON."""
