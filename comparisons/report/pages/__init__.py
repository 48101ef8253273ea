"""Pages: the report of each command as a document of blocks."""
