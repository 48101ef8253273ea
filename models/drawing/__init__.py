"""Drawings of any mechanism from its description, still and moving."""
