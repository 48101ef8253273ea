"""Rapier's package of npm, in the version of node/package.json, beside this package."""

from __future__ import annotations

from pathlib import Path

from trebucheck_toolkit.node_package import NodePackage

RAPIER = NodePackage(
    "Rapier 2D",
    "@dimforge/rapier2d-compat",
    module="trebucheck_rapier",
    folder=Path(__file__).parent / "node",
)
