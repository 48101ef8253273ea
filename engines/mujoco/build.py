"""The loaded model: options, softness and preload."""

from __future__ import annotations

import importlib
from collections.abc import Iterable
from typing import Any

import numpy as np

from ...models.errors import SimulationError, UnsupportedProblemError
from ...models.kinematics import Kinematics
from ...models.mechanism import Mechanism, PointStop
from ...models.mjcf.points import felt_from
from ...models.mjcf.writer import MARGIN, START_KEY, mjcf
from .constraints import Hold, Wall, stop_holds
from .moving_points import CALLBACK, Bias
from .options import MujocoOptions

mujoco: Any = importlib.import_module("mujoco")  # it carries no types

_SETTLING = 6  # preload iterations, each of which gains the four digits of 1 - d


def load(mechanism: Mechanism, options: MujocoOptions) -> Any:
    """The model of the mechanism's MJCF with the engine's options set on it.

    Raises:
        SimulationError: MuJoCo refuses the model.
        UnsupportedProblemError: the mechanism cannot be written as MJCF, or starts with a stop's gap moving.
    """
    _refuse_moving_gaps(mechanism)
    text = mjcf(mechanism, options.timestep)
    try:
        with CALLBACK:  # MuJoCo's compiler calls it, too, with a model that Python does not know
            model = mujoco.MjModel.from_xml_string(text)
    except ValueError as error:
        raise SimulationError(f"MuJoCo refuses the model of {mechanism.name!r}: {error}") from error
    model.opt.integrator = getattr(mujoco.mjtIntegrator, f"mjINT_{options.integrator.upper()}")
    model.opt.solver = getattr(mujoco.mjtSolver, f"mjSOL_{options.solver.upper()}")
    model.opt.tolerance = options.tolerance
    model.opt.iterations = options.iterations
    # MuJoCo answers a divergence by going back to the start, as if nothing had been.
    model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_AUTORESET
    solref = options.solref or _scaled_softness(options)
    model.jnt_solref[:], model.tendon_solref_lim[:] = solref, solref
    model.jnt_solimp[:], model.tendon_solimp_lim[:] = options.solimp, options.solimp
    model.jnt_margin[:], model.tendon_margin[:] = options.margin, options.margin
    of_points = options.solref or _scaled_softness(options, kept=options.moving_points)
    model.pair_solref[:], model.pair_solimp[:] = of_points, options.solimp
    model.eq_solref[:], model.eq_solimp[:] = of_points, options.solimp
    for wall in _stop_walls(mechanism, model):
        if _is_biased(options):
            model.pair_margin[wall.index] = felt_from(mechanism, options.timestep)
        else:  # the file's is that of rounding at the machine's size
            model.pair_margin[wall.index] *= options.margin / MARGIN
    return model


def bias_of(mechanism: Mechanism, model: Any, options: MujocoOptions) -> Bias:
    """What is to be changed of the reference accelerations of contacts and equalities: by stock options, nothing."""
    if not _is_biased(options) or not (model.npair or model.neq):
        return Bias(model, moving=False)
    return Bias(model, options.moving_points, {wall.geoms: 0.0 for wall in _stop_walls(mechanism, model)})


def _is_biased(options: MujocoOptions) -> bool:
    return options.moving_points or options.preload


def _stop_walls(mechanism: Mechanism, model: Any) -> list[Wall]:
    return [hold for hold in stop_holds(mechanism, model).values() if isinstance(hold, Wall)]


def _scaled_softness(options: MujocoOptions, kept: bool = False) -> tuple[float, float]:
    """Softness of limits, contacts and equalities, -stiffness and -damping [1/s^2, 1/s].

    Scaled so, errors fall with the square of the step. Twice the damping is critical and has the least rebound; a
    one-stage integrator throws the joint about with it, and settles in one step with half of that. Feedback that is
    kept through a step of RK4 has a constraint at rest after two with one and a half: the matrix
    ((1 - K/2, 1 - B/2), (-K, 1 - B)) from one step to the next, with K = k h^2 = 1 and B = b h, is then nilpotent.
    """
    damping = 1.0 if options.integrator != "RK4" else 1.5 if kept else 2.0
    return -1.0 / options.timestep**2, -damping / options.timestep


def _refuse_moving_gaps(mechanism: Mechanism) -> None:
    if not mechanism.start_speeds:
        return
    kinematics, start, speeds = Kinematics(mechanism), np.array(mechanism.start), np.array(mechanism.start_speeds)
    for stop in mechanism.stops:
        terms = kinematics.gap_gradient(stop.name, start) * speeds
        speed, unit = float(terms.sum()), "m/s" if isinstance(stop, PointStop) else "rad/s"
        if stop.closed and abs(speed) > 1e-12 * max(1.0, float(np.abs(terms).max())):
            raise UnsupportedProblemError(
                f"stop {stop.name!r} is closed at the start while its gap moves at {speed:.3g} {unit}; MuJoCo would "
                f"begin with an impact or a parting."
            )


def start_data(model: Any) -> Any:
    """The model's data at the start."""
    data = mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, data, model.key(START_KEY).id)
    return data


def preload(model: Any, data: Any, closed: Iterable[Hold], bias: Bias) -> None:
    """Press what holds in as far as its softness would let it be, so that nothing has to settle.

    A soft limit carries a torque f only once it gives way by R f / (k d): standing exactly at its limit it starts
    1 - d too weak and takes some ten time constants to settle. The margin is as good as a penetration and leaves
    the start where it is; contacts and equalities are given the acceleration R f instead.
    """
    for _ in range(_SETTLING):
        _forward(model, data, bias)
        for hold in closed:
            hold.press(model, data, bias)
        bias.press_ties(data)
    _forward(model, data, bias)


def _forward(model: Any, data: Any, bias: Bias) -> None:
    with bias.applied():
        bias.restart()
        mujoco.mj_forward(model, data)
