"""PyBullet as an engine of trebucheck."""
