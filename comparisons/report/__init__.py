"""Showing results: documents of blocks, and their renderers for page, terminal and Markdown."""
