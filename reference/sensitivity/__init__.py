"""Derivatives of a reference motion by the parameters of its mechanism."""
