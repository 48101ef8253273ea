"""MuJoCo Warp as an engine of trebucheck."""
