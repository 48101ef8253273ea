"""One throw: release, flight, forces in the members, and the sensitivities of all of it."""
