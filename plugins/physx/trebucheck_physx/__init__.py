"""PhysX as an engine of trebucheck."""
