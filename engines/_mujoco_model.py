"""The loaded model: options, limits that can be taken out, and preload."""

from __future__ import annotations

import importlib
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from ..models.errors import SimulationError, UnsupportedProblemError
from ..models.kinematics import Kinematics
from ..models.mechanism import Mechanism
from ..models.mjcf_writer import FAR, START_KEY, mjcf, torque_sensor

if TYPE_CHECKING:
    from .mujoco_ import MujocoEngine

mujoco: Any = importlib.import_module("mujoco")  # it carries no types

_SETTLING = 6  # preload iterations, each of which gains the four digits of 1 - d


@dataclass(frozen=True)
class Limit:
    """A stop as the limit of a joint or of a tendon."""

    stop: str
    element: str
    """'jnt' or 'tendon', the prefix of the model's arrays."""
    index: int
    end: int
    """0 for the lower end of the range, 1 for the upper."""
    constraint: int
    """Type of its rows among MuJoCo's constraints."""
    range: tuple[float, float]
    """Of the joint or tendon, before anything was removed [rad]."""

    def remove(self, model: Any) -> None:
        """Take the limit out of the model; the other end of the range stays."""
        getattr(model, f"{self.element}_range")[self.index, self.end] = FAR if self.end else -FAR

    def row(self, data: Any) -> int | None:
        """Its row among the constraints that are present; None if it is out of reach."""
        found = np.flatnonzero((data.efc_type == self.constraint) & (data.efc_id == self.index))
        return int(found[0]) if len(found) else None


def load(mechanism: Mechanism, options: MujocoEngine) -> Any:
    """The model of the mechanism's MJCF with the engine's options set on it.

    Raises:
        SimulationError: MuJoCo refuses the model.
        UnsupportedProblemError: the mechanism cannot be written as MJCF, or starts with a stop's gap moving.
    """
    _refuse_moving_gaps(mechanism)
    text = mjcf(mechanism, options.timestep)
    try:
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
    return model


def _scaled_softness(options: MujocoEngine) -> tuple[float, float]:
    """Softness of the limits, -stiffness and -damping [1/s^2, 1/s]; errors fall with the square of the step.

    Twice the damping is critical and has the least rebound; a one-stage integrator throws the joint about with it,
    and settles in one step with half of that.
    """
    damping = 2.0 if options.integrator == "RK4" else 1.0
    return -1.0 / options.timestep**2, -damping / options.timestep


def _refuse_moving_gaps(mechanism: Mechanism) -> None:
    if not mechanism.start_speeds:
        return
    kinematics, speeds = Kinematics(mechanism), np.array(mechanism.start_speeds)
    for stop in mechanism.stops:
        speed = float(kinematics.gap_row(stop.name) @ speeds)
        if stop.closed and abs(speed) > 1e-12:
            raise UnsupportedProblemError(
                f"stop {stop.name!r} is closed at the start while its gap moves at {speed:.3g} rad/s; MuJoCo would "
                f"begin with an impact or a parting."
            )


def start_data(model: Any) -> Any:
    """The model's data at the start."""
    data = mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, data, model.key(START_KEY).id)
    return data


def limits(mechanism: Mechanism, model: Any) -> dict[str, Limit]:
    """Each stop's limit, by the stop's name."""
    of_joint, types = mujoco.mjtSensor.mjSENS_JOINTLIMITFRC, mujoco.mjtConstraint
    found: dict[str, Limit] = {}
    for stop in mechanism.stops:
        sensor = model.sensor(torque_sensor(stop.name))
        on_joint = int(sensor.type[0]) == of_joint
        element, index = "jnt" if on_joint else "tendon", int(sensor.objid[0])
        low, high = getattr(model, f"{element}_range")[index]
        found[stop.name] = Limit(
            stop=stop.name,
            element=element,
            index=index,
            end=0 if stop.sense > 0 else 1,
            constraint=int(types.mjCNSTR_LIMIT_JOINT if on_joint else types.mjCNSTR_LIMIT_TENDON),
            range=(float(low), float(high)),
        )
    return found


def preload(model: Any, data: Any, closed: list[Limit]) -> None:
    """Press the closed limits in as far as their softness would let them be, so that nothing has to settle.

    A soft limit carries a torque f only once it gives way by R f / (k d): standing exactly at its limit it starts
    1 - d too weak and takes some ten time constants to settle. The margin is as good as a penetration and leaves
    the start where it is.
    """
    for _ in range(_SETTLING):
        mujoco.mj_forward(model, data)
        for limit in closed:
            row = limit.row(data)
            if row is not None and data.efc_force[row] > 0:
                stiffness, _, impedance, _ = data.efc_KBIP[row]
                press = data.efc_R[row] * data.efc_force[row] / (stiffness * impedance)
                getattr(model, f"{limit.element}_margin")[limit.index] = press
    mujoco.mj_forward(model, data)
