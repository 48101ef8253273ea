"""planck.js's package of npm, in the version of node/package.json, beside this package."""

from __future__ import annotations

from pathlib import Path

from trebucheck_toolkit.node_package import NodePackage

PLANCK = NodePackage(
    "planck.js", "planck", module="trebucheck_planck", folder=Path(__file__).parent / "node"
)
