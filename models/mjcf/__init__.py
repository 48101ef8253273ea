"""MJCF, MuJoCo's model format: the writer, and the committed models of the named machines.

A module of each machine has the paths of its files, as `robot_descriptions` names them:
`rolling.MJCF_PATH` of `from trebucheck.models.mjcf import rolling` or of `import
trebucheck.models.mjcf.rolling`.
"""

from __future__ import annotations

from . import catapult, fixed, floating_arm, hinged, rolling

__all__ = ["catapult", "fixed", "floating_arm", "hinged", "rolling"]
