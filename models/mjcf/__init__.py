"""MJCF, MuJoCo's model format: the writer, and the committed models of the named machines."""
