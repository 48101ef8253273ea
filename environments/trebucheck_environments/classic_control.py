"""Gymnasium's CartPole, Acrobot and Pendulum as models of a simulator, each beside its mechanism.

Each environment is a simulator of its own in a few lines: its equations, integrator and step. Here
it is moved with nothing changed but step and integrator where those are asked for, so that
`tb.audit` tells how far its motion is from the mechanics that it stands for:

>>> import trebucheck as tb  # doctest: +SKIP
>>> tb.audit(classic_control("Acrobot-v1", [0.3, 0.0, 0.0, 0.0])).given.leaves  # doctest: +SKIP
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from time import process_time
from typing import Any

import gymnasium
import numpy as np
from trebucheck.api.engines import (
    GivenRun,
    ModelCause,
    ModelOptions,
    ModelStates,
    whole_steps,
)
from trebucheck.api.mechanics import (
    GROUND,
    Body,
    ConstantForce,
    ConstantTorque,
    Equations,
    FloatArray,
    InputError,
    Mechanism,
    PinJoint,
    PrismaticJoint,
    SimulationError,
)

_FARTHEST, _FASTEST = 3.0, 3.0  # of random states [rad or m, and per second]
_ORIGIN = (0.0, 0.0)


@dataclass(frozen=True)
class _Task:
    """How an environment's state and action are those of a mechanism."""

    mechanism: Callable[[Any, float], Mechanism]
    """From the environment and the control; without a start."""
    rows: tuple[tuple[float, ...], ...]
    """C in q = C positions and u = C velocities."""
    positions: tuple[int, ...]
    """Their places in the state, in the order of the rows' columns."""
    velocities: tuple[int, ...]
    """The same of the velocities."""
    action: Callable[[Any, float], Any]
    """From the environment and the control [N or N m].

    Raises ValueError where no action has it.
    """
    rates: Callable[[Any, FloatArray, Any, float], FloatArray]
    """The environment's own rate of change of a state, with an action and a step [s].

    Only that of the velocities is read.
    """
    step: str
    """Attribute of the environment that is its step [s]."""
    integrators: tuple[str, ...]
    control: float = 0.0
    """Force or torque where none is given [N or N m]."""
    wraps: bool = False
    """Whether angles are wrapped to half a turn either way."""
    limits: Callable[[Any], str] = lambda _: ""
    """What the environment does beside the mechanics, in a few words."""


def _cart_pole(env: Any, force: float) -> Mechanism:
    half, mass = float(env.length), float(env.masspole)
    return Mechanism(
        name="CartPole-v1",
        bodies=(
            Body(name="cart", mass=float(env.masscart), centre=_ORIGIN, inertia=1.0),
            # A uniform rod of twice this length
            Body(name="pole", angle="theta", mass=mass, centre=(0.0, half),
                 inertia=mass * half**2 / 3),
        ),
        joints=(
            PrismaticJoint(name="rail", parent=GROUND, child="cart", parent_point=_ORIGIN,
                           child_point=_ORIGIN, axis=(1.0, 0.0), coordinate="x"),
            PinJoint(name="hinge", parent="cart", child="pole", parent_point=_ORIGIN,
                     child_point=_ORIGIN),
        ),
        force_elements=(
            ConstantForce(name="push", body="cart", point=_ORIGIN, force=(force, 0.0)),
        ),
        gravity=float(env.gravity),
        start=(0.0, 0.0),
    )  # fmt: skip


def _acrobot(env: Any, torque: float) -> Mechanism:
    inertia, length = float(env.LINK_MOI), float(env.LINK_LENGTH_1)
    first, second = float(env.LINK_COM_POS_1), float(env.LINK_COM_POS_2)
    return Mechanism(
        name="Acrobot-v1",
        bodies=(
            Body(name="upper link", angle="upper", mass=float(env.LINK_MASS_1),
                 centre=(0.0, -first), inertia=inertia),
            Body(name="lower link", angle="lower", mass=float(env.LINK_MASS_2),
                 centre=(0.0, -second), inertia=inertia),
        ),
        joints=(
            PinJoint(name="shoulder", parent=GROUND, child="upper link", parent_point=_ORIGIN,
                     child_point=_ORIGIN),
            PinJoint(name="elbow", parent="upper link", child="lower link",
                     parent_point=(0.0, -length), child_point=_ORIGIN),
        ),
        force_elements=(
            # Counter-clockwise is positive there.
            ConstantTorque(name="motor", body="lower link", relative_to="upper link",
                           torque=-torque),
        ),
        gravity=9.8,
        start=(0.0, 0.0),
    )  # fmt: skip


def _pendulum(env: Any, torque: float) -> Mechanism:
    mass, length = float(env.m), float(env.l)
    return Mechanism(
        name="Pendulum-v1",
        bodies=(
            Body(name="rod", angle="theta", mass=mass, centre=(0.0, length / 2),
                 inertia=mass * length**2 / 12),
        ),
        joints=(
            PinJoint(name="pivot", parent=GROUND, child="rod", parent_point=_ORIGIN,
                     child_point=_ORIGIN),
        ),
        force_elements=(ConstantTorque(name="motor", body="rod", torque=-torque),),
        gravity=float(env.g),
        start=(0.0,),
    )  # fmt: skip


def _push_or_pull(env: Any, force: float) -> int:
    return {float(env.force_mag): 1, -float(env.force_mag): 0}[force]


def _one_of_three(env: Any, torque: float) -> int:
    return list(map(float, env.AVAIL_TORQUE)).index(torque)


def _clipped(env: Any, torque: float) -> FloatArray:
    if abs(torque) > env.max_torque:
        raise ValueError(torque)
    return np.array([torque])


def _by_a_step(env: Any, state: FloatArray, action: Any, step: float) -> FloatArray:
    """Rates of an environment whose rule adds accelerations, times the step, to the velocities."""
    env.state = np.array(state)
    env.step(action)
    return (np.array(env.state) - state) / step


def _by_its_equations(env: Any, state: FloatArray, action: Any, _: float) -> FloatArray:
    # The public method integrates; its right-hand side is what is to be held.
    torque = float(env.AVAIL_TORQUE[action])
    return np.array(env._dsdt(np.append(state, torque))[:-1])


_TASKS: Mapping[str, _Task] = {
    "CartPole-v1": _Task(
        mechanism=_cart_pole,
        rows=((0.0, 1.0), (1.0, 0.0)),
        positions=(0, 2),
        velocities=(1, 3),
        action=_push_or_pull,
        rates=_by_a_step,
        step="tau",
        integrators=("euler", "semi-implicit euler"),
        control=10.0,
    ),
    "Acrobot-v1": _Task(
        mechanism=_acrobot,
        rows=((-1.0, 0.0), (-1.0, -1.0)),
        positions=(0, 1),
        velocities=(2, 3),
        action=_one_of_three,
        rates=_by_its_equations,
        step="dt",
        integrators=("RK4",),
        wraps=True,
        limits=lambda e: f"speeds beyond {e.MAX_VEL_1:.3g} and {e.MAX_VEL_2:.3g} rad/s are cut",
    ),
    "Pendulum-v1": _Task(
        mechanism=_pendulum,
        rows=((-1.0,),),
        positions=(0,),
        velocities=(1,),
        action=_clipped,
        rates=_by_a_step,
        step="dt",
        integrators=("semi-implicit euler",),
        limits=lambda e: f"speeds beyond {e.max_speed:g} rad/s are cut",
    ),
}


def classic_control(name: str, state: Sequence[float], control: float | None = None) -> Classic:
    """One of Gymnasium's classic-control environments from a state, with a constant control.

    Args:
        name: 'CartPole-v1', 'Acrobot-v1' or 'Pendulum-v1'.
        state: the environment's own: x, its speed, angle and its speed of the cart and pole; both
            angles and both speeds of the acrobot; angle and speed of the pendulum.
        control: force on the cart (10 or -10 N), torque on the elbow (-1, 0 or 1 N m) or on the
            pendulum (to 2 N m); 10 N, or none, where left out.

    Raises:
        InputError: the name, the state or the control is not valid.
    """
    if name not in _TASKS:
        raise InputError(f"{name!r} is none of the environments here: {', '.join(_TASKS)}.")
    given = np.asarray(state, dtype=np.float64)
    wanted = 2 * len(_TASKS[name].positions)
    if given.shape != (wanted,) or not np.isfinite(given).all():
        raise InputError(f"state = {list(state)!r} must be {wanted} finite numbers for {name}.")
    force = _TASKS[name].control if control is None else control
    if not math.isfinite(force):
        raise InputError(f"control = {force!r} must be finite.")
    model = Classic(name, given, float(force))
    try:
        model.action  # noqa: B018 - computed now, to be refused now
    except (ValueError, KeyError):
        raise InputError(f"control = {force!r}: no action of {name} has it.") from None
    return model


class Classic:
    """An environment beside its mechanism: what `tb.audit` takes (`ModelFile`)."""

    engine = "gymnasium"

    def __init__(self, name: str, state: FloatArray, control: float) -> None:
        self._name, self._task, self._state = name, _TASKS[name], state
        self._control, self._rows = control, np.array(_TASKS[name].rows)

    @cached_property
    def mechanism(self) -> Mechanism:
        """The mechanism that the environment's equations are of, at its state."""
        q, u = self._coordinates(self._state[None])
        mechanism = self._task.mechanism(self._made(), self._control)
        return mechanism.model_copy(update={"start": tuple(q[0]), "start_speeds": tuple(u[0])})

    @property
    def engine_version(self) -> str:
        """Version of Gymnasium here."""
        return str(gymnasium.__version__)

    @property
    def left_out(self) -> tuple[str, ...]:
        """Limits of the environment that the mechanism has not."""
        text = self._task.limits(self._made())
        return (text,) if text else ()

    @cached_property
    def action(self) -> Any:
        """The environment's action with the control."""
        return self._task.action(self._made(), self._control)

    @property
    def options(self) -> ModelOptions:
        """Integrator and step as the environment is made."""
        return ModelOptions(self.integrators[0], float(getattr(self._made(), self._task.step)))

    @property
    def integrators(self) -> tuple[str, ...]:
        """Integrators of the environment, its own first."""
        return self._task.integrators

    @property
    def variants(self) -> tuple[ModelOptions, ...]:
        """Options beside integrators and steps: there are none."""
        return ()

    @property
    def causes(self) -> tuple[ModelCause, ...]:
        """The integrator, where there is a second one, and the step."""
        given = self.options
        others = (ModelCause.of_integrator(given, other) for other in self.integrators[1:])
        return *others, ModelCause.of_step(given)

    def option_text(self, options: ModelOptions) -> str:
        """The lines that set an environment's step and integrator."""
        lines = [f"env.unwrapped.{self._task.step} = {options.timestep!r}"]
        if len(self.integrators) > 1:
            lines.append(f"env.unwrapped.kinematics_integrator = {options.integrator!r}")
        return "\n".join(lines)

    def random_states(self, number: int) -> ModelStates:
        """The environment's own accelerations at random states."""
        random, env, step = np.random.default_rng(7), self._made(), self.options.timestep
        n = len(self._task.positions)
        states = np.empty((number, 2 * n))
        states[:, self._task.positions] = random.uniform(-_FARTHEST, _FARTHEST, (number, n))
        states[:, self._task.velocities] = random.uniform(-_FASTEST, _FASTEST, (number, n))
        rates = np.array([self._task.rates(env, state, self.action, step) for state in states])
        q, u = self._coordinates(states)
        _, a = self._coordinates(rates)
        return ModelStates(
            t=np.zeros(len(q)), q=q, u=u, a=a, mass=None, gaps={}, markers={}, loops={}
        )

    def energies(self, q: FloatArray, u: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Energies of the mechanism: the environment tells none [J]."""
        equations = Equations(self.mechanism)
        kinetic = 0.5 * np.einsum("ni,nij,nj->n", u, equations.mass_matrix(q), u)
        return kinetic, equations.potential_energy(q)

    def moved(self, duration: float, options: ModelOptions) -> GivenRun:
        """Move the environment for a time [s], beyond what ends an episode.

        Raises:
            SimulationError: its state is not finite any more.
        """
        env = self._made()
        setattr(env, self._task.step, options.timestep)
        if len(self.integrators) > 1:
            env.kinematics_integrator = options.integrator
        steps = whole_steps(duration, options.timestep)
        states = np.empty((steps + 1, len(self._state)))
        states[0] = self._state
        began = process_time()
        for k in range(steps):
            env.step(self.action)
            states[k + 1] = env.state
        spent = process_time() - began
        if not np.isfinite(states).all():
            raise SimulationError(f"{self._name} diverges at a step of {options.timestep:g} s.")
        if self._task.wraps:
            at = list(self._task.positions)
            states[:, at] = np.unwrap(states[:, at], axis=0)
        t = options.timestep * np.arange(steps + 1, dtype=np.float64)
        return GivenRun(t, *self._coordinates(states), None, spent)

    def _made(self) -> Any:
        """The environment at its state, in double precision."""
        env: Any = gymnasium.make(self._name).unwrapped
        env.reset(seed=0)
        env.state = np.array(self._state)
        # An episode that has ended is moved on without a warning.
        env.steps_beyond_terminated = 1
        return env

    def _coordinates(self, states: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Coordinates and speeds of states, each of shape (n, n_q)."""
        q, u = states[:, self._task.positions], states[:, self._task.velocities]
        return q @ self._rows.T, u @ self._rows.T
