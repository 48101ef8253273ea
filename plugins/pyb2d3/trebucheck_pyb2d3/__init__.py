"""Box2D 3 as an engine of trebucheck, by pyb2d3."""
