"""The pymunk adapter. Absolute imports of `pymunk` inside this package mean the library."""
