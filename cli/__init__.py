"""The command line. Modules import what they need inside their commands: `--help` stays quick and engine-free."""
