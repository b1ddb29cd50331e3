"""The results page, from run folders or from results files: rj results DIR.

Modules:
    runs: the finished runs below a folder, grouped.
    environment: when two benchmarks have the same environment.
    record: the content of a results file.
    file: results files: read_results, write_results.
    merging: one set of results of several.
    worlds: the episodes that a benchmark is scored in.
    roster: which opponents can drive in them.
    scores: from run folders to records.
    statistics: intervals from a two-level bootstrap.
    standings: controllers compared, and whether learning pays.
    entry: a user's controller among the results.
    description: a task in a few sentences.
    wording: figures with intervals and verdicts in words.
    page: the text of the page.
    pictures: its pictures.
    films: its animations.
"""

from agents.results.file import read_results
from agents.results.record import Results, ResultsError

__all__ = ["Results", "ResultsError", "read_results"]
