"""Paths of the MJCF files of the machine `fixed`."""

from __future__ import annotations

from .paths import description

PACKAGE_PATH, MJCF_PATH, MJCF_PATH_SCENE = description("fixed")
