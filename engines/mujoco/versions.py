"""What differs between versions of MuJoCo, found by looking for the feature, not at the version."""

from __future__ import annotations

import importlib
from functools import cache
from typing import Any

import numpy as np

from ...models.arrays import FloatArray

mujoco: Any = importlib.import_module("mujoco")  # it carries no types


def mass_matrix(model: Any, data: Any) -> FloatArray:
    """The full mass matrix of the data's position, shape (nv, nv)."""
    full = np.zeros((model.nv, model.nv))
    if hasattr(data, "qM"):  # some versions 3
        mujoco.mj_fullM(model, full, data.qM)
    else:
        mujoco.mj_fullM(model, data, full)
    return full


@cache
def counts_tendons_in_reactions() -> bool:
    """Whether a `force` sensor takes off what springs between sites do to the bodies beyond it; since 3.14."""
    model = mujoco.MjModel.from_xml_string(_HUNG)
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    return bool(abs(data.sensordata).max() < 0.5)


_HUNG = """
<mujoco>
  <option gravity="0 0 0"/>
  <worldbody>
    <site name="above" pos="0 0 2"/>
    <body>
      <inertial pos="0 0 0" mass="1" diaginertia="1 1 1"/>
      <joint type="slide" axis="0 0 1"/>
      <site name="body"/>
    </body>
  </worldbody>
  <tendon><spatial stiffness="1" springlength="1"><site site="above"/><site site="body"/></spatial></tendon>
  <sensor><force site="body"/></sensor>
</mujoco>
"""
"""A spring that pulls with 1 N on a body that is free to follow: nothing holds the body to its parent."""
