"""MuJoCo's model format: writer, scenes and variants, for distributions built on trebucheck."""

# Names are given on as they are imported.
# pyright: reportUnusedImport=false

from __future__ import annotations

from ..models.mjcf import mjcf_path
from ..models.mjcf.scene import (
    AZIMUTH,
    ELEVATION,
    FIELD,
    RecordedMotion,
    corners,
    line_of_sight,
    scene,
    stored_motion,
    viewpoint,
)
from ..models.mjcf.tree import joint_values
from ..models.mjcf.variants import HOLD, PROJECTILE, Thrown, Variant, inertias, released
from ..models.mjcf.writer import mjcf, model_file
