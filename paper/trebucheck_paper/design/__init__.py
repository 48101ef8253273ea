"""Machines chosen: the most efficient of each kind that the paper names, and a rolling one designed as a whole."""
