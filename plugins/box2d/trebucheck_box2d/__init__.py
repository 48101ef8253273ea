"""Box2D as an engine of trebucheck."""
