"""Conformance of engines that anybody has written, with pytest and without."""
