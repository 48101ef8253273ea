"""Chosen machines: the most efficient of each named kind, and a rolling one designed as a whole."""
