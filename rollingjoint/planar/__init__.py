"""Planar chains of links whose curved surfaces roll on each other."""
