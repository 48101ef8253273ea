"""The problem library: published and closed-form benchmark problems, and what their motions must be."""
