"""Pinocchio as an engine of trebucheck."""
