"""MuJoCo's matrices in full, whatever form it keeps them in."""

from __future__ import annotations

from typing import Any

import numpy as np

from ...models.arrays import FloatArray
from .versions import mujoco


def mass_matrix(model: Any, data: Any) -> FloatArray:
    """The full mass matrix of the data's position, shape (nv, nv)."""
    full = np.zeros((model.nv, model.nv))
    try:
        mujoco.mj_fullM(model, data, full)
    except TypeError:  # before 3.10
        mujoco.mj_fullM(model, full, data.qM)
    return full


def constraint_jacobian(model: Any, data: Any) -> FloatArray:
    """Of all constraint rows, shape (nefc, nv)."""
    if not mujoco.mj_isSparse(model):
        return data.efc_J.reshape(data.nefc, model.nv)
    dense = np.zeros((data.nefc, model.nv))
    mujoco.mju_sparse2dense(
        dense, data.efc_J.ravel(), data.efc_J_rownnz, data.efc_J_rowadr, data.efc_J_colind
    )
    return dense
