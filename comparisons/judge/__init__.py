"""Motions from files that somebody else made: every quantity that a file gives, against the
reference.
"""
