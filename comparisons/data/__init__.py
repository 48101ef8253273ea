"""Public data: certified trajectories of every machine and problem, as NetCDF files that need
nothing of ours.
"""
