"""Brax as an engine of trebucheck."""
