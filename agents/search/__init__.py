"""Design search: rj search demo --out runs/search/demo.

Modules:
    config: the checked content of a search file.
    problem: its space, objectives and limits as a Problem of rollingjoint.design.
    optimiser: the protocol of an optimiser: ask, tell.
    methods: the optimisers by name.
    sampling: random designs, and Latin hypercubes.
    cma_es: CMA-ES.
    bayesian: Bayesian search.
    gradient: L-BFGS from several starts.
    sqp: sequential quadratic programming.
    map_elites: MAP-Elites.
    folder: the folder of a run, with its journal.
    run: a run from its beginning, or continued.
    spread: runs whose batches are scored in chunks by many workers.
    outcome: the results of the runs below a folder.
    verdicts: conclusions from the runs, in sentences.
    report: the report of a search.
    pictures: pictures of a search.
    compare: python -m agents.search.compare: the page docs/design_search.md.
    unseen: python -m agents.search.unseen: a design policy compared with the methods on unseen tasks.

No module is imported here: torch and the libraries of single methods are loaded by the modules that need them.
"""
