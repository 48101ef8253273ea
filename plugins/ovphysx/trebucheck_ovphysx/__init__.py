"""PhysX by ovphysx as an engine of trebucheck."""
