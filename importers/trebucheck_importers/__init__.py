"""Importers of MJCF against models of one feature each: what they must get right, and what one gets wrong."""
