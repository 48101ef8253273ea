"""Havok's build for the web as an engine of trebucheck."""
