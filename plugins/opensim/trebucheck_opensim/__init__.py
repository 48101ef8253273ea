"""OpenSim (Simbody) as an engine of trebucheck."""
