"""Small MJCF models of one feature each, with the mechanism that each one is.

A file is written by hand and needs nothing of ours; `README.md` lists them.
"""
