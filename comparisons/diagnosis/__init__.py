"""Why a run is not what it should be: when it parts from the reference, what leads, and who is suspect."""
