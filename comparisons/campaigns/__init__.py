"""Campaigns: many machines by a design, run in chunks, kept in one table, and what follows."""
