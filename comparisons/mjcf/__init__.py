"""MJCF with the events of the certified motion as keyframes: of machines, problems and any mechanism."""
