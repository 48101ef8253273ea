"""Jolt Physics as an engine of trebucheck."""
