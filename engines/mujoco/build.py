"""The MuJoCo model of a mechanism: numerical options, softness and preload."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import numpy as np

from ...models.errors import SimulationError
from ...models.mechanism import Mechanism
from ...models.mjcf.points import felt_from
from ...models.mjcf.recorded import HOME
from ...models.mjcf.writer import MARGIN, mjcf
from .constraints import UnilateralConstraint, stop_contacts
from .options import MujocoOptions, scaled_solref
from .reference_acceleration import CALLBACK, ReferenceAccelerationCorrection, mujoco

_PRELOAD_ITERATIONS = 6  # each gains the four digits of 1 - d, d the impedance; of nearly dependent constraints less
_MOST_ITERATIONS = 3000  # where guides are parallel but for half a degree, each gains a tenth of a digit
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
    of_points = options.solref or scaled_solref(options.timestep, options.integrator, options.moving_points)
    model.pair_solref[:], model.pair_solimp[:] = of_points, options.solimp
    model.eq_solref[:], model.eq_solimp[:] = of_points, options.solimp
    for contact in stop_contacts(mechanism, model):
        if _corrects(options):
            model.pair_margin[contact.index] = felt_from(mechanism, options.timestep)
        else:  # the MJCF's margin is the rounding error at the mechanism's size
            model.pair_margin[contact.index] *= options.margin / MARGIN
    return model


def correction_of(mechanism: Mechanism, model: Any, options: MujocoOptions) -> ReferenceAccelerationCorrection:
    """The correction of the reference accelerations of contacts and equalities; with stock options it does nothing."""
    if not _corrects(options) or not (model.npair or model.neq):
        return ReferenceAccelerationCorrection(model, velocity_term=False)
    without_margin = {contact.geoms: 0.0 for contact in stop_contacts(mechanism, model)}
    return ReferenceAccelerationCorrection(model, options.moving_points, without_margin)


def _corrects(options: MujocoOptions) -> bool:
    return options.moving_points or options.preload


def start_data(model: Any) -> Any:
    """The model's data at the start."""
    data = mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, data, model.key(HOME).id)
    return data


def preload(
    model: Any, data: Any, closed: Iterable[UnilateralConstraint], correction: ReferenceAccelerationCorrection
) -> None:
    """Preload the active constraints by what their softness gives way, so that they start in balance.

    A soft limit carries a torque f only at a penetration of R f / (k d): exactly at its limit it starts 1 - d too weak
    and takes some ten time constants to settle. A margin has the same effect as a penetration and leaves the start
    unchanged; contacts and equalities are given the acceleration R f instead.
    """
    changes, active = Changes(data), tuple(closed)
    for done in range(_MOST_ITERATIONS):
        _forward(data, correction)
        if not changes.go_on(_SETTLED, done, _PRELOAD_ITERATIONS):
            return
        for constraint in active:
            constraint.preload(model, data, correction)
        correction.preload_equalities(data)
    _forward(data, correction)


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
        self._least, self._since = (change, 0) if change < self._least else (self._least, self._since + 1)
        unsettled = change > settled * float(np.abs(forces).max(initial=0.0))
        return done < least or (unsettled and self._since < _PATIENCE)


def _forward(data: Any, correction: ReferenceAccelerationCorrection) -> None:
    with correction.applied():
        correction.forward(data)
