"""The results page, from run folders alone: python -m agents.results DIR.

Modules:
    runs: the finished runs below a folder, grouped.
    scores: what all controllers of a benchmark do in the same episodes.
    description: what a task is, in sentences.
    page: the text of the page.
    pictures: its pictures.
"""
