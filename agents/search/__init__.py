"""Search designs: python -m agents.search configs/search/demo.yaml --out runs/search/demo.

    agents.search.config      what a search file says, checked
    agents.search.problem     its space, objectives and limits as a Problem of rollingjoint.design
    agents.search.optimiser   the protocol of an optimiser: ask, tell
    agents.search.methods     the optimisers by name
    agents.search.compare     python -m agents.search.compare DIR ...: the page docs/design_search.md

Nothing is imported here: torch and the libraries of single methods are loaded by the modules that need them.
"""
