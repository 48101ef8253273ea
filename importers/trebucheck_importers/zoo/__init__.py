"""Small MJCF models of one feature each, and the mechanism that each one is: what an importer can be held to.

A file is written by hand and needs nothing of ours; `README.md` lists them.
"""
