"""Running engines and measuring what they return: the part that every command shares."""
