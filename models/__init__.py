"""The machines, described once and without any engine; what a run is, and what it yields."""
