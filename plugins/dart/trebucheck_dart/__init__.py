"""DART as an engine of trebucheck."""
