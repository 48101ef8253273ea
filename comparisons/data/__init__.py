"""Public data: certified trajectories of every machine and problem, as plain NetCDF files."""
