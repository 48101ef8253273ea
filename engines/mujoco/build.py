"""The unilateral constraints of a built model besides its joints, as MuJoCo's constraint rows.

A stop is a limit of a joint or tendon, or a contact of a point's sphere with a plane, or with a box
on a body that moves; a slot that closes a loop is two such contacts.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from ...models.arrays import FloatArray
from ...models.elements import (
    STOPS,
    ElementTable,
    Feature,
    PointStop,
    RecordedEffort,
    Stop,
    efforts_during,
)
from ...models.errors import SimulationError, UnsupportedProblemError
from ...models.mechanism import Mechanism
from ...models.mjcf.elements import RAIL_SIDES, Points, felt_from, rail_contact, torque_sensor
from ...models.mjcf.scene import HOME, scene
from ...models.mjcf.writer import FAR, MARGIN, mjcf, mjcf_names, model_file
from .compat import (
    CALLBACK,
    constraint_jacobian,
    has_polynomial_springs,
    loses_small_gains,
    mass_matrix,
    mujoco,
)
from .options import MujocoOptions, scaled_solref
from .reference_acceleration import ReferenceAccelerationCorrection


@dataclass(frozen=True)
class Limit:
    """A stop on angles as the limit of a joint or of a tendon.

    MuJoCo's constraints are soft: under a force f one gives way by R f / (k d), with its
    regularisation R, stiffness k and impedance d.
    """

    model: Any
    element: str
    """'jnt' or 'tendon', the prefix of the model's arrays."""
    index: int
    end: int
    """0 for the lower end of the range, 1 for the upper."""
    constraint: int
    """MuJoCo's type of its constraint rows."""
    range: tuple[float, float]
    """Range of the joint or tendon before anything was removed [rad]."""

    def remove(self) -> None:
        """Remove the limit from the model; the other end of the range stays."""
        self._set_end(FAR if self.end else -FAR)

    def restore(self) -> None:
        """Put the limit back into the model."""
        self._set_end(self.range[self.end])

    def _set_end(self, value: float) -> None:
        getattr(self.model, f"{self.element}_range")[self.index, self.end] = value

    def row(self, data: Any) -> int | None:
        """Its row among the constraints that are present; None if it is out of reach."""
        rows = np.flatnonzero((data.efc_type == self.constraint) & (data.efc_id == self.index))
        return int(rows[0]) if len(rows) else None

    def gap(self, data: Any) -> float:
        """Its gap as MuJoCo measures its joint or tendon [rad]; negative in penetration."""
        if self.element == "tendon":
            value = data.ten_length[self.index]
        else:
            value = data.qpos[self.model.jnt_qposadr[self.index]]
        return float((1 - 2 * self.end) * (value - self.range[self.end]))

    def activate(self, data: Any, correction: ReferenceAccelerationCorrection) -> None:
        """Let it act at its current gap, without preload: its margin is set just above the gap."""
        self._set_margin(self.gap(data) + MARGIN)

    def deactivate(self, correction: ReferenceAccelerationCorrection) -> None:
        """Let it act in penetration only: its margin is set to zero."""
        self._set_margin(0.0)

    def preload(
        self, data: Any, correction: ReferenceAccelerationCorrection, forces: FloatArray
    ) -> None:
        """Balance a pushing stop's softness by its margin: k d (margin - gap) = R f.

        Args:
            data, correction: of MuJoCo.
            forces: f of all constraint rows.
        """
        row = self.row(data)
        if row is not None and forces[row] > 0:
            stiffness, _, impedance, _ = data.efc_KBIP[row]
            penetration = data.efc_R[row] * forces[row] / (stiffness * impedance)
            self._set_margin(self.gap(data) + penetration)

    def _set_margin(self, margin: float) -> None:
        getattr(self.model, f"{self.element}_margin")[self.index] = margin

    def torque(self, sensed: FloatArray, positions: FloatArray) -> FloatArray:
        """Its torque [N m] from its sensor's values (n,) and the joints' positions (n, n_q).

        Where two stops are the ends of one range, the nearer one has the sensor's torque.
        """
        if self.element == "tendon":
            return sensed
        value = positions[:, int(self.model.jnt_qposadr[self.index])]
        this, other = self.range[self.end], self.range[1 - self.end]
        return np.where(np.abs(value - this) < np.abs(value - other), sensed, 0.0)


@dataclass(frozen=True)
class PointContact:
    """A frictionless contact of a sphere with a wall: a stop on a point, or a side of a slot."""

    model: Any
    index: int
    """Number of the pair of geoms."""
    geoms: tuple[int, int]
    """Wall and sphere in MuJoCo's order: a plane before the sphere, the sphere before a box."""
    margin: float
    """Margin of the pair before anything was removed [m]."""

    def remove(self) -> None:
        """Set the margin so low that the sphere never comes within it."""
        self.model.pair_margin[self.index] = -FAR

    def restore(self) -> None:
        """Set the margin back."""
        self.model.pair_margin[self.index] = self.margin

    def row(self, data: Any) -> int | None:
        """Its row among the constraints that are present; None if the sphere is out of reach."""
        contacts = np.flatnonzero((data.contact.geom == self.geoms).all(axis=1))
        row = int(data.contact.efc_address[contacts[0]]) if len(contacts) else -1
        return row if row >= 0 else None

    def gap(self, data: Any) -> float:
        """Distance of the sphere from the wall [m]."""
        types, sizes = self.model.geom_type, self.model.geom_size
        wall, sphere = sorted(
            self.geoms, key=lambda geom: types[geom] == mujoco.mjtGeom.mjGEOM_SPHERE
        )
        is_plane = types[wall] == mujoco.mjtGeom.mjGEOM_PLANE
        thickness = 0.0 if is_plane else sizes[wall, 2]
        normal = data.geom_xmat[wall].reshape(3, 3)[:, 2]
        distance = (data.geom_xpos[sphere] - data.geom_xpos[wall]) @ normal
        return float(distance - thickness - sizes[sphere, 0])

    def activate(self, data: Any, correction: ReferenceAccelerationCorrection) -> None:
        """Deactivate its margin, which is wide enough for it to act."""
        self.deactivate(correction)

    def deactivate(self, correction: ReferenceAccelerationCorrection) -> None:
        """Let its margin give no acceleration."""
        correction.contacts[self.geoms] = 0.0

    def preload(
        self, data: Any, correction: ReferenceAccelerationCorrection, forces: FloatArray
    ) -> None:
        """Preload by the correction: inner stages of a step may lift the sphere beyond a margin."""
        row = self.row(data)
        if row is not None and forces[row] > 0:
            correction.contacts[self.geoms] = float(data.efc_R[row] * forces[row])

    def torque(self, sensed: FloatArray, positions: FloatArray) -> FloatArray:
        """Its force [N], as the sensor gives it."""
        return sensed


UnilateralConstraint = Limit | PointContact
"""One constraint row that only pushes."""


def _limit(model: Any, names: Mapping[str, str], stop: Stop) -> Limit:
    types, sensor = mujoco.mjtConstraint, model.sensor(names[torque_sensor(stop.name)])
    element, constraint = "tendon", types.mjCNSTR_LIMIT_TENDON
    if int(sensor.type[0]) == mujoco.mjtSensor.mjSENS_JOINTLIMITFRC:
        element, constraint = "jnt", types.mjCNSTR_LIMIT_JOINT
    index, end = int(sensor.objid[0]), 0 if stop.sense > 0 else 1
    low, high = getattr(model, f"{element}_range")[index]
    return Limit(model, element, index, end, int(constraint), (float(low), float(high)))


def _contact(model: Any, name: str) -> PointContact:
    pair = model.pair(name)
    geoms = int(pair.geom1[0]), int(pair.geom2[0])
    first, second = sorted(geoms, key=lambda geom: model.geom_type[geom])
    return PointContact(model, int(pair.id), (first, second), float(pair.margin[0]))


_STOPS: ElementTable[Callable[[Any, Mapping[str, str], Any], UnilateralConstraint]] = ElementTable(
    "MuJoCo's model",
    STOPS,
    {Stop: _limit, PointStop: lambda model, names, stop: _contact(model, names[stop.name])},
)


def stop_constraints(mechanism: Mechanism, model: Any) -> dict[str, UnilateralConstraint]:
    """Limits or contacts, by the stop's name."""
    names = mjcf_names(mechanism)
    return {stop.name: _STOPS[stop](model, names, stop) for stop in mechanism.stops}


def _point_stops(mechanism: Mechanism, model: Any) -> list[PointContact]:
    names = mjcf_names(mechanism)
    return [_contact(model, names[stop.name]) for stop in mechanism.point_stops]


def slot_contacts(mechanism: Mechanism, model: Any) -> list[PointContact]:
    """Contacts of each slot that closes a loop, both."""
    names = mjcf_names(mechanism)
    return [
        _contact(model, names[rail_contact(slot.name, side)])
        for slot in Points(mechanism).slots
        for side in RAIL_SIDES
    ]


_PRELOAD_ITERATIONS = 6  # each gains the four digits of 1 - d, d the impedance
_MOST_ITERATIONS = 3000  # where forces of redundant constraints drift
# Of the largest eigenvalue: constraints more nearly dependent follow from each other.
_REDUNDANT = 1e-12
_PATIENCE = 10  # iterations without a smaller change: what is left is rounding
_SETTLED = 1e-10  # change of the constraints' forces in an iteration, of the largest


def compiled(mechanism: Mechanism, text: str) -> Any:
    """MuJoCo's model of a mechanism's MJCF.

    Raises:
        SimulationError: MuJoCo refuses the model.
        UnsupportedProblemError: this version of MuJoCo lacks an element.
    """
    for element in mechanism.force_elements:
        if element.feature is Feature.CUBIC_SPRING and not has_polynomial_springs():
            raise UnsupportedProblemError(
                f"mujoco cannot build {element.name!r}: this version's springs are linear; "
                f"a later one ({mujoco.__version__} is here) has cubic ones."
            )
    try:
        with CALLBACK:  # MuJoCo's compiler calls it as well, with a model that Python does not know
            return mujoco.MjModel.from_xml_string(text)
    except ValueError as error:
        raise SimulationError(f"MuJoCo refuses the model of {mechanism.name!r}: {error}") from error


def load(mechanism: Mechanism, options: MujocoOptions) -> Any:
    """The model of the mechanism's MJCF with the engine's options set on it.

    Raises:
        SimulationError: MuJoCo refuses the model.
        UnsupportedProblemError: the mechanism cannot be written as MJCF.
    """
    model = compiled(mechanism, mjcf(mechanism, options.timestep))
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
    for contact in _point_stops(mechanism, model):
        if options.moving_points or options.preload:  # the correction acts
            model.pair_margin[contact.index] = felt_from(mechanism, options.timestep)
        else:  # the MJCF's margin is the rounding error at the mechanism's size
            model.pair_margin[contact.index] *= options.margin / MARGIN
    return model


def correction_of(
    mechanism: Mechanism, model: Any, options: MujocoOptions
) -> ReferenceAccelerationCorrection:
    """The correction of contacts and equalities; with stock options it does nothing."""
    if not (options.moving_points or options.preload) or not (model.npair or model.neq):
        return ReferenceAccelerationCorrection(model, velocity_term=False)
    without_margin = {contact.geoms: 0.0 for contact in _point_stops(mechanism, model)}
    # The solver may lose its last digits in the cost of two walls pressed in.
    to_the_last_digit = options.solver == "Newton" and options.tolerance < np.finfo(float).eps
    between_walls = to_the_last_digit and bool(slot_contacts(mechanism, model))
    starts_at_the_solution = between_walls and loses_small_gains()
    return ReferenceAccelerationCorrection(
        model, options.moving_points, starts_at_the_solution, without_margin
    )


def recorded_actuators(mechanism: Mechanism, model: Any) -> dict[int, RecordedEffort]:
    """Records of efforts by the numbers of the actuators whose controls they are."""
    names = mjcf_names(mechanism)
    records = (e for e in mechanism.force_elements if isinstance(e, RecordedEffort))
    return {int(model.actuator(names[record.name]).id): record for record in records}


def controls_of(
    records: Mapping[int, RecordedEffort], model: Any, t: FloatArray, step: float
) -> FloatArray | None:
    """Controls of a model in steps [s] from times (n,) [s], shape (n, nu); None without records."""
    if not records:
        return None
    controls = np.zeros((len(t), int(model.nu)))
    controls[:, list(records)] = efforts_during(records.values(), t, step)
    return controls


def start_data(model: Any) -> Any:
    """The model's data at the start."""
    data = mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, data, model.key(HOME).id)
    return data


def preload(
    data: Any,
    closed: Iterable[UnilateralConstraint],
    correction: ReferenceAccelerationCorrection,
    settled: float = _SETTLED,
) -> None:
    """Preload the active constraints for their softness, so that they start in balance.

    A soft limit carries a torque f only at a penetration of R f / (k d): exactly at its limit it
    starts 1 - d too weak and takes some ten time constants to settle. A margin has the same effect
    as a penetration and leaves the start unchanged; contacts and equalities are given the
    acceleration R f instead.

    Args:
        data: MuJoCo's; the constraints' forces are left in it.
        closed: the active stops, and the sides of slots.
        correction: of the reference accelerations.
        settled: change of the constraints' forces in an iteration that is small, in parts of the
            largest.
    """
    active, accelerations = tuple(closed), None
    # Generalized forces are unique where constraints are redundant and their multipliers are not.
    before, least, since = np.full(len(data.qfrc_constraint), np.inf), np.inf, 0
    for done in range(_MOST_ITERATIONS + 1):
        with correction.applied():
            correction.forward(data)
        if done == _MOST_ITERATIONS:
            return
        forces = np.array(data.qfrc_constraint)
        change, before = float(np.abs(forces - before).max(initial=0.0)), forces
        least, since = (change, 0) if change < least else (least, since + 1)
        unsettled = change > settled * float(np.abs(forces).max(initial=0.0))
        if done >= _PRELOAD_ITERATIONS and not (unsettled and since < _PATIENCE):
            return
        rows = [row for constraint in active if (row := constraint.row(data)) is not None]
        rigid = _rigid_forces(correction.model, data, rows, accelerations)
        accelerations = data.efc_R * rigid
        for constraint in active:
            constraint.preload(data, correction, rigid)
        correction.preload_equalities(data, rigid)


def _rigid_forces(
    model: Any, data: Any, unilateral: list[int], given: FloatArray | None
) -> FloatArray:
    """Forces f of the rows if none was soft: A f = c instead of (A + R) f = c + e, with e `given`.

    The forces as they are stand for those that would come out otherwise, and where a row without
    force is among the unilateral ones: as next e they converge as well, by R / (A + R) an
    iteration, which is slow for a wall that is nearly parallel to the motion. Redundant directions
    are left out.
    """
    forces = np.array(data.efc_force)
    is_equality = data.efc_type == int(mujoco.mjtConstraint.mjCNSTR_EQUALITY)
    equalities = np.flatnonzero(is_equality).tolist()
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


def view(mechanism: Mechanism, timestep: float) -> None:
    """Open the viewer at the start of the motion, and return when it is closed.

    Args:
        mechanism: any that can be written as MJCF.
        timestep: of the simulation in the viewer [s].

    Raises:
        SimulationError: MuJoCo refuses the model, or cannot open a window.
        UnsupportedProblemError: the mechanism cannot be written as MJCF.
    """
    from mujoco import viewer

    try:
        with CALLBACK:
            name = model_file(mechanism)
            files = {name: mjcf(mechanism, timestep).encode()}
            model = mujoco.MjModel.from_xml_string(scene(mechanism, name), files)
        viewer.launch(model, start_data(model))
    except (ValueError, RuntimeError) as error:
        raise SimulationError(f"the viewer cannot show {mechanism.name!r}: {error}") from error
