"""SymPy's Kane's method, moved by PyDy, as an engine of trebucheck."""
