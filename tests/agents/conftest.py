"""What tests of the controllers share."""

import pytest


@pytest.fixture
def no_pictures(monkeypatch):
    """Reports without pictures, which take longer than the short runs that they are of."""
    from agents import evaluate
    from agents.evaluation import pictures
    from agents.tuning import report

    def nothing(*anything):
        return b""

    for name in ("error_over_time", "error_distribution", "animation"):
        monkeypatch.setattr(pictures, name, nothing)
    for name in ("history", "parameters"):
        monkeypatch.setattr(report, name, nothing)
    monkeypatch.setattr(evaluate, "film", nothing)
