"""p2-es as an engine of trebucheck."""
