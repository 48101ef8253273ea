"""Public modules for distributions built on trebucheck: stable names, wherever they live inside."""
