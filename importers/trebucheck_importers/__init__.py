"""Checks of MJCF importers on models of one feature each, with a verdict for each quantity."""
