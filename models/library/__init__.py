"""Machines and benchmark problems by name."""
