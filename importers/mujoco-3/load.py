"""The previous major version of MuJoCo: its compiler and `mj_step`, with the file's integrator."""

import sys
from pathlib import Path

import mujoco

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))
from compiled import Compiled


def load(path: str) -> Compiled:
    """A file."""
    return Compiled(mujoco.MjModel.from_xml_path(path))
