"""Differences between versions of MuJoCo, found by the feature and not by the version."""

from __future__ import annotations

import threading
from functools import cache
from typing import Any

import mujoco as untyped
import numpy as np

from ...models.arrays import FloatArray

mujoco: Any = untyped  # it has no types
CALLBACK = threading.RLock()
"""MuJoCo has one callback for all models and threads of a process; its compiler calls it, too."""


def _forward(xml: str) -> Any:
    """Data of a model after a forward pass."""
    with CALLBACK:
        model = mujoco.MjModel.from_xml_string(xml)
        data = mujoco.MjData(model)
        mujoco.mj_forward(model, data)
    return data


@cache
def counts_tendons_in_reactions() -> bool:
    """Tell whether a `force` sensor takes off springs between sites beyond it; since 3.14."""
    return bool(abs(_forward(_HUNG).sensordata).max() < 0.5)


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
  <tendon>
    <spatial stiffness="1" springlength="1"><site site="above"/><site site="body"/></spatial>
  </tendon>
  <sensor><force site="body"/></sensor>
</mujoco>
"""
"""A spring that pulls with 1 N on a body that nothing holds to its parent."""


def has_polynomial_springs() -> bool:
    """Tell whether the stiffness of a tendon may have higher coefficients; not in 3.10, in 4.0."""
    return hasattr(mujoco.MjModel, "tendon_stiffnesspoly")


@cache
def loses_small_gains() -> bool:
    """Tell whether the solver loses gains that are small beside its cost; before 3.10."""
    return not 0.0 < _forward(_CLAMPED).solver.improvement[0] < 1.0


_CLAMPED = """
<mujoco>
  <option gravity="0 0 -1" tolerance="0"/>
  <worldbody>
    <body>
      <inertial pos="0 0 0" mass="1" diaginertia="1 1 1"/>
      <joint type="slide" axis="0 0 1" limited="true" range="-1 1" margin="1e7" solreflimit="-1 -1"
             solimplimit="0.9999 0.9999 0.001 0.5 2"/>
    </body>
  </worldbody>
</mujoco>
"""
"""A body between two limits of 1e11 N each: its weight gains 2.5e-5 of a cost of 1e18."""


def mass_matrix(model: Any, data: Any) -> FloatArray:
    """The full mass matrix of the data's position, shape (nv, nv)."""
    full = np.zeros((model.nv, model.nv))
    try:
        mujoco.mj_fullM(model, data, full)
    except TypeError:  # before 3.10
        mujoco.mj_fullM(model, full, data.qM)
    return full


def constraint_jacobian(model: Any, data: Any) -> FloatArray:
    """Jacobian of all constraint rows, shape (nefc, nv)."""
    if not mujoco.mj_isSparse(model):
        return data.efc_J.reshape(data.nefc, model.nv)
    dense = np.zeros((data.nefc, model.nv))
    mujoco.mju_sparse2dense(
        dense, data.efc_J.ravel(), data.efc_J_rownnz, data.efc_J_rowadr, data.efc_J_colind
    )
    return dense
