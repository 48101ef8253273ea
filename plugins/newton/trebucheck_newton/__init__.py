"""Newton as an engine of trebucheck."""
