"""The results page, from run folders alone: python -m agents.results DIR."""
