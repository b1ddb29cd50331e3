"""The results page, from run folders or from results files: rj results DIR.

Modules:
    runs: the finished runs below a folder, grouped.
    environment: what makes the environments of two benchmarks the same.
    record: what a results file holds.
    file: results files: read_results, write_results.
    merging: one set of results of several.
    worlds: the episodes that a benchmark is scored in.
    roster: which opponents can drive in them.
    scores: from run folders to records.
    statistics: intervals from a two-level bootstrap.
    standings: controllers compared, and whether learning pays.
    entry: a controller of somebody's own among the results.
    description: what a task is, in sentences.
    wording: figures with intervals and verdicts in words.
    page: the text of the page.
    pictures: its pictures.
    films: its animations.
"""

from agents.results.file import read_results
from agents.results.record import Results, ResultsError

__all__ = ["Results", "ResultsError", "read_results"]
