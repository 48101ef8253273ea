"""The accelerations by which MuJoCo holds points, made exact.

A held point moves with J qacc + (dJ/dt) qvel, and MuJoCo holds it by asking for a reference acceleration -b v - k r
(v and r the constraint's speed and position). For limits J is constant. For `connect` equalities (dJ/dt) qvel is
counted since MuJoCo 3.7; for contacts it is left out ("Dual problem" in MuJoCo's documentation), and the point then
stands off by (dJ/dt) qvel / k. The reference acceleration is made before `mjcb_control` is called and used after it:
there it can be mended.

The term alone is not enough with k scaled to the step. RK4's inner stages leave the constraint by their own small
errors of timestep^2, which k turns into accelerations that do not get smaller with the step. So -b v - k r is kept as
it was at the start of a step through all of its stages: each step then sees a smooth problem without stiffness, and
the feedback works from step to step.
"""

from __future__ import annotations

import importlib
import threading
from collections.abc import Generator, Hashable
from contextlib import contextmanager
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...models.arrays import FloatArray

mujoco: Any = importlib.import_module("mujoco")  # it carries no types

CALLBACK = threading.RLock()  # MuJoCo has one callback for all models and threads of a process


@dataclass
class Bias:
    """Changes of the reference accelerations of a model's contacts and equalities.

    While :meth:`applied`, call :meth:`restart` before every forward pass, and before every series of steps.
    """

    model: Any
    moving: bool
    """Whether (dJ/dt) qvel is put in, and the rest kept through a step."""
    walls: dict[tuple[int, int], float] = field(default_factory=dict[tuple[int, int], float])
    """By plane and ball, the acceleration in place of what a contact's margin is worth [m/s^2]."""
    ties: dict[int, FloatArray] = field(default_factory=dict[int, FloatArray])
    """Accelerations added to the rows of an equality, by its index, each of shape (3,) [m/s^2]."""
    _kept: dict[Hashable, Any] = field(default_factory=dict[Hashable, Any])
    """Reference accelerations at the start of the step, by contact or equality."""
    _stage: int = 0

    @contextmanager
    def applied(self) -> Generator[None]:
        """Change the reference accelerations of whatever this thread does with MuJoCo; other threads' are left."""
        if not (self.moving or self.walls or self.ties):
            yield
            return
        owner = threading.get_ident()

        def control(model: Any, data: Any) -> None:
            if threading.get_ident() == owner:
                self._change(model, data)

        with CALLBACK:
            before = mujoco.get_mjcb_control()
            mujoco.set_mjcb_control(control)
            try:
                yield
            finally:
                mujoco.set_mjcb_control(before)

    def restart(self) -> None:
        """Whatever comes next is the first stage of a step."""
        self._stage = 0

    def press_ties(self, data: Any) -> None:
        """Give the equalities what their softness takes, R f, so that the points they tie do not part."""
        for index in range(self.model.neq):
            rows = equality_rows(data, index)
            self.ties[index] = data.efc_R[rows] * data.efc_force[rows]

    def _change(self, model: Any, data: Any) -> None:
        if self._stage % self._stages == 0:
            self._kept.clear()
        self._stage += 1
        self._change_contacts(model, data)
        for index in range(model.neq):
            rows = equality_rows(data, index)
            wanted = data.efc_aref[rows]
            if self.moving:
                wanted = self._kept.setdefault(index, _feedback(data, rows)) - self._tied(model, data, index)
            data.efc_aref[rows] = wanted + self.ties.get(index, 0.0)

    @cached_property
    def _stages(self) -> int:
        """Forward passes to a step."""
        return 4 if self.model.opt.integrator == mujoco.mjtIntegrator.mjINT_RK4 else 1

    def _change_contacts(self, model: Any, data: Any) -> None:
        rows, reference = data.contact.efc_address.tolist(), data.efc_aref
        moved: dict[int, FloatArray] = {}
        for i, (row, (plane, ball)) in enumerate(zip(rows, data.contact.geom.tolist(), strict=True)):
            if row < 0:
                continue
            wanted = float(reference[row])
            if self.moving:
                if ball not in moved:
                    # The ball's centre, not the point of contact: a ball's gap does not feel that it turns.
                    moved[ball] = _moving(model, data, data.geom_xpos[ball], model.geom_bodyid[ball])
                feedback = self._kept.setdefault((plane, ball), _feedback(data, row))
                wanted = feedback - data.contact.frame[i, :3] @ moved[ball]
            if (plane, ball) in self.walls:
                stiffness, _, impedance, _ = data.efc_KBIP[row]
                wanted += self.walls[plane, ball] - stiffness * impedance * data.efc_margin[row]
            reference[row] = wanted

    def _tied(self, model: Any, data: Any, index: int) -> FloatArray:
        sites = model.eq_obj1id[index], model.eq_obj2id[index]
        one, other = (_moving(model, data, data.site_xpos[site], model.site_bodyid[site]) for site in sites)
        return one - other


def equality_rows(data: Any, index: int) -> NDArray[np.intp]:
    """The three rows of an equality among the constraints."""
    kind = int(mujoco.mjtConstraint.mjCNSTR_EQUALITY)
    return np.flatnonzero((data.efc_type == kind) & (data.efc_id == index))


def _feedback(data: Any, rows: Any) -> Any:
    """-b v - k r of rows of constraints [m/s^2]."""
    stiffness, damping, impedance, _ = data.efc_KBIP[rows].T
    return -damping * data.efc_vel[rows] - stiffness * impedance * (data.efc_pos[rows] - data.efc_margin[rows])


def _moving(model: Any, data: Any, point: FloatArray, body: int) -> FloatArray:
    """(dJ/dt) qvel of a body's point, its acceleration without accelerations of the joints, shape (3,) [m/s^2]."""
    rate = np.zeros((3, model.nv))
    mujoco.mj_jacDot(model, data, rate, None, point, body)
    return rate @ data.qvel
