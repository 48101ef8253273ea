"""Paths of the MJCF files of the machine `floating-arm`."""

from __future__ import annotations

from .paths import description

PACKAGE_PATH, MJCF_PATH, MJCF_PATH_SCENE = description("floating-arm")
