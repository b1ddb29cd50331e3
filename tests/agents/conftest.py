"""What tests of the controllers share."""

import pytest


@pytest.fixture
def no_pictures(monkeypatch):
    """Reports without pictures, which take longer than the short runs that they are of."""
    from agents.evaluation import output
    from agents.search import report as search_report
    from agents.tuning import report

    def nothing(*anything):
        return b""

    for name in ("film", "animation", "error_over_time", "error_distribution"):
        monkeypatch.setattr(output, name, nothing)
    for name in ("history", "parameters"):
        monkeypatch.setattr(report, name, nothing)
    monkeypatch.setattr(search_report, "draw", lambda search: {})
