"""MJX as an engine of trebucheck."""
