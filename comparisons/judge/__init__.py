"""Motions from files by others: every quantity that a file gives, against the reference."""
