"""The reference solver as an engine."""
