"""Convergence studies: how an engine's error falls as a knob is turned, and where that ends."""
