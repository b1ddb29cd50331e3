"""x

Modules:
"""
