"""The constraint solver's start at its solution, for versions of MuJoCo whose solver stops short of it.

Both walls of a slot that closes a loop are pressed in, and their forces cancel but for the slot's
own. They make up nearly all of the cost that MuJoCo's solver minimises. Before 3.10 its line search
takes differences of that cost, in which the gain of the last iterations is less than rounding, so
the search may end without a step: the floating arm's track was up to 1e-4 of its force off. Started
where the gradient is zero, the solver has nothing left to gain.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from .matrices import constraint_jacobian, mass_matrix
from .versions import mujoco

_ITERATIONS = 10  # one a change of the active constraints, and one for rounding


def start_at_the_solution(model: Any, data: Any) -> None:
    """Set `qacc_warmstart` to where the gradient of the solver's cost is zero, by Newton steps of full length.

    The constraints may be equalities and frictionless unilateral ones. If it does not settle which
    of them are active, nothing is changed. To be called from `mjcb_control`, when `aref` is final.
    """
    mujoco.mj_fwdActuation(model, data)
    mujoco.mj_fwdAcceleration(model, data)
    mass, jacobian = mass_matrix(model, data), constraint_jacobian(model, data)
    acceleration, before = np.array(data.qacc_warmstart), None
    for _ in range(_ITERATIONS):
        violation = jacobian @ acceleration - data.efc_aref
        active = violation < 0
        active[: data.ne] = True
        rows, strength = jacobian[active], data.efc_D[active]
        gradient = mass @ acceleration - data.qfrc_smooth + rows.T @ (strength * violation[active])
        acceleration -= np.linalg.solve(mass + (rows.T * strength) @ rows, gradient)
        if before is not None and (active == before).all():
            data.qacc_warmstart[:] = acceleration
            return
        before = active
