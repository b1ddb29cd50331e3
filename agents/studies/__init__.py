"""Studies: measurements of this project's own controllers that a command repeats. No other package imports them.

Modules:
    robots: every controller on fifty robots outside the ranges of Instrument-v0, and their tables: docs/robots.md.
"""
