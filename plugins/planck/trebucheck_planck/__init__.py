"""planck.js as an engine of trebucheck."""
