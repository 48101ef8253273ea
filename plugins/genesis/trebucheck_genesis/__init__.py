"""Genesis as an engine of trebucheck."""
