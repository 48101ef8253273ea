"""Conformance: what an engine that anybody has written keeps of what it declares, with pytest and without."""
