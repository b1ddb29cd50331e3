"""Studies: measurements of this project's own controllers that a command repeats. Nothing else imports them.

Modules:
    robots: every controller on fifty robots outside the ranges of Instrument-v0, and their tables: docs/robots.md.
"""
