"""Equilibria of either family: the solvers, what enters them, and derivatives of their results."""
