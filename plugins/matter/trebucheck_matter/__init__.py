"""matter-js as an engine of trebucheck."""
