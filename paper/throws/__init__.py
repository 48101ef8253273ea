"""Throws by the reference and every engine, read for the same figures."""
