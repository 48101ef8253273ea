"""A planar mechanism read from a compiled MuJoCo model.

MuJoCo has compiled what is read: classes, defaults, includes, inertias from geoms and frames are
its business. Every body's frame is turned to the world's at `qpos0`, so that all angles are zero
there: angles count from that position, clockwise; slides are MuJoCo's own numbers.

What has no counterpart here is refused by its name and place, or left out where that is asked for.
"""

from __future__ import annotations

import math
import re
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from copy import copy
from dataclasses import dataclass, field, replace
from functools import partial
from itertools import combinations
from time import process_time
from typing import Any

import numpy as np

from ...models.arrays import FloatArray
from ...models.controls import ControlRecord
from ...models.elements import (
    GROUND,
    AnyForceElement,
    AnyJoint,
    AnyStop,
    ConstantForce,
    ConstantTorque,
    Coupler,
    CouplerTerm,
    FreeJoint,
    PinJoint,
    PointStop,
    PrismaticJoint,
    RecordedForce,
    RecordedTorque,
    RotationalSpringDamper,
    RotorInertia,
    SlideInertia,
    SlideSpringDamper,
    SlotJoint,
    SpringDamper,
    Stop,
    TranslationJoint,
    WeldJoint,
)
from ...models.errors import InputError, SimulationError, UnsupportedProblemError
from ...models.mechanism import Body, Marker, Mechanism
from ...models.mjcf.tree import number
from ...models.spec import Vector
from ..events import whole_steps
from ..given import ModelStepper, SteppedModel
from ..study import GivenRun, ModelCause, ModelOptions, ModelStates
from .compat import mass_matrix, mujoco
from .motion import raised_warnings
from .reference_acceleration import equality_rows

_ALONG = 1e-9  # by which a unit vector may leave the plane or its normal
_LONGEST_NAME = 60
_ROUNDED = 1e-13  # of the largest of several weights: rounding of their sums
_FARTHEST = 1.5  # [rad, m] from `qpos0`, of random states
_FASTEST = 2.0  # [rad/s, m/s]
_TOUCHING = 1e-12  # [rad, m] of a gap
_DIGITS = 1e-4  # [rad, m] keyframes are written with four digits

_SAME_TIME = 1e-9  # [s]
_MOST_TIMES = 1000  # of recorded controls, at which a reading is held against the model

_OF_TENDONS = ("stiffness", "stiffnesspoly", "damping", "dampingpoly", "armature", "limited")

_CONSTRAINTS = ("CONTACT", "EQUALITY", "FRICTIONLOSS", "LIMIT")

_INTEGRATOR = "mjINT_"
_EULER, _MOST_ACCURATE = "Euler", "RK4"
_INTEGRATORS = (_EULER, "implicitfast", _MOST_ACCURATE)
_NO_REBOUND = 5.0  # damping ratio with which a limit gives back a hundredth of the speed
_STIFFEST = (0.9999, 0.9999, 0.001, 0.5, 2.0)  # MuJoCo clamps impedances there

LEAVABLE = (
    "contacts", "limits", "friction-loss", "fluid", "actuators", "equalities", "tendons",
)  # fmt: skip
"""Words for the features that can be left out of a model: contacts, which no mechanism has, also
where the file itself is moved; limits of joints; friction loss; the medium and its wind; actuators;
equality constraints; springs, dampers, armature and limits of tendons."""


@dataclass(frozen=True)
class Plane:
    """The plane in which a model moves: unit vectors in MuJoCo's world, each of shape (3,)."""

    x: FloatArray
    y: FloatArray
    normal: FloatArray
    """x cross y."""

    @classmethod
    def normal_to(cls, axis: FloatArray) -> Plane:
        """The plane across an axis; y is upwards (z), or MuJoCo's y where the plane is level."""
        level = abs(axis[2]) > 1.0 - _ALONG
        up = np.array([0.0, 1.0, 0.0]) if level else np.array([0.0, 0.0, 1.0])
        up = up - (up @ axis) * axis
        up /= np.linalg.norm(up)
        across = np.cross(up, axis)
        # x points to MuJoCo's x, or to its y where it is across that.
        sign = across[0] if abs(across[0]) > _ALONG else across[1]
        return cls(*((across, up, axis) if sign > 0 else (-across, up, -axis)))

    def along(self, slides: Sequence[FloatArray]) -> Plane:
        """The same plane with its axes along two slides, the one nearest to x along x."""
        for axis in slides:
            if abs(axis @ self.x) >= np.sqrt(0.5):
                x = axis * np.sign(axis @ self.x)
                return type(self)(x, np.cross(self.normal, x), self.normal)
        return self

    def vector(self, vector: FloatArray) -> complex:
        """A vector's part in the plane, x + i y."""
        return complex(vector @ self.x, vector @ self.y)

    def sense(self, axis: FloatArray) -> int:
        """1 of an axis about which positive turns are clockwise, -1 of the opposite one."""
        return -1 if axis @ self.normal > 0 else 1


class MujocoStepper:
    """MuJoCo's own steps."""

    engine = "mujoco"
    integrators = _INTEGRATORS

    @property
    def engine_version(self) -> str:
        """Version of MuJoCo here."""
        return str(mujoco.__version__)

    def stepped(self, model: Any, start: Any, controls: FloatArray) -> SteppedModel:
        """Step a model twice: to read each of its steps, and to time them alone.

        It ends at MuJoCo's first warning: of a state that is no number a step may take a second.
        """
        steps, contact = len(controls), None
        qpos, qvel = (np.empty((steps + 1, n)) for n in (model.nq, model.nv))
        changes = [0, *(1 + np.flatnonzero(np.diff(controls, axis=0).any(axis=1))).tolist()]
        # Without this flag MuJoCo resets a diverged simulation to the start and goes on.
        model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_AUTORESET
        with raised_warnings():
            data, spent = copy(start), 0.0
            qpos[0], qvel[0] = data.qpos, data.qvel
            warnings = data.warning.number  # a view: reading it anew takes as long as a step
            for k in range(steps):
                data.ctrl[:] = controls[k]
                mujoco.mj_step(model, data)
                qpos[k + 1], qvel[k + 1] = data.qpos, data.qvel
                # Contacts were found at the beginning of the step, which they have changed.
                if data.ncon and contact is None:
                    contact = k
                if warnings.any():
                    break
            else:
                data, began = copy(start), process_time()
                for k, last in zip(changes, (*changes[1:], steps), strict=True):
                    data.ctrl[:] = controls[k]
                    mujoco.mj_step(model, data, nstep=last - k)
                spent = process_time() - began
        return SteppedModel(qpos, qvel, contact, spent)


MUJOCO: ModelStepper = MujocoStepper()


@dataclass(frozen=True)
class PlanarModel:
    """A mechanism, and how its coordinates follow from the model that it was read from."""

    mechanism: Mechanism
    model: Any
    """MuJoCo's, without what was left out."""
    given: Any
    """MuJoCo's, as it was given."""
    qpos: FloatArray
    """Start, shape (nq,)."""
    qvel: FloatArray
    """Start, shape (nv,)."""
    plane: Plane
    rows: FloatArray
    """C in q = offset + C qpos and u = C qvel, shape (n_q, nv)."""
    offset: FloatArray
    """Shape (n_q,) [rad or m]."""
    controls: ControlRecord
    """All actuators' controls; constant ones are a record with one time."""
    limits: Mapping[str, tuple[FloatArray, float]]
    """Gap of each limit by the stop's name: a row over qpos, and what is taken off."""
    sites: Mapping[str, int]
    """Number of each marker's site."""
    equalities: Mapping[str, int]
    """Number of each loop joint's equality."""
    couplings: Mapping[str, tuple[int, float]]
    """Number of each coupler's equality, and its residual by that of the coupler."""
    left_out: tuple[str, ...]
    """Features of the model that the mechanism has not, each in a few words."""
    stepper: ModelStepper = MUJOCO
    """Engine that moves the model; values in single states are MuJoCo's."""

    def coordinates(self, qpos: FloatArray) -> FloatArray:
        """Coordinates of MuJoCo's positions, shape (..., n_q)."""
        return self.offset + qpos @ self.rows.T

    def speeds(self, qvel: FloatArray) -> FloatArray:
        """Speeds of MuJoCo's velocities, shape (..., n_q)."""
        return qvel @ self.rows.T

    @property
    def engine(self) -> str:
        """Name of the engine."""
        return self.stepper.engine

    @property
    def engine_version(self) -> str:
        """Version of the engine here."""
        return self.stepper.engine_version

    @property
    def options(self) -> ModelOptions:
        """Options that the file gives."""
        integrator = mujoco.mjtIntegrator(int(self.given.opt.integrator))
        name = str(integrator.name).removeprefix(_INTEGRATOR)
        name = {each.upper(): each for each in _INTEGRATORS}.get(name, name.lower())
        return ModelOptions(name, float(self.given.opt.timestep))

    @property
    def integrators(self) -> tuple[str, ...]:
        """Integrators that an audit tries."""
        return self.stepper.integrators

    @property
    def variants(self) -> tuple[ModelOptions, ...]:
        """The file's own with explicit damping, where Euler's rule treats it implicitly."""
        given, flag = self.options, mujoco.mjtDisableBit.mjDSBL_EULERDAMP
        is_implicit = given.integrator == _EULER and not self.given.opt.disableflags & flag
        if is_implicit and np.any(self.given.dof_damping):
            return (replace(given, explicit_damping=True),)
        return ()

    @property
    def causes(self) -> tuple[ModelCause, ...]:
        """The integrator, the step, the softness of limits and equalities, the limits' rebound.

        A limit pushes and does not pull: with a damping ratio of 1 a joint leaves it with exp(-2) =
        0.135 of the speed that it came with, however stiff it is.
        """
        model, given = self.given, self.options
        causes = list[ModelCause]()
        if given.integrator != _MOST_ACCURATE:
            causes.append(ModelCause.of_integrator(given, _MOST_ACCURATE))
        causes.append(ModelCause.of_step(given))
        if np.any(model.jnt_limited) or np.any(model.eq_active0):
            change = "a time constant of two steps, and an impedance of 0.9999"
            without = partial(replace, stiff=True)
            causes.append(ModelCause("softness of limits and equalities", change, without))
        if np.any(model.jnt_limited):
            change = f"a time constant of two steps, and a damping ratio of {_NO_REBOUND:g}"
            causes.append(ModelCause("rebound of limits", change, partial(replace, damped=True)))
        return tuple(causes)

    def option_text(self, options: ModelOptions) -> str:
        """The element of MJCF with these options."""
        text = f'<option integrator="{options.integrator}" timestep="{number(options.timestep)}"'
        if options.explicit_damping:
            return f'{text}><flag eulerdamp="disable"/></option>'
        return f"{text}/>"

    def energies(self, q: FloatArray, u: FloatArray) -> tuple[FloatArray, FloatArray]:
        """MuJoCo's own kinetic and potential energies at states, each of shape (n,) [J]."""
        data, energies = mujoco.MjData(self.given), np.empty((len(q), 2))
        states = (np.linalg.solve(self.rows, values.T).T for values in (q - self.offset, u))
        for k, (qpos, qvel) in enumerate(zip(*states, strict=True)):
            data.qpos[:], data.qvel[:] = qpos, qvel
            mujoco.mj_fwdPosition(self.given, data)
            mujoco.mj_fwdVelocity(self.given, data)
            mujoco.mj_energyPos(self.given, data)
            mujoco.mj_energyVel(self.given, data)
            energies[k] = data.energy
        return energies[:, 1], energies[:, 0]

    def moved(self, duration: float, options: ModelOptions) -> GivenRun:
        """Move the file's own model, nothing left out, for a time [s].

        Raises:
            SimulationError: the engine gave up, or its state is not finite any more.
            UnsupportedProblemError: the engine has not what the file needs; its own words.
        """
        model, timestep = self._with(options), options.timestep
        steps = whole_steps(duration, timestep)
        t = timestep * np.arange(steps + 1, dtype=np.float64)
        # A step may begin a rounding before the instant that it is to begin at.
        controls = self.controls.values[self.controls.rows(t[:-1] + _SAME_TIME)]
        try:
            found = self.stepper.stepped(model, self._start(model), controls)
        except NotImplementedError as error:
            raise UnsupportedProblemError(
                f"{self.engine} has not what the file of {self.mechanism.name!r} needs: "
                f"{str(error).rstrip('.')}."
            ) from error
        if not (np.isfinite(found.qpos).all() and np.isfinite(found.qvel).all()):
            raise SimulationError(
                f"{self.mechanism.name!r} diverges with the integrator {options.integrator!r} at a "
                f"step of {timestep:g} s."
            )
        return GivenRun(
            t,
            self.coordinates(found.qpos),
            self.speeds(found.qvel),
            None if found.contact is None else found.contact * timestep,
            found.processor_time,
        )

    def _with(self, options: ModelOptions) -> Any:
        """The model as it was given, with other options."""
        model, flags = copy(self.given), mujoco.mjtDisableBit
        integrator = f"{_INTEGRATOR}{options.integrator.upper()}"
        model.opt.integrator = getattr(mujoco.mjtIntegrator, integrator)
        model.opt.timestep = options.timestep
        if options.explicit_damping:
            model.opt.disableflags |= flags.mjDSBL_EULERDAMP
        if options.stiff:
            for kind in ("jnt", "eq"):
                getattr(model, f"{kind}_solref")[:] = 2.0 * options.timestep, 1.0
                getattr(model, f"{kind}_solimp")[:] = _STIFFEST
        if options.damped:
            model.jnt_solref[:] = 2.0 * options.timestep, _NO_REBOUND
        return model

    def _start(self, model: Any) -> Any:
        data = mujoco.MjData(model)
        data.qpos[:], data.qvel[:], data.ctrl[:] = self.qpos, self.qvel, self.controls.values[0]
        return data

    def random_states(self, number: int) -> ModelStates:
        """MuJoCo's own values at random states about `qpos0`, without constraints.

        At least so many, and one for each time of the controls, up to a thousand of them.
        """
        model, data = self.model, mujoco.MjData(self.model)
        random, before = np.random.default_rng(7), model.opt.disableflags
        model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_CONSTRAINT
        names = ("qpos", "qvel", "qacc", "sites", "mass")
        found: dict[str, list[FloatArray]] = {name: [] for name in names}
        residuals, times = list[dict[int, FloatArray]](), self.controls.times
        if len(times) > _MOST_TIMES:
            times = random.choice(times, _MOST_TIMES, replace=False)
        times = np.resize(times, max(number, len(times)))
        try:
            for controls in self.controls.values[self.controls.rows(times)]:
                data.qpos[:] = model.qpos0 + random.uniform(-_FARTHEST, _FARTHEST, model.nq)
                data.qvel[:] = random.uniform(-_FASTEST, _FASTEST, model.nv)
                data.ctrl[:] = controls
                mujoco.mj_forward(model, data)
                for name, values in (("qpos", data.qpos), ("qvel", data.qvel), ("qacc", data.qacc)):
                    found[name].append(np.array(values))
                found["sites"].append(np.array(data.site_xpos).reshape(-1, 3))
                found["mass"].append(mass_matrix(model, data))
                residuals.append(self._residuals(data))
        finally:
            model.opt.disableflags = before
        qpos, qvel, qacc, sites, mass = (np.array(values) for values in found.values())
        inverse = np.linalg.inv(self.rows)
        axes = np.stack([self.plane.x, self.plane.y], axis=1)
        return ModelStates(
            t=times,
            q=self.coordinates(qpos),
            u=self.speeds(qvel),
            a=self.speeds(qacc),
            mass=inverse.T @ mass @ inverse,
            gaps={name: qpos @ row - limit for name, (row, limit) in self.limits.items()},
            markers={name: sites[:, site] @ axes for name, site in self.sites.items()},
            loops={
                name: (
                    np.array([float(np.linalg.norm(rows[index][:3])) for rows in residuals]),
                    np.array([self._turned(index, rows[index]) for rows in residuals]),
                )
                for name, index in self.equalities.items()
            },
            couplers={
                name: np.array([float(rows[index][0]) for rows in residuals]) / factor
                for name, (index, factor) in self.couplings.items()
            },
        )

    def _turned(self, equality: int, rows: FloatArray) -> float:
        """Value of |sin| of half the angle by which a weld is off; 0 of others."""
        if len(rows) <= 3:
            return 0.0
        return float(np.linalg.norm(rows[3:])) / float(self.model.eq_data[equality, 10])

    def _residuals(self, data: Any) -> dict[int, FloatArray]:
        """MuJoCo's residuals of the equalities at a state, by number: three of points."""
        model = self.model
        read = (*self.equalities.values(), *(index for index, _ in self.couplings.values()))
        if not read:
            return {}
        before = model.opt.disableflags
        flags = mujoco.mjtDisableBit
        model.opt.disableflags = (before & ~int(flags.mjDSBL_CONSTRAINT)) | flags.mjDSBL_LIMIT
        mujoco.mj_forward(model, data)
        found = {index: np.array(data.efc_pos[equality_rows(data, index)]) for index in read}
        model.opt.disableflags = before
        return found


def planar_model(
    model: Any,
    name: str,
    *,
    qpos: FloatArray | None = None,
    qvel: FloatArray | None = None,
    ctrl: FloatArray | ControlRecord | None = None,
    without: Collection[str] = (),
) -> PlanarModel:
    """Read a compiled model.

    Args:
        model: MuJoCo's; it stays as it is.
        name: of the mechanism.
        qpos: of the start, shape (nq,); `qpos0` if left out.
        qvel: of the start, shape (nv,); at rest if left out.
        ctrl: controls, constant, shape (nu,), or recorded; zeros if left out.
        without: what to leave out, of :data:`LEAVABLE`; contacts always are.

    Raises:
        InputError: a start is of the wrong length or not finite, or starts beyond a limit, or the
            record is of other actuators.
        UnsupportedProblemError: the model does not move in a plane, or has a feature that
            mechanisms have not; the sentence names it.
    """
    if not isinstance(ctrl, ControlRecord):
        held = _given("ctrl", ctrl, np.zeros(model.nu))
        ctrl = ControlRecord(np.zeros(1), held[None, :])
    given = (
        _given("qpos", qpos, np.array(model.qpos0)),
        _given("qvel", qvel, np.zeros(model.nv)),
        _in_order(ctrl, model, name),
    )
    unknown = set(without).difference(LEAVABLE)
    if unknown:
        raise InputError(
            f"{min(unknown)!r} cannot be left out; what can be is {', '.join(LEAVABLE)}."
        )
    moved = copy(model)
    if "contacts" in without:
        moved.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_CONTACT
    return _Reader(copy(model), name, *given, frozenset(without), given=moved).read()


def _given(what: str, value: FloatArray | None, usual: FloatArray) -> FloatArray:
    if value is None:
        return usual
    values = np.array(value, dtype=np.float64)
    if values.shape != usual.shape:
        told = ",".join(f"{value:g}" for value in values.ravel())
        raise InputError(f"{what} = {told} has {values.size} values; this model has {usual.size}.")
    if not np.isfinite(values).all():
        raise InputError(f"{what} = {values.tolist()} must be finite.")
    return values


def _in_order(record: ControlRecord, model: Any, name: str) -> ControlRecord:
    """A record with its columns in the order of the model's actuators."""
    known = [model.actuator(k).name or f"actuator {k}" for k in range(model.nu)]
    columns = record.values.shape[1]
    if not record.names:
        if columns == model.nu:
            return record
        raise InputError(
            f"{record.source} has {columns} columns of controls; {name!r} has {model.nu} actuators."
        )
    if sorted(record.names) != sorted(known):
        raise InputError(
            f"{record.source} has controls of {', '.join(record.names)}; the actuators of {name!r} "
            f"are {', '.join(known) or 'none'}."
        )
    order = [record.names.index(actuator) for actuator in known]
    return replace(record, values=record.values[:, order], names=tuple(known))


def as_name(text: str, otherwise: str) -> str:
    """A text as a name here: other characters become '_', and a letter comes first."""
    name = re.sub(r"[^A-Za-z0-9_ \-]", "_", text)[:_LONGEST_NAME] or otherwise
    return name if name[0].isalpha() else f"n{name}"


class _Names:
    """Names for a mechanism: MuJoCo's, where they are names here, and once each."""

    def __init__(self) -> None:
        self._used: set[str] = {GROUND}

    def new(self, wanted: str, otherwise: str) -> str:
        """A name that is not used yet."""
        base = as_name(wanted, otherwise)
        name, k = base, 1
        while name in self._used:
            k += 1
            name = f"{base} {k}"
        self._used.add(name)
        return name


@dataclass(frozen=True)
class _Made:
    """A joint of MuJoCo's, and the joint here that it is a part of."""

    joint: int
    name: str
    turns: bool
    built: AnyJoint

    @property
    def between(self) -> dict[str, Any]:
        """Fields of an element between its bodies."""
        return {"body": self.built.child, "relative_to": self.built.parent}


_Ends = tuple[tuple[int, int], tuple[complex, complex], float]
"""Bodies of the model, points of theirs that coincide, in the plane, and the angle [rad] by which
the second body is turned against the first, both zero at `qpos0`, clockwise."""


@dataclass
class _Reader:
    model: Any
    name: str
    qpos: FloatArray
    qvel: FloatArray
    controls: ControlRecord
    without: frozenset[str]
    given: Any
    """The model as it is moved, which stays so."""
    left_out: list[str] = field(default_factory=list[str])
    bodies: list[Body] = field(default_factory=list[Body])
    joints: list[AnyJoint] = field(default_factory=list[AnyJoint])
    stops: list[AnyStop] = field(default_factory=list[AnyStop])
    forces: list[AnyForceElement] = field(default_factory=list[AnyForceElement])
    home: dict[int, str] = field(default_factory=dict[int, str])
    """The body here, or the ground, that each of MuJoCo's bodies moves with."""
    origin: dict[str, complex] = field(default_factory=lambda: {GROUND: 0j})
    """Origin of each body's frame, at `qpos0`."""
    angle: dict[str, tuple[FloatArray, float]] = field(
        default_factory=dict[str, tuple[FloatArray, float]]
    )
    """Angle of each body by qpos: a row and a constant."""
    limits: dict[str, tuple[FloatArray, float]] = field(
        default_factory=dict[str, tuple[FloatArray, float]]
    )
    sites: dict[str, int] = field(default_factory=dict[str, int])
    equalities: dict[str, int] = field(default_factory=dict[str, int])
    made: dict[int, _Made] = field(default_factory=dict[int, "_Made"])
    slides: list[tuple[str, FloatArray]] = field(default_factory=list[tuple[str, FloatArray]])
    """Slide coordinates, each with its row of C."""
    sums: list[tuple[int, str, FloatArray, float]] = field(
        default_factory=list[tuple[int, str, FloatArray, float]]
    )
    """Equalities of joints or tendons: number, name, row over qpos, and what it holds that at."""
    couplings: dict[str, tuple[int, float]] = field(default_factory=dict[str, tuple[int, float]])

    def read(self) -> PlanarModel:
        """Read all."""
        self._refuse_features()
        self.data = mujoco.MjData(self.model)
        self.data.qpos[:] = self.model.qpos0
        mujoco.mj_kinematics(self.model, self.data)
        mujoco.mj_comPos(self.model, self.data)
        self.plane = self._plane()
        self.names, self.points = _Names(), _Names()
        self.joint_names = _Names()
        self.element_names, self.stop_names = _Names(), _Names()
        self.angle[GROUND] = np.zeros(self.model.nq), 0.0
        self.home[0] = GROUND
        for body in range(1, self.model.nbody):
            self._add_body(body)
        if not self.bodies:
            raise UnsupportedProblemError(f"{self.name!r} has no joint: nothing in it moves.")
        self._add_equalities()
        self._add_actuators()
        rows, offset = self._coordinates()
        gravity = self._gravity()
        size = abs(gravity)
        mechanism = Mechanism(
            name=self.name,
            bodies=tuple(self.bodies),
            joints=tuple(self.joints),
            stops=tuple(self.stops),
            markers=tuple(self._markers()),
            force_elements=tuple(self.forces),
            couplers=tuple(self._couplers(rows, offset)),
            gravity=size,
            gravity_direction=_unit(gravity / size) if size else (0.0, -1.0),
            start=tuple((offset + rows @ self.qpos).tolist()),
            start_speeds=tuple((rows @ self.qvel).tolist()) if self.qvel.any() else (),
        )
        return PlanarModel(
            mechanism, self.model, self.given, self.qpos, self.qvel, self.plane, rows, offset,
            self.controls, self.limits, self.sites, self.equalities, self.couplings,
            tuple(self.left_out),
        )  # fmt: skip

    # --- features

    def _refuse_features(self) -> None:
        """Refuse what no mechanism has, or leave it out of the model."""
        model, option = self.model, self.model.opt
        for what, is_there in (
            ("flexible bodies", model.nflex > 0),
            ("plug-ins", model.nplugin > 0),
            (
                "compensation of gravity",
                np.any(model.body_gravcomp) and self._is_on("GRAVITY") and option.gravity.any(),
            ),
            # Of later versions than the oldest that is supported
            (
                "bodies that sleep",
                option.enableflags & getattr(mujoco.mjtEnableBit, "mjENBL_SLEEP", 0),
            ),
            ("plastic joints", getattr(model, "nplastic", 0) > 0),
            (
                "actuators with a delay",
                "actuators" not in self.without and np.any(getattr(model, "actuator_delay", 0)),
            ),
            (
                "actuators with several controls",
                np.any(np.asarray(getattr(model, "actuator_ctrlnum", 1)) != 1),
            ),
        ):
            if is_there:
                raise UnsupportedProblemError(f"{self.name!r} has {what}, which no mechanism has.")
        medium, lossy = option.density or option.viscosity or np.any(option.wind), False
        if self._is_on("FRICTIONLOSS"):
            lossy = np.any(model.dof_frictionloss) or np.any(model.tendon_frictionloss)
        for what, word, is_there, leave_out in (
            ("a medium (density, viscosity or wind)", "fluid", medium, self._without_fluid),
            ("friction loss", "friction-loss", lossy, self._without_friction_loss),
        ):
            if is_there and word not in self.without:
                raise UnsupportedProblemError(
                    f"{self.name!r} has {what}, which no mechanism has; --without {word} leaves it "
                    "out."
                )
            if is_there:
                leave_out()
                self.left_out.append(what)
        if self._has_contacts():
            ends = "contacts: they may end what is compared"
            gone = "contacts, also where the file is moved as it is"
            self.left_out.append(gone if "contacts" in self.without else ends)
        option.disableflags |= mujoco.mjtDisableBit.mjDSBL_CONTACT

    def _without_fluid(self) -> None:
        option = self.model.opt
        option.density = option.viscosity = 0.0
        option.wind[:] = 0.0

    def _without_friction_loss(self) -> None:
        self.model.dof_frictionloss[:] = 0.0
        self.model.tendon_frictionloss[:] = 0.0

    def _has_contacts(self) -> bool:
        """Tell whether any two geoms may touch."""
        model = self.model
        if not self._is_on("CONTACT"):
            return False
        types, affinities = model.geom_contype, model.geom_conaffinity
        pairs = (types[:, None] & affinities[None, :]) | (affinities[:, None] & types[None, :])
        bodies = model.geom_bodyid
        excluded = np.isin((bodies[:, None] << 16) + bodies[None, :], model.exclude_signature)
        apart = (bodies[:, None] != bodies[None, :]) & ~excluded & ~excluded.T
        moving = (model.body_weldid[model.geom_bodyid] != 0)[:, None]
        return model.npair > 0 or bool(np.any((pairs != 0) & apart & moving))

    def _is_on(self, flag: str) -> bool:
        """Tell whether a part of MuJoCo is not disabled, alone or with all constraints."""
        flags = {flag} | ({"CONSTRAINT"} if flag in _CONSTRAINTS else set[str]())
        bits = (int(getattr(mujoco.mjtDisableBit, f"mjDSBL_{each}")) for each in flags)
        return not any(self.model.opt.disableflags & bit for bit in bits)

    def _gravity(self) -> complex:
        gravity = np.array(self.model.opt.gravity) if self._is_on("GRAVITY") else np.zeros(3)
        in_plane = self.plane.vector(gravity)
        return 0j if abs(in_plane) < _ALONG * np.linalg.norm(gravity) else in_plane

    # --- the plane

    def _plane(self) -> Plane:
        """The plane that all joints move in.

        Raises:
            UnsupportedProblemError: one leaves it; it is named.
        """
        hinges, slides = list[int](), list[int]()
        kinds = mujoco.mjtJoint
        for joint in range(self.model.njnt):
            kind = self.model.jnt_type[joint]
            if kind == kinds.mjJNT_HINGE:
                hinges.append(joint)
            elif kind == kinds.mjJNT_SLIDE:
                slides.append(joint)
            else:
                word = "free" if kind == kinds.mjJNT_FREE else "ball"
                raise self._leaves(joint, f"a {word} joint, which leaves every plane")
        plane = Plane.normal_to(self._normal(hinges, slides))
        for joint in hinges:
            off = float(np.linalg.norm(np.cross(self._axis(joint), plane.normal)))
            if off > _ALONG:
                raise self._leaves(joint, "whose axis is not across the plane of the others", off)
        for joint in slides:
            off = abs(float(self._axis(joint) @ plane.normal))
            if off > _ALONG:
                raise self._leaves(joint, "a slide that leaves the plane of the others", off)
        return plane.along(self._slides_of_a_free_body())

    def _normal(self, hinges: Sequence[int], slides: Sequence[int]) -> FloatArray:
        if hinges:
            return self._axis(hinges[0])
        axes = [self._axis(joint) for joint in slides]
        gravity = np.array(self.model.opt.gravity)
        size = np.linalg.norm(gravity)
        # One direction has many planes: that with gravity in it, or with MuJoCo's z or x.
        beside = [*axes[1:], *([gravity / size] if size else []), *np.eye(3)[[2, 0]]]
        for other in beside if axes else ():
            normal = np.cross(axes[0], other)
            if np.linalg.norm(normal) > 1e-6:
                return normal / np.linalg.norm(normal)
        return np.array([0.0, -1.0, 0.0])

    def _slides_of_a_free_body(self) -> list[FloatArray]:
        """Axes of the first body in the world that begins with two slides."""
        model, slide = self.model, mujoco.mjtJoint.mjJNT_SLIDE
        for body in range(1, model.nbody):
            first = int(model.body_jntadr[body])
            in_world = model.body_weldid[model.body_parentid[body]] == 0
            two = model.body_jntnum[body] >= 2 and np.all(
                model.jnt_type[first : first + 2] == slide
            )
            if in_world and two:
                return [self._axis(joint) for joint in (first, first + 1)]
        return []

    def _axis(self, joint: int) -> FloatArray:
        return np.array(self.data.xaxis[joint])

    def _leaves(self, joint: int, why: str, sine: float | None = None) -> UnsupportedProblemError:
        """Refusal of a joint, with the angle by which it leaves the plane, if that has a sine."""
        off = "" if sine is None else f": {np.arcsin(min(1.0, sine)):.2g} rad off"
        body = self._mujoco_name("body", int(self.model.jnt_bodyid[joint]))
        return UnsupportedProblemError(
            f"{self.name!r} does not move in a plane: the body {body!r} has "
            f"{self._mujoco_name('joint', joint)!r}, {why}{off}."
        )

    def _mujoco_name(self, kind: str, index: int) -> str:
        return getattr(self.model, kind)(index).name or f"{kind} {index}"

    # --- bodies and joints

    def _at(self, point: FloatArray) -> complex:
        """A point of MuJoCo's world at `qpos0`, in the plane."""
        return self.plane.vector(np.asarray(point))

    def _in(self, body: str, at: complex) -> Vector:
        """A point of the plane at `qpos0`, in a body's frame."""
        return _vector(at - self.origin[body])

    def _add_body(self, body: int) -> None:
        model, data = self.model, self.data
        if body in self.home:
            return
        parent = self.home[int(model.body_parentid[body])]
        joints = range(model.body_jntadr[body], model.body_jntadr[body] + model.body_jntnum[body])
        has_mass = bool(model.body_mass[body])
        if not joints and (parent == GROUND or not has_mass):
            self.home[body] = parent
            return
        own = self.names.new(model.body(body).name, f"body {body}")
        self.home[body], self.origin[own] = own, self._at(data.xpos[body])
        self.angle[own] = self.angle[parent]
        turns = self._join(own, parent, list(joints), body)
        # What is welded to a body without mass gives it its own.
        parts = [body] if has_mass else np.flatnonzero(model.body_weldid == body).tolist()
        self.home |= dict.fromkeys(parts, own)
        masses = model.body_mass[parts]
        if not masses.sum() > 0:
            raise UnsupportedProblemError(
                f"{self.name!r}: the body {own!r} moves and has no mass, and every body here has."
            )
        centres = np.array([self._at(data.xipos[part]) for part in parts])
        centre = complex(masses @ centres / masses.sum())
        abouts = data.ximat[parts].reshape(-1, 3, 3).transpose(0, 2, 1) @ self.plane.normal
        inertias = np.sum(abouts**2 * model.body_inertia[parts], axis=1)
        self.bodies.append(
            Body(
                name=own,
                angle=turns,
                mass=float(masses.sum()),
                centre=self._in(own, centre),
                inertia=float(np.sum(inertias + masses * np.abs(centres - centre) ** 2)),
            )
        )

    def _join(self, own: str, parent: str, joints: list[int], body: int) -> str | None:
        """Add the joint of a body to its parent; the name of its angle, or None."""
        kinds = [int(self.model.jnt_type[joint]) for joint in joints]
        hinge, slide = int(mujoco.mjtJoint.mjJNT_HINGE), int(mujoco.mjtJoint.mjJNT_SLIDE)
        if not joints:
            at = self.origin[own]
            self.joints.append(
                WeldJoint(
                    name=self.joint_names.new(f"{own} weld", ""), parent=parent, child=own,
                    parent_point=self._in(parent, at), child_point=self._in(own, at),
                )
            )  # fmt: skip
            return None
        names = [self._joint_name(joint) for joint in joints]
        anchor = self._at(self.data.xanchor[joints[-1]])
        ends: dict[str, Any] = {"parent": parent, "child": own, "name": names[-1]}
        ends["child_point"] = self._in(own, anchor)
        turns: str | None = None
        if kinds[-1] == hinge:
            turns = names[-1]
            self._turn(own, joints[-1])
        match kinds:
            case [k] if k == hinge:
                self.joints.append(PinJoint(**ends, parent_point=self._in(parent, anchor)))
            case [k] if k == slide:
                line = self._line(parent, joints[0], names[0], anchor)
                self.joints.append(PrismaticJoint(**ends, **line))
            case [k, m] if (k, m) == (slide, hinge):
                ends["name"] = self.joint_names.new(f"{own} joint", "")
                line = self._line(parent, joints[0], names[0], anchor)
                self.joints.append(SlotJoint(**ends, **line))
            case [k, m, n] if (k, m, n) == (slide, slide, hinge) and parent == GROUND:
                ends["name"] = self.joint_names.new(f"{own} joint", "")
                self.joints.append(FreeJoint(**ends, **self._free(joints[:2], names[:2], anchor)))
            case [k, m] if (k, m) == (slide, slide) and parent == GROUND:
                ends["name"] = self.joint_names.new(f"{own} joint", "")
                self.joints.append(TranslationJoint(**ends, **self._free(joints, names, anchor)))
            case _:
                words = ", ".join(
                    f"{n!r} ({'hinge' if k == hinge else 'slide'})"
                    for n, k in zip(names, kinds, strict=True)
                )
                raise UnsupportedProblemError(
                    f"{self.name!r}: the body {own!r} has the joints {words}; read are one hinge, "
                    "one slide, a slide and a hinge, and in the world two slides, alone or with a "
                    "hinge."
                )
        for joint, name, kind in zip(joints, names, kinds, strict=True):
            made = _Made(joint, name, kind == hinge, self.joints[-1])
            self.made[joint] = made
            self._add_properties(made)
        return turns

    def _joint_name(self, joint: int) -> str:
        return self.joint_names.new(self.model.joint(joint).name, f"joint {joint}")

    def _turn(self, own: str, joint: int) -> None:
        row, constant = self.angle[own]
        address, sense = int(self.model.jnt_qposadr[joint]), self.plane.sense(self._axis(joint))
        turned = row.copy()
        turned[address] += sense
        self.angle[own] = turned, constant - sense * float(self.model.qpos0[address])

    def _line(self, parent: str, joint: int, name: str, anchor: complex) -> dict[str, Any]:
        """Fields of a joint along a slide, whose coordinate is MuJoCo's."""
        axis = self.plane.vector(self._axis(joint))
        address, row = int(self.model.jnt_qposadr[joint]), np.zeros(self.model.nq)
        row[address] = 1.0
        self.slides.append((name, row))
        zero = anchor - float(self.model.qpos0[address]) * axis
        return {
            "axis": _unit(axis),
            "coordinate": name,
            "parent_point": self._in(parent, zero),
        }

    def _free(self, joints: Sequence[int], names: Sequence[str], anchor: complex) -> dict[str, Any]:
        """Fields of a free joint: x and y are sums of two slides that are across each other."""
        axes = [self.plane.vector(self._axis(joint)) for joint in joints]
        if abs((axes[0] * axes[1].conjugate()).real) > _ALONG:
            raise UnsupportedProblemError(
                f"{self.name!r}: the slides {names[0]!r} and {names[1]!r} are not at right angles."
            )
        rows, zero = np.zeros((2, self.model.nq)), anchor
        for joint, axis in zip(joints, axes, strict=True):
            address = int(self.model.jnt_qposadr[joint])
            rows[:, address] = axis.real, axis.imag
            zero -= float(self.model.qpos0[address]) * axis
        first = 0 if abs(axes[0].real) >= abs(axes[1].real) else 1  # that along x
        coordinates = names[first], names[1 - first]
        self.slides += zip(coordinates, rows, strict=True)
        return {"coordinates": coordinates, "parent_point": self._in(GROUND, zero)}

    def _coordinates(self) -> tuple[FloatArray, FloatArray]:
        """C and the offset of q = offset + C qpos."""
        turning = [self.angle[body.name] for body in self.bodies if body.angle is not None]
        parts = [*turning, *((row, 0.0) for _, row in self.slides)]
        return np.array([row for row, _ in parts]), np.array([value for _, value in parts])

    def _markers(self) -> Iterator[Marker]:
        for site in range(self.model.nsite):
            body = self.home[int(self.model.site_bodyid[site])]
            if body == GROUND:  # its place tells nothing of the motion
                continue
            at = self._in(body, self._at(self.data.site_xpos[site]))
            name = self.points.new(self.model.site(site).name, f"site {site}")
            self.sites[name] = site
            yield Marker(name=name, body=body, point=at)

    # --- what joints have

    def _add_properties(self, made: _Made) -> None:
        model, joint = self.model, made.joint
        degree = int(model.jnt_dofadr[joint])
        if self._has(jnt_stiffnesspoly=joint, dof_dampingpoly=degree):
            raise self._lacks(f"the joint {made.name!r} has a nonlinear spring or damper")
        armature = float(model.dof_armature[degree])
        if armature:
            self._add_inertia(made, f"{made.name} rotor", armature)
        stiffness = float(model.jnt_stiffness[joint]) if self._is_on("SPRING") else 0.0
        damping = float(model.dof_damping[degree]) if self._is_on("DAMPER") else 0.0
        if stiffness or damping:
            name = f"{made.name} {'spring' if stiffness else 'damper'}"
            at_rest = float(model.qpos_spring[model.jnt_qposadr[joint]])
            self._add_spring(made, name, stiffness, damping, at_rest)
        self._add_limits(made)

    def _add_inertia(self, made: _Made, name: str, armature: float) -> None:
        element: dict[str, Any] = {"name": self.element_names.new(name, "")}
        element |= {**made.between, "inertia": armature}
        if made.turns:
            self.forces.append(RotorInertia(**element))
        else:
            self.forces.append(SlideInertia(**element, coordinate=self._along(made)[0]))

    def _lacks(self, what: str, word: str = "") -> UnsupportedProblemError:
        """Refusal of what no mechanism has, with the word that leaves it out, if one does."""
        way = f"; --without {word} leaves it out" if word else ""
        return UnsupportedProblemError(f"{self.name!r}: {what}; no mechanism has that{way}.")

    def _add_spring(
        self, made: _Made, name: str, stiffness: float, damping: float, at_rest: float
    ) -> None:
        """Add -(k (qpos - at_rest) + c qvel) on a hinge or slide."""
        element: dict[str, Any] = {"name": self.element_names.new(name, ""), **made.between}
        element |= {"stiffness": stiffness, "damping": damping}
        if made.turns:
            zero = float(self.model.qpos0[self.model.jnt_qposadr[made.joint]])
            rest = self.plane.sense(self._axis(made.joint)) * (at_rest - zero)
            self.forces.append(RotationalSpringDamper(**element, rest_angle=rest))
            return
        coordinate, sense = self._along(made)
        self.forces.append(
            SlideSpringDamper(**element, coordinate=coordinate, rest_position=sense * at_rest)
        )

    def _add_force(self, made: _Made, name: str, force: float) -> None:
        """Add a constant generalized force on a hinge or slide."""
        element: dict[str, Any] = {"name": self.element_names.new(name, ""), **made.between}
        if made.turns:
            sense = self.plane.sense(self._axis(made.joint))
            self.forces.append(ConstantTorque(**element, torque=sense * force))
            return
        coordinate, sense = self._along(made)
        self.forces.append(SlideSpringDamper(**element, coordinate=coordinate, force=sense * force))

    def _add_record(self, made: _Made, name: str, efforts: FloatArray) -> None:
        """Add a recorded generalized force on a hinge or slide, each value from its time on."""
        changed = [0, *(np.flatnonzero(np.diff(efforts)) + 1).tolist()]
        record: dict[str, Any] = {
            "name": self.element_names.new(name, ""),
            **made.between,
            "times": self.controls.times[changed].tolist(),
        }
        if made.turns:
            sense = self.plane.sense(self._axis(made.joint))
            torques = (sense * efforts[changed]).tolist()
            self.forces.append(RecordedTorque(**record, torques=torques))
            return
        coordinate, sense = self._along(made)
        forces = (sense * efforts[changed]).tolist()
        self.forces.append(RecordedForce(**record, coordinate=coordinate, forces=forces))

    def _along(self, made: _Made) -> tuple[str, int]:
        """Coordinate of a slide, and 1 or -1, its sense; that of a free joint is along an axis."""
        axis = self.plane.vector(self._axis(made.joint))
        along = [_dot(direction, axis) for direction in made.built.free_directions]
        k = max(range(len(along)), key=lambda k: abs(along[k]))
        if abs(abs(along[k]) - 1.0) > _ALONG:
            raise self._lacks(f"the slide {made.name!r} is oblique and has a spring or a force")
        return made.built.slides[k], _sign(along[k])

    def _add_limits(self, made: _Made) -> None:
        address = int(self.model.jnt_qposadr[made.joint])
        zero = float(self.model.qpos0[address])
        for side, limit in self._limits(made.joint):
            gap = side * (float(self.qpos[address]) - limit)
            if -_DIGITS <= gap < -_TOUCHING:
                self.left_out.append(f"{-gap:.2g} by which {made.name!r} starts beyond its limit")
                self.qpos[address], gap = limit, 0.0
            name = self.stop_names.new(f"{made.name} {'lower' if side > 0 else 'upper'} limit", "")
            self.limits[name] = side * np.eye(self.model.nq)[address], side * limit
            stop: dict[str, Any] = {"name": name, **made.between}
            stop["closed"] = self._closed(made.name, gap)
            if made.turns:
                # Its own angle less the parent's is sense * (qpos - qpos0).
                sense = _sign(side * self.plane.sense(self._axis(made.joint)))
                self.stops.append(Stop(**stop, sense=sense, limit=side * (limit - zero)))
                continue
            axis = self.plane.vector(self._axis(made.joint))
            offset = side * (_dot(complex(*made.built.parent_point), axis) + limit)
            stop |= {"point": made.built.child_point, "normal": _unit(side * axis)}
            self.stops.append(PointStop(**stop, offset=offset))

    def _limits(self, joint: int) -> Iterator[tuple[int, float]]:
        """Side (1 of the lower end) and position of each limit.

        A limit's reference acceleration -k (distance - margin) vanishes at its margin: it holds the
        joint there (https://mujoco.readthedocs.io/en/stable/computation.html#reference).
        """
        if not self.model.jnt_limited[joint] or not self._is_on("LIMIT"):
            return
        if "limits" in self.without:
            self.model.jnt_limited[joint] = 0
            self.left_out.append(f"limits of {self._mujoco_name('joint', joint)!r}")
            return
        low, high = map(float, self.model.jnt_range[joint])
        margin = float(self.model.jnt_margin[joint])
        yield 1, low + margin
        yield -1, high - margin

    def _closed(self, joint: str, gap: float) -> bool:
        if gap < -_TOUCHING:
            raise InputError(
                f"{self.name!r} starts beyond a limit of {joint!r}, by {-gap:.3g}; give a start "
                "within its limits (qpos, or a keyframe), or leave the limits out."
            )
        return abs(gap) <= _TOUCHING

    # --- equalities

    def _add_equalities(self) -> None:
        model = self.model
        for k in range(model.neq):
            name = self._mujoco_name("equality", k)
            if not model.eq_active0[k] or not self._is_on("EQUALITY"):
                continue
            if "equalities" in self.without:
                model.eq_active0[k] = 0
                self.left_out.append(f"equality {name!r}")
                continue
            kind = mujoco.mjtEq(int(model.eq_type[k]))
            is_weld = kind == mujoco.mjtEq.mjEQ_WELD
            if kind in (mujoco.mjtEq.mjEQ_JOINT, mujoco.mjtEq.mjEQ_TENDON):
                self._note_sum(k, name)
                continue
            if not is_weld and kind != mujoco.mjtEq.mjEQ_CONNECT:
                word = kind.name.removeprefix("mjEQ_").lower()
                raise self._lacks(f"the equality {name!r} is of the kind {word!r}", "equalities")
            if is_weld and not model.eq_data[k, 10]:
                raise self._lacks(f"the weld {name!r} holds no angle (torquescale)", "equalities")
            self._add_loop(k, name, is_weld=is_weld)

    def _add_loop(self, k: int, name: str, *, is_weld: bool) -> None:
        """Add the joint of an equality, as a loop that it closes."""
        if self.model.eq_objtype[k] == mujoco.mjtObj.mjOBJ_SITE:
            bodies, points, turn = self._between_sites(k)
        else:
            bodies, points, turn = self._between_bodies(k, is_weld=is_weld)
        parent, child = (self.home[body] for body in bodies)
        if child == GROUND:
            parent, child, points, turn = child, parent, points[::-1], -turn
        joint = self.joint_names.new(name, "")
        self.equalities[joint] = k
        fields: dict[str, Any] = {
            "name": joint,
            "parent": parent,
            "child": child,
            "parent_point": self._in(parent, points[0]),
            "child_point": self._in(child, points[1]),
        }
        self.joints.append(WeldJoint(**fields, angle=turn) if is_weld else PinJoint(**fields))

    def _note_sum(self, k: int, name: str) -> None:
        """Note an equality of joints or of tendons, one - c1 other = c0 from `qpos0` on."""
        model, numbers = self.model, np.array(self.model.eq_data[k])
        one, other = int(model.eq_obj1id[k]), int(model.eq_obj2id[k])
        row, shift = self._length(k, one, name), float(numbers[0])
        if other >= 0:
            if numbers[2:5].any():
                raise self._lacks(f"the equality {name!r} is not linear", "equalities")
            row -= float(numbers[1]) * self._length(k, other, name)
        if not row.any():
            raise self._lacks(f"the equality {name!r} holds nothing that moves", "equalities")
        self.sums.append((k, name, row, shift + float(row @ model.qpos0)))

    def _length(self, k: int, index: int, name: str) -> FloatArray:
        """Row over qpos of the joint or tendon of an equality."""
        model, row = self.model, np.zeros(self.model.nq)
        if model.eq_type[k] == mujoco.mjtEq.mjEQ_JOINT:
            row[int(model.jnt_qposadr[index])] = 1.0
            return row
        for w in self._wraps(index):
            if model.wrap_type[w] != mujoco.mjtWrap.mjWRAP_JOINT:
                raise self._lacks(
                    f"the equality {name!r} is of a tendon between sites", "equalities"
                )
            row[int(model.jnt_qposadr[int(model.wrap_objid[w])])] += float(model.wrap_prm[w])
        return row

    def _couplers(self, rows: FloatArray, offset: FloatArray) -> Iterator[Coupler]:
        """Equalities of joints and tendons in the coordinates q = offset + rows qpos."""
        names = [body.angle for body in self.bodies if body.angle is not None]
        names += [name for name, _ in self.slides]
        for k, name, row, held in self.sums:
            weights = np.linalg.solve(rows.T, row)
            largest = np.abs(weights).max()
            # The outermost that has half of the largest weight follows the others.
            follows = int(np.flatnonzero(np.abs(weights) >= 0.5 * largest)[-1])
            factor = float(weights[follows])
            terms = tuple(
                CouplerTerm(coordinate=names[i], ratio=-float(weights[i]) / factor)
                for i in np.flatnonzero(np.abs(weights) > _ROUNDED * largest).tolist()
                if i != follows
            )
            coupler = self.joint_names.new(name, "")
            self.couplings[coupler] = k, factor
            yield Coupler(
                name=coupler,
                coordinate=names[follows],
                terms=terms,
                offset=(held + float(weights @ offset)) / factor,
            )

    def _between_sites(self, k: int) -> _Ends:
        data, sites = self.data, (int(self.model.eq_obj1id[k]), int(self.model.eq_obj2id[k]))
        one, other = (int(self.model.site_bodyid[site]) for site in sites)
        first, second = (self._at(data.site_xpos[site]) for site in sites)
        turn = self._turned_by(*(np.array(data.site_xmat[site]) for site in sites))
        return (one, other), (first, second), turn

    def _between_bodies(self, k: int, *, is_weld: bool) -> _Ends:
        data, numbers = self.data, np.array(self.model.eq_data[k])
        one, other = int(self.model.eq_obj1id[k]), int(self.model.eq_obj2id[k])
        frames = [np.array(data.xmat[body]).reshape(3, 3) for body in (one, other)]

        def world(body: int, frame: FloatArray, point: FloatArray) -> complex:
            return self._at(np.array(data.xpos[body]) + frame @ point)

        if not is_weld:
            points = world(one, frames[0], numbers[:3]), world(other, frames[1], numbers[3:6])
            return (one, other), points, 0.0
        # A point of body 2, and the place and turn of body 2 in body 1's frame
        turned = np.zeros(9)
        mujoco.mju_quat2Mat(turned, numbers[6:10])
        relative = turned.reshape(3, 3)
        at = numbers[3:6] + relative @ numbers[:3]
        points = world(one, frames[0], at), world(other, frames[1], numbers[:3])
        return (one, other), points, self._turned_by(frames[0] @ relative, frames[1])

    def _turned_by(self, one: FloatArray, other: FloatArray) -> float:
        """Clockwise angle by which two frames, (3, 3) or (9,), are turned against each other."""
        moved = one.reshape(3, 3) @ other.reshape(3, 3).T
        along = self.plane.vector(moved @ self.plane.x)
        return -math.atan2(along.imag, along.real)

    # --- tendons and actuators

    def _add_actuators(self) -> None:
        model = self.model
        self._add_tendons()
        for k in range(model.nu):
            name = self._mujoco_name("actuator", k)
            if "actuators" in self.without:
                model.actuator_gear[k] = 0.0
                self.left_out.append(f"actuator {name!r}")
                continue
            self._add_drive(k, name)
            if self._is_on("ACTUATION") and not self._is_disabled(k):
                self._add_actuator(k, name)

    def _is_disabled(self, k: int) -> bool:
        """Tell whether an actuator's group is disabled, as the first 31 can be."""
        group, disabled = int(self.model.actuator_group[k]), int(self.model.opt.disableactuator)
        return 0 <= group <= 30 and bool(disabled >> group & 1)

    def _add_drive(self, k: int, name: str) -> None:
        """Add an actuator's own inertia and damping, which act whether it is disabled or not."""
        model = self.model
        if self._has(actuator_dampingpoly=k):
            raise self._lacks(f"the actuator {name!r} has a nonlinear damper", "actuators")
        # Of later versions than the oldest that is supported
        if not self._has(actuator_armature=k, actuator_damping=k):
            return
        armature, damping = float(model.actuator_armature[k]), float(model.actuator_damping[k])
        ((joint, weight),) = self._transmission(k, name, alone=True)
        made = self.made[joint]
        if armature:
            self._add_inertia(made, f"{name} rotor", weight**2 * armature)
        if damping and self._is_on("DAMPER"):
            self._add_spring(made, f"{name} damper", 0.0, weight**2 * damping, 0.0)

    def _add_tendons(self) -> None:
        """Add springs, dampers and limits of tendons."""
        model = self.model
        for k in range(model.ntendon):
            name = self._mujoco_name("tendon", k)
            if "tendons" in self.without:
                self._leave_tendon_out(k, name)
                continue
            limited = bool(model.tendon_limited[k]) and self._is_on("LIMIT")
            stiffness = float(model.tendon_stiffness[k]) if self._is_on("SPRING") else 0.0
            damping = float(model.tendon_damping[k]) if self._is_on("DAMPER") else 0.0
            # Of later versions than the oldest that is supported
            unknown = {
                "a nonlinear spring or damper": self._has(
                    tendon_stiffnesspoly=k, tendon_dampingpoly=k
                ),
                "an armature": self._has(tendon_armature=k),
            }
            for what, is_there in unknown.items():
                if is_there:
                    raise self._lacks(f"the tendon {name!r} has {what}", "tendons")
            if stiffness or damping or limited:
                self._add_tendon(k, name, stiffness, damping, limited=limited)

    def _leave_tendon_out(self, k: int, name: str) -> None:
        parts = [getattr(self.model, f"tendon_{what}", None) for what in _OF_TENDONS]
        there = [part for part in parts if part is not None and np.any(part[k])]
        for part in there:
            part[k] = 0
        if there:
            self.left_out.append(f"spring, damper, armature and limit of the tendon {name!r}")

    def _has(self, **numbers: int) -> bool:
        """Tell whether a field of the model, where its version has it, is not zero at an index."""
        return any(
            hasattr(self.model, kind) and np.any(getattr(self.model, kind)[k])
            for kind, k in numbers.items()
        )

    def _wraps(self, tendon: int) -> range:
        """Indices of what a tendon passes."""
        first = int(self.model.tendon_adr[tendon])
        return range(first, first + int(self.model.tendon_num[tendon]))

    def _add_tendon(
        self, k: int, name: str, stiffness: float, damping: float, *, limited: bool
    ) -> None:
        model, wraps = self.model, self._wraps(k)
        low, at_rest = (float(length) for length in model.tendon_lengthspring[k])
        if stiffness and low != at_rest:
            raise self._lacks(
                f"the tendon {name!r} has a spring that is slack between two lengths", "tendons"
            )
        law: dict[str, Any] = {"stiffness": stiffness, "damping": damping}
        kinds = {int(model.wrap_type[w]) for w in wraps}
        if kinds == {int(mujoco.mjtWrap.mjWRAP_JOINT)}:
            self._add_fixed_tendon(k, name, law, at_rest, limited=limited)
        elif kinds == {int(mujoco.mjtWrap.mjWRAP_SITE)} and len(wraps) == 2 and not limited:
            self._add_straight_tendon(name, wraps, law, at_rest)
        else:
            what = "limits a distance" if limited else "has a spring or a damper along a bent line"
            raise self._lacks(f"the tendon {name!r} {what}", "tendons")

    def _add_straight_tendon(
        self, name: str, wraps: range, law: Mapping[str, Any], at_rest: float
    ) -> None:
        """Add the spring and damper of a tendon between two sites."""
        model, data = self.model, self.data
        sites = [int(model.wrap_objid[w]) for w in wraps]
        places = [np.array(data.site_xpos[site]) for site in sites]
        if abs((places[1] - places[0]) @ self.plane.normal) > _ALONG:
            raise self._lacks(f"the tendon {name!r} leaves the plane", "tendons")
        one, other = (self.home[int(model.site_bodyid[site])] for site in sites)
        if one == other:
            return
        points = [
            self._in(body, self._at(at)) for body, at in zip((one, other), places, strict=True)
        ]
        if one == GROUND:
            one, other, points = other, one, points[::-1]
        self.forces.append(
            SpringDamper(
                name=self.element_names.new(name, ""), body=one, relative_to=other,
                point=points[0], relative_point=points[1], rest_length=at_rest, **law,
            )
        )  # fmt: skip

    def _add_fixed_tendon(
        self, k: int, name: str, law: Mapping[str, Any], at_rest: float, *, limited: bool
    ) -> None:
        """Add what acts on a weighted sum of hinges, if that is the angle between two bodies."""
        model, row = self.model, np.zeros(self.model.nq)
        for w in self._wraps(k):
            row[int(model.jnt_qposadr[int(model.wrap_objid[w])])] += float(model.wrap_prm[w])
        body, other = self._bodies_of_angle(row, name)
        (one, constant), (two, other_constant) = self.angle[body], self.angle[other]
        # length = weight * (angle of the body less that of the other) + shift
        weight = float(row @ (one - two) / ((one - two) @ (one - two)))
        shift = -weight * (constant - other_constant)
        between: dict[str, Any] = {"body": body, "relative_to": other}
        if any(law.values()):
            self.forces.append(
                RotationalSpringDamper(
                    name=self.element_names.new(name, ""), **between,
                    stiffness=law["stiffness"] * weight**2, damping=law["damping"] * weight**2,
                    rest_angle=(at_rest - shift) / weight,
                )
            )  # fmt: skip
        if not limited:
            return
        margin = float(model.tendon_margin[k])
        for side, bound in zip((1, -1), model.tendon_range[k], strict=True):
            limit = float(bound) + side * margin
            stop = self.stop_names.new(f"{name} {'lower' if side > 0 else 'upper'} limit", "")
            sense = _sign(side * weight)
            part = side / abs(weight)
            self.limits[stop] = part * row, part * limit
            closed = self._closed(name, float(part * (row @ self.qpos - limit)))
            position = sense * (limit - shift) / weight
            self.stops.append(
                Stop(name=stop, **between, sense=sense, limit=position, closed=closed)
            )

    def _bodies_of_angle(self, row: FloatArray, name: str) -> tuple[str, str]:
        """Two bodies, or one and the ground, whose angle a sum of joints is in proportion to."""
        for (one, (first, _)), (two, (second, _)) in combinations(self.angle.items(), 2):
            along = second - first
            size = float(along @ along)
            if (
                size
                and np.abs(row - (row @ along / size) * along).max() <= 1e-12 * np.abs(row).max()
            ):
                return two, one
        raise self._lacks(
            f"the length of the tendon {name!r} follows no angle between two bodies", "tendons"
        )

    def _add_actuator(self, k: int, name: str) -> None:
        """Add what a constant control makes of an actuator: a force, a spring and a damper."""
        model = self.model
        gain = mujoco.mjtGain(int(model.actuator_gaintype[k]))
        bias = mujoco.mjtBias(int(model.actuator_biastype[k]))
        if mujoco.mjtDyn(int(model.actuator_dyntype[k])) != mujoco.mjtDyn.mjDYN_NONE:
            raise self._lacks(f"the actuator {name!r} has an activation of its own", "actuators")
        if gain not in (mujoco.mjtGain.mjGAIN_FIXED, mujoco.mjtGain.mjGAIN_AFFINE):
            raise self._lacks(f"the actuator {name!r} has a gain that is not affine", "actuators")
        if bias not in (mujoco.mjtBias.mjBIAS_NONE, mujoco.mjtBias.mjBIAS_AFFINE):
            raise self._lacks(f"the actuator {name!r} has a bias that is not affine", "actuators")
        control = self.controls.values[:, k]
        if model.actuator_ctrllimited[k] and self._is_on("CLAMPCTRL"):
            control = np.clip(control, *model.actuator_ctrlrange[k])
        parts: FloatArray = control[:, None] * np.array(model.actuator_gainprm[k][:3])
        if gain == mujoco.mjtGain.mjGAIN_FIXED:
            parts[:, 1:] = 0.0
        if bias == mujoco.mjtBias.mjBIAS_AFFINE:
            parts = parts + model.actuator_biasprm[k][:3]
        if model.actuator_forcelimited[k]:
            if parts[:, 1:].any():
                raise self._lacks(f"the actuator {name!r} limits a force that changes", "actuators")
            parts[:, 0] = np.clip(parts[:, 0], *model.actuator_forcerange[k])
        if np.ptp(parts[:, 1:], axis=0).any():
            raise self._lacks(
                f"the actuator {name!r} has a stiffness that its control changes", "actuators"
            )
        if not parts.any():
            return
        if model.actuator_trntype[k] == mujoco.mjtTrn.mjTRN_SITE:
            self._refuse_limited_forces(k, name, range(model.njnt))
            self._add_site_force(k, name, parts)
            return
        joints = self._transmission(k, name, alone=bool(parts[0, 1:].any()))
        self._refuse_limited_forces(k, name, (joint for joint, _ in joints))
        for joint, weight in joints:
            self._add_effort(joint, f"{name} on {self._mujoco_name('joint', joint)}", weight, parts)

    def _refuse_limited_forces(self, k: int, name: str, joints: Iterable[int]) -> None:
        """Refuse an actuator whose force its tendon, or a joint that it moves, limits."""
        model, kind = self.model, self.model.actuator_trntype[k]
        limiting = [
            f"the joint {self.made[joint].name!r}"
            for joint in joints
            if model.jnt_actfrclimited[joint]
        ]
        tendon = int(model.actuator_trnid[k][0])
        if kind == mujoco.mjtTrn.mjTRN_TENDON and self._has(tendon_actfrclimited=tendon):
            limiting.append(f"the tendon {self._mujoco_name('tendon', tendon)!r} of {name!r}")
        if limiting:
            raise self._lacks(f"{limiting[0]} limits the force of its actuators", "actuators")

    def _add_site_force(self, k: int, name: str, parts: FloatArray) -> None:
        """Add a force on a site whose direction a site of the world gives."""
        model, (site, against) = self.model, map(int, self.model.actuator_trnid[k])
        if against < 0 or model.body_weldid[model.site_bodyid[against]] != 0:
            raise self._lacks(
                f"the actuator {name!r} pushes a site in a direction that moves", "actuators"
            )
        gear = np.array(model.actuator_gear[k])
        frame = np.array(self.data.site_xmat[against]).reshape(3, 3)
        force = frame @ gear[:3]
        off_plane = abs(force @ self.plane.normal) > _ALONG * np.linalg.norm(force)
        if off_plane or gear[3:].any() or parts[:, 1:].any() or np.ptp(parts[:, 0]):
            raise self._lacks(
                f"the actuator {name!r} pushes a site otherwise than by a constant force in the "
                "plane",
                "actuators",
            )
        body, at = self.home[int(model.site_bodyid[site])], self._at(self.data.site_xpos[site])
        if body != GROUND:
            push = self.plane.vector(force) * float(parts[0, 0])
            name = self.element_names.new(name, "")
            point = self._in(body, at)
            self.forces.append(
                ConstantForce(name=name, body=body, point=point, force=_vector(push))
            )

    def _transmission(self, k: int, name: str, *, alone: bool) -> list[tuple[int, float]]:
        """Joints that an actuator acts on, each with the derivative of its length by theirs."""
        model, kinds = self.model, mujoco.mjtTrn
        gear, target = float(model.actuator_gear[k][0]), int(model.actuator_trnid[k][0])
        match kinds(int(model.actuator_trntype[k])):
            case kinds.mjTRN_JOINT | kinds.mjTRN_JOINTINPARENT:
                return [(target, gear)]
            case kinds.mjTRN_TENDON:
                wraps = self._wraps(target)
                if any(model.wrap_type[w] != mujoco.mjtWrap.mjWRAP_JOINT for w in wraps):
                    raise self._lacks(f"the actuator {name!r} pulls a spatial tendon", "actuators")
                if alone and len(wraps) > 1:
                    raise self._lacks(
                        f"the actuator {name!r} has a spring over several joints", "actuators"
                    )
                return [(int(model.wrap_objid[w]), gear * float(model.wrap_prm[w])) for w in wraps]
            case _:
                raise self._lacks(
                    f"the actuator {name!r} acts on no joint, fixed tendon or site", "actuators"
                )

    def _add_effort(self, joint: int, name: str, weight: float, parts: FloatArray) -> None:
        """Add weight * (c0 + c1 l + c2 dl/dt) on a joint, with l = weight * qpos.

        `parts` are c0, c1 and c2 at the times of the controls, shape (m, 3); c1 and c2 stay.
        """
        efforts = weight * parts[:, 0]
        slope, rate = (float(c) for c in weight * weight * parts[0, 1:])
        if slope > 0 or rate > 0:
            raise self._lacks(f"{name!r} has a negative stiffness or damping", "actuators")
        if slope or rate:
            self._add_spring(self.made[joint], name, abs(slope), abs(rate), 0.0)
        if np.ptp(efforts):
            self._add_record(self.made[joint], name, efforts)
        elif efforts[0]:
            self._add_force(self.made[joint], name, float(efforts[0]))


def _vector(value: complex) -> Vector:
    return value.real, value.imag


def _unit(value: complex) -> Vector:
    """Components of a unit vector, whose rounding is taken out where it is along an axis."""
    value = value / abs(value)
    parts = [float(np.round(part)) if abs(part - np.round(part)) < 1e-15 else part
             for part in (value.real, value.imag)]  # fmt: skip
    return parts[0], parts[1]


def _dot(one: complex, other: complex) -> float:
    return one.real * other.real + one.imag * other.imag


def _sign(value: float) -> Any:
    return 1 if value > 0 else -1
