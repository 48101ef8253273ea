"""Command line: options, commands by the question they answer, and their output."""
