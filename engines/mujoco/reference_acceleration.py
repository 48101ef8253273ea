"""Corrections of MuJoCo's reference accelerations `aref`, so that it holds points exactly.

The acceleration of a constraint is J qacc + (dJ/dt) qvel, and MuJoCo drives it towards the
reference acceleration aref = -b v - k r (v and r the constraint's speed and position). For limits J
is constant. For `connect` equalities (dJ/dt) qvel is counted since MuJoCo 3.7; for contacts it is
left out ("Dual problem" in MuJoCo's documentation), and the point is then off by (dJ/dt) qvel / k.
MuJoCo computes aref before it calls `mjcb_control` and uses it afterwards, so the callback can
correct it.

The term alone is not enough with k scaled to the step. RK4's inner stages violate the constraint by
their own errors of order timestep^2, which k turns into accelerations that do not decrease with the
step. So -b v - k r is kept constant through all stages of a step: each step then integrates a
smooth problem without stiffness, and the feedback acts from step to step.

An equality that carries a force f gives way by the acceleration R f, with R = (1 - d) / d of the
constraint's inverse inertia and the impedance d <= 0.9999. Where a loop is nearly singular that is
not small beside the inverse inertia along the direction that is lost, and changes the energy at
every passage. So R f of the forward pass before is added; what is left is R times the change of f
from one pass to the next.
"""

from __future__ import annotations

import threading
from collections.abc import Generator, Hashable
from contextlib import contextmanager
from dataclasses import dataclass, field
from itertools import accumulate, pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...models.arrays import FloatArray
from .compat import CALLBACK, constraint_jacobian, mass_matrix, mujoco

_SETTLING = 2  # forward passes after which R f is another state's; each gains some four digits
# Of the largest squared singular value: forces along directions with smaller ones do not count.
_REDUNDANT = 1e-12
_ITERATIONS = 10  # one a change of the active constraints, and one for rounding


@dataclass(frozen=True)
class _Pass:
    """Equality constraints of one forward pass; their forces are found in the next one."""

    rows: dict[int, slice]
    """Rows of each equality constraint among those below."""
    reference: FloatArray
    """aref, shape (n,)."""
    jacobian: FloatArray
    """Shape (n, nv)."""
    softness: FloatArray
    """R, shape (n,)."""
    ends_a_step: bool
    """Whether it is the last stage of RK4's; `qacc` is the mean of all stages then."""

    def softness_of_equalities(self, data: Any) -> dict[int, FloatArray]:
        """R f by equality constraint, without what redundant constraints do to each other.

        R f is aref - J qacc. Of forces along directions in which nothing can move every pass would
        add as much as the constraints contradict each other by rounding, over R; with S = R^(-1/2)
        J the projection on the range of S removes them.
        """
        acceleration = data.qacc_warmstart if self.ends_a_step else data.qacc
        root = np.sqrt(self.softness)
        scaled = self.jacobian / root[:, None]
        gram = scaled.T @ scaled
        diagonal = gram.reshape(-1)[:: len(gram) + 1]
        diagonal += _REDUNDANT * diagonal.sum()
        forces = scaled.T @ ((self.reference - self.jacobian @ acceleration) / root)
        softness = root * (scaled @ np.linalg.solve(gram, forces))
        return {index: softness[rows] for index, rows in self.rows.items()}


@dataclass
class ReferenceAccelerationCorrection:
    """Changes of the reference accelerations of a model's contacts and equality constraints.

    While :meth:`applied`, call :meth:`begin_step` before every forward pass, and before every
    series of steps.
    """

    model: Any
    velocity_term: bool
    """Whether (dJ/dt) qvel is counted, and the feedback -b v - k r kept through a step."""
    starts_at_the_solution: bool = False
    """Whether MuJoCo's solver starts at the solution (:func:`start_at_the_solution`)."""
    contacts: dict[tuple[int, int], float] = field(default_factory=dict[tuple[int, int], float])
    """Acceleration in place of the one due to a contact's margin [m/s^2], by plane and sphere."""
    equalities: dict[int, FloatArray] = field(default_factory=dict[int, FloatArray])
    """Accelerations added to the rows of an equality constraint, by its index, (3,) [m/s^2].

    Once they are preloaded they follow the forces, where the feedback is kept through a step.
    """
    _last: _Pass | None = None
    """The forward pass before, None if the equality constraints have just been preloaded."""
    _feedback: dict[Hashable, Any] = field(default_factory=dict[Hashable, Any])
    """-b v - k r at the start of the step, by contact or equality constraint."""
    _stage: int = 0

    @contextmanager
    def applied(self) -> Generator[None]:
        """Correct the reference accelerations in this thread's calls of MuJoCo alone."""
        if not (self.velocity_term or self.contacts or self.equalities):
            yield
            return
        owner = threading.get_ident()

        def control(model: Any, data: Any) -> None:
            if threading.get_ident() == owner:
                self._correct(model, data)

        with CALLBACK:
            before = mujoco.get_mjcb_control()
            mujoco.set_mjcb_control(control)
            try:
                yield
            finally:
                mujoco.set_mjcb_control(before)

    def begin_step(self) -> None:
        """The next forward pass is the first stage of a step."""
        self._stage = 0

    def forward(self, data: Any) -> None:
        """MuJoCo's forward dynamics of the current state."""
        self.begin_step()
        mujoco.mj_forward(self.model, data)

    def settle(self, data: Any) -> None:
        """Let the forces that the equality constraints follow be those of the current state."""
        for _ in range(_SETTLING if self._last is not None else 0):
            self.forward(data)

    def clear(self) -> None:
        """Add nothing to contacts and equalities."""
        self.contacts.clear()
        self.equalities.clear()
        self._last = None

    def preload_equalities(self, data: Any, forces: FloatArray) -> None:
        """Add R f to the equality constraints, by which their softness lets their points part.

        Args:
            data: MuJoCo's.
            forces: f of all constraint rows.
        """
        self._last = None
        for index in range(self.model.neq):
            rows = equality_rows(data, index)
            self.equalities[index] = data.efc_R[rows] * forces[rows]

    def _correct(self, model: Any, data: Any) -> None:
        stages = 4 if model.opt.integrator == mujoco.mjtIntegrator.mjINT_RK4 else 1
        if self._stage % stages == 0:
            self._feedback.clear()
        self._correct_contacts(model, data)
        if self._last is not None:  # R f of the last forward pass
            self.equalities |= self._last.softness_of_equalities(data)
        present: dict[int, NDArray[np.intp]] = {}
        for index in range(model.neq):
            rows = equality_rows(data, index)
            # A pin where there is one already: MuJoCo leaves out rows that are zero.
            if not len(rows):
                continue
            present[index] = rows
            reference = data.efc_aref[rows]
            if self.velocity_term:
                reference = self._feedback.setdefault(index, _feedback(data, rows))
                # Of hinges, on a tendon, the Jacobian is constant.
                if model.eq_type[index] != mujoco.mjtEq.mjEQ_TENDON:
                    sites = model.eq_obj1id[index], model.eq_obj2id[index]
                    one, other = (
                        _velocity_term(model, data, data.site_xpos[site], model.site_bodyid[site])
                        for site in sites
                    )
                    reference = reference - (one - other)
            data.efc_aref[rows] = reference + self.equalities.get(index, 0.0)
        self._stage += 1
        if self.velocity_term and self.equalities and present:
            rows = np.concatenate(list(present.values()))
            ends = [0, *accumulate(map(len, present.values()))]
            self._last = _Pass(
                {index: slice(*span) for index, span in zip(present, pairwise(ends), strict=True)},
                data.efc_aref[rows],
                constraint_jacobian(model, data)[rows],
                data.efc_R[rows],
                ends_a_step=self._stage % stages == 0,
            )
        if self.starts_at_the_solution:
            start_at_the_solution(model, data)

    def _correct_contacts(self, model: Any, data: Any) -> None:
        terms: dict[tuple[int, int], FloatArray] = {}  # both sides of a slot have the same
        pairs = zip(data.contact.efc_address.tolist(), data.contact.geom.tolist(), strict=True)
        for i, (row, (one, other)) in enumerate(pairs):
            if row < 0:
                continue
            reference = float(data.efc_aref[row])
            if self.velocity_term:
                feedback = self._feedback.setdefault((one, other), _feedback(data, row))
                is_first = model.geom_type[one] == mujoco.mjtGeom.mjGEOM_SPHERE
                sphere, wall, sign = (one, other, -1.0) if is_first else (other, one, 1.0)
                between = sphere, int(model.geom_bodyid[wall])
                if between not in terms:
                    terms[between] = _relative_velocity_term(model, data, *between)
                reference = feedback - sign * (data.contact.frame[i, :3] @ terms[between])
            if (one, other) in self.contacts:
                stiffness, _, impedance, _ = data.efc_KBIP[row]
                by_margin = stiffness * impedance * data.efc_margin[row]
                reference += self.contacts[one, other] - by_margin
            data.efc_aref[row] = reference


def equality_rows(data: Any, index: int) -> NDArray[np.intp]:
    """The rows of an equality constraint, three of a `connect`; none where they are zero."""
    kind = int(mujoco.mjtConstraint.mjCNSTR_EQUALITY)
    return np.flatnonzero((data.efc_type == kind) & (data.efc_id == index))


def _feedback(data: Any, rows: Any) -> Any:
    """-b v - k r of constraint rows [m/s^2]."""
    stiffness, damping, impedance, _ = data.efc_KBIP[rows].T
    return -damping * data.efc_vel[rows] - stiffness * impedance * (
        data.efc_pos[rows] - data.efc_margin[rows]
    )


def _velocity_term(model: Any, data: Any, point: FloatArray, body: int) -> FloatArray:
    """(dJ/dt) qvel of a body's point, its acceleration if qacc is zero, shape (3,) [m/s^2]."""
    rate = np.zeros((3, model.nv))
    mujoco.mj_jacDot(model, data, rate, None, point, body)
    return rate @ data.qvel


def _relative_velocity_term(model: Any, data: Any, sphere: int, holder: int) -> FloatArray:
    """Velocity term of a sphere's centre as seen from the body with a wall, shape (3,) [m/s^2].

    The centre's, not that of the point of contact: the gap does not depend on the sphere's
    rotation. Seen from a body that turns with w it is that of the centre, less that of the body's
    point there, less 2 w x v of the relative velocity v.
    """
    centre, body = data.geom_xpos[sphere], model.geom_bodyid[sphere]
    term = _velocity_term(model, data, centre, body)
    if model.body_weldid[holder] == 0:
        return term
    along, about = np.zeros((3, model.nv)), np.zeros((3, model.nv))
    mujoco.mj_jac(model, data, along, None, centre, body)
    velocity = along @ data.qvel
    mujoco.mj_jac(model, data, along, about, centre, holder)
    (x, _, z), turning = velocity - along @ data.qvel, 2.0 * float(about[1] @ data.qvel)
    return (
        term
        - _velocity_term(model, data, centre, holder)
        - np.array([turning * z, 0.0, -turning * x])
    )


def start_at_the_solution(model: Any, data: Any) -> None:
    """Set `qacc_warmstart` to the solution, by Newton steps of full length.

    Both walls of a slot that closes a loop are pressed in, and their forces cancel but for the
    slot's own. They make up nearly all of the cost that MuJoCo's solver minimises. Before 3.10 its
    line search takes differences of that cost, in which the gain of the last iterations is less
    than rounding, so the search may end without a step: the floating arm's track was up to 1e-4 of
    its force off. Started where the gradient is zero, the solver has nothing left to gain.

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
