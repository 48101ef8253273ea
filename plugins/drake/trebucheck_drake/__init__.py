"""Drake as an engine of trebucheck."""
