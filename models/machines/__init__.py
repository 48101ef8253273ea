"""The named machines: their parameters, and how each becomes a mechanism."""
