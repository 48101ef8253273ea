"""`trebucheck compare`: engines against the reference and against each other."""
