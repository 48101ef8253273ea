"""The version of trebucheck, at the bottom of the house so that every room can read it."""

from __future__ import annotations

__version__ = "0.1.0"
