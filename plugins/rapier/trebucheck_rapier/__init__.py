"""Rapier 2D as an engine of trebucheck."""
