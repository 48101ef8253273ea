"""Convergence studies: how an engine's error falls as one of its knobs is turned, where that ends,
and why.
"""
