"""The commands as functions of machines and keywords."""
