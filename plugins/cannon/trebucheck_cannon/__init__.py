"""cannon-es as an engine of trebucheck."""
