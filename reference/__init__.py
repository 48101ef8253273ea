"""The reference motion: equations, stops, events."""
