"""Drawing of mechanisms in motion: for pages (a script) and for files (Matplotlib)."""
