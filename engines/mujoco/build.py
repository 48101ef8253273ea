"""The MuJoCo model of a mechanism: numerical options, softness and preload."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import numpy as np

from ...models.arrays import FloatArray
from ...models.errors import SimulationError
from ...models.mechanism import Mechanism
from ...models.mjcf.points import felt_from
from ...models.mjcf.recorded import HOME
from ...models.mjcf.writer import MARGIN, mjcf
from .constraints import UnilateralConstraint, slot_contacts, stop_contacts
from .matrices import constraint_jacobian, mass_matrix
from .options import MujocoOptions, scaled_solref
from .reference_acceleration import ReferenceAccelerationCorrection
from .versions import CALLBACK, loses_small_gains, mujoco

_PRELOAD_ITERATIONS = 6  # each gains the four digits of 1 - d, d the impedance
_MOST_ITERATIONS = 3000  # where forces of redundant constraints drift
_REDUNDANT = (
    1e-12  # of the largest eigenvalue: constraints more nearly dependent follow from each other
)
_PATIENCE = 10  # iterations without a smaller change: what is left is rounding
_SETTLED = 1e-10  # change of the constraints' forces in an iteration, of the largest


def load(mechanism: Mechanism, options: MujocoOptions) -> Any:
    """The model of the mechanism's MJCF with the engine's options set on it.

    Raises:
        SimulationError: MuJoCo refuses the model.
        UnsupportedProblemError: the mechanism cannot be written as MJCF.
    """
    text = mjcf(mechanism, options.timestep)
    try:
        with CALLBACK:  # MuJoCo's compiler calls it as well, with a model that Python does not know
            model = mujoco.MjModel.from_xml_string(text)
    except ValueError as error:
        raise SimulationError(f"MuJoCo refuses the model of {mechanism.name!r}: {error}") from error
    model.opt.integrator = getattr(mujoco.mjtIntegrator, f"mjINT_{options.integrator.upper()}")
    model.opt.solver = getattr(mujoco.mjtSolver, f"mjSOL_{options.solver.upper()}")
    model.opt.tolerance = options.tolerance
    model.opt.iterations = options.iterations
    # Without this flag MuJoCo resets a diverged simulation to the start and goes on.
    model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_AUTORESET
    solref = options.solref or scaled_solref(options.timestep, options.integrator)
    model.jnt_solref[:], model.tendon_solref_lim[:] = solref, solref
    model.jnt_solimp[:], model.tendon_solimp_lim[:] = options.solimp, options.solimp
    model.jnt_margin[:], model.tendon_margin[:] = options.margin, options.margin
    of_points = options.solref or scaled_solref(
        options.timestep, options.integrator, options.moving_points
    )
    model.pair_solref[:], model.pair_solimp[:] = of_points, options.solimp
    model.eq_solref[:], model.eq_solimp[:] = of_points, options.solimp
    for contact in stop_contacts(mechanism, model):
        if _corrects(options):
            model.pair_margin[contact.index] = felt_from(mechanism, options.timestep)
        else:  # the MJCF's margin is the rounding error at the mechanism's size
            model.pair_margin[contact.index] *= options.margin / MARGIN
    return model


def correction_of(
    mechanism: Mechanism, model: Any, options: MujocoOptions
) -> ReferenceAccelerationCorrection:
    """The correction of the reference accelerations of contacts and equalities; with stock options it does nothing."""
    if not _corrects(options) or not (model.npair or model.neq):
        return ReferenceAccelerationCorrection(model, velocity_term=False)
    without_margin = {contact.geoms: 0.0 for contact in stop_contacts(mechanism, model)}
    return ReferenceAccelerationCorrection(
        model,
        options.moving_points,
        _solves_before_the_solver(mechanism, model, options),
        without_margin,
    )


def _solves_before_the_solver(mechanism: Mechanism, model: Any, options: MujocoOptions) -> bool:
    """Whether the solver is asked for the last digit, and loses it in the cost of two walls that are pressed in."""
    to_the_last_digit = options.solver == "Newton" and options.tolerance < np.finfo(float).eps
    return to_the_last_digit and bool(slot_contacts(mechanism, model)) and loses_small_gains()


def _corrects(options: MujocoOptions) -> bool:
    return options.moving_points or options.preload


def start_data(model: Any) -> Any:
    """The model's data at the start."""
    data = mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, data, model.key(HOME).id)
    return data


def preload(
    model: Any,
    data: Any,
    closed: Iterable[UnilateralConstraint],
    correction: ReferenceAccelerationCorrection,
    settled: float = _SETTLED,
) -> None:
    """Preload the active constraints by what their softness gives way, so that they start in balance.

    A soft limit carries a torque f only at a penetration of R f / (k d): exactly at its limit it
    starts 1 - d too weak and takes some ten time constants to settle. A margin has the same effect
    as a penetration and leaves the start unchanged; contacts and equalities are given the
    acceleration R f instead.

    Args:
        model, data: MuJoCo's; the constraints' forces are left in the data.
        closed: the active stops, and the sides of slots.
        correction: of the reference accelerations.
        settled: change of the constraints' forces in an iteration that is small, in parts of the
            largest.
    """
    changes, active = Changes(data), tuple(closed)
    given: FloatArray | None = None
    for done in range(_MOST_ITERATIONS):
        _forward(data, correction)
        if not changes.go_on(settled, done, _PRELOAD_ITERATIONS):
            return
        rows = [row for constraint in active if (row := constraint.row(data)) is not None]
        forces = _rigid_forces(model, data, rows, given)
        given = data.efc_R * forces
        for constraint in active:
            constraint.preload(model, data, correction, forces)
        correction.preload_equalities(data, forces)
    _forward(data, correction)


def _rigid_forces(
    model: Any, data: Any, unilateral: list[int], given: FloatArray | None
) -> FloatArray:
    """Forces f of the rows if none was soft: from (A + R) f = c + e, with e the accelerations given, to A f = c.

    The forces as they are stand for those that would come out otherwise, and where a row without
    force is among the unilateral ones: as next e they converge as well, by R / (A + R) an
    iteration, which is slow for a wall that is nearly parallel to the motion. Redundant directions
    are left out.
    """
    forces = np.array(data.efc_force)
    equalities = np.flatnonzero(
        data.efc_type == int(mujoco.mjtConstraint.mjCNSTR_EQUALITY)
    ).tolist()
    pushing = [row for row in unilateral if forces[row] > 0]
    rows = np.array([*equalities, *pushing], dtype=np.intp)
    if not len(rows) or (given is not None and len(given) != len(forces)):
        return forces
    softness = data.efc_R[rows]
    root = np.sqrt(softness)
    scaled = constraint_jacobian(model, data)[rows] / root[:, None]
    response = scaled @ np.linalg.solve(mass_matrix(model, data), scaled.T)
    change = (softness * forces[rows] - (0.0 if given is None else given[rows])) / root
    rigid = forces[rows] + np.linalg.pinv(response, _REDUNDANT, hermitian=True) @ change / root
    if (rigid[len(equalities) :] > 0).all():
        forces[rows] = rigid
    return forces


class Changes:
    """Changes of the constraints' generalized forces from one iteration of a preload to the next.

    These forces are unique where the constraints are redundant and their multipliers are not.
    """

    def __init__(self, data: Any) -> None:
        self._data, self._forces = data, np.full(len(data.qfrc_constraint), np.inf)
        self._least, self._since = np.inf, 0

    def go_on(self, settled: float, done: int, least: int) -> bool:
        """Whether to iterate again: always at first, then as long as changes fall but are not small.

        Args:
            settled: a small change, in parts of the largest force.
            done: number of iterations so far.
            least: number of iterations to be made.
        """
        forces = np.array(self._data.qfrc_constraint)
        change, self._forces = float(np.abs(forces - self._forces).max(initial=0.0)), forces
        self._least, self._since = (
            (change, 0) if change < self._least else (self._least, self._since + 1)
        )
        unsettled = change > settled * float(np.abs(forces).max(initial=0.0))
        return done < least or (unsettled and self._since < _PATIENCE)


def _forward(data: Any, correction: ReferenceAccelerationCorrection) -> None:
    with correction.applied():
        correction.forward(data)
