"""Enclosures of a mechanism's motion in ball arithmetic: every figure with a proved radius."""
