"""Engines by name and their protocol, for distributions built on trebucheck."""

# Names are given on as they are imported.
# pyright: reportUnusedImport=false

from __future__ import annotations

from ..engines.child_process import ending_with_parent
from ..engines.events import whole_steps
from ..engines.presets import ASSISTED
from ..engines.protocol import Engine
from ..engines.reference.engine import ReferenceEngine
from ..engines.registry import engine, engine_class, engine_names
from ..engines.study import (
    GivenRun,
    ModelCause,
    ModelFile,
    ModelOptions,
    ModelStart,
    ModelStates,
)
