"""Second opinions on planar chains.

Modules:
    published: the published algorithms.
    published_equations: their equations at one configuration.
"""
