"""Spatial arms of beads on elastic hinges."""
