r"""Variational equations: how accelerations and multipliers change with the state and the mechanism's data.

With r = dw/dq and z = a - i s u^2 (so that r z is the second time derivative of the phasors w, and H the matrix of
:mod:`..equations`) the KKT system reads

    Re(H z) + I a - Q = G^T lam,        Re(L (r z)) = 0  (loops),        G_gap a = 0  (closed stops).

Differentiated along a direction (dq, du, data), with dr = -i s dq r and dz = da - 2 i s u du,

    M da - G^T dlam = dQ - Re(dH z - 2 i H (s u du)) - dI a + dG^T lam
    G da            = -Re(dL (r z) + L (-i s dq r z - 2 i r s u du)),  0 for gaps, which are linear in q:

the same matrix, a new right-hand side per direction.

A *direction* maps names of a mechanism's numbers ("bodies.arm.mass", "start.0", "stops.hanger rest.limit") to their
derivatives with respect to one quantity; numbers it does not name do not change.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, cast

import numpy as np

from ...models.arrays import ComplexArray, FloatArray
from ...models.errors import InputError, UnsupportedProblemError
from ...models.features import refuse_features
from ...models.joints import SlotJoint
from ...models.kinematics import Kinematics
from ...models.mechanism import Mechanism
from ...models.spec import Spec
from ..equations import Equations, kkt_matrix
from ..reactions import refuse_dependent

Direction = Mapping[str, float]

_FITS = 1e-9  # how well a direction must move closed stops and loops along, per unit of the direction's own size


def numbers(mechanism: Mechanism) -> dict[str, float]:
    """Every number of a mechanism by name, its start speeds included where it rests."""
    return dict(_walk(_with_speeds(mechanism), ""))


def tangent_mechanism(mechanism: Mechanism, direction: Direction) -> Mechanism:
    """The mechanism with each number replaced by its derivative along the direction; it is not validated.

    Rows of points are sums of the joints' points and axes, hence linear in them: the row that `Kinematics` makes of
    this mechanism *is* the derivative of the row, and no formula has to be written twice.

    Raises:
        InputError: the direction names a number that the mechanism does not have.
    """
    known = numbers(mechanism)
    for name in direction:
        if name not in known:
            raise InputError(f"there is no number {name!r} in {mechanism.name!r}; there is {sorted(known)}.")
    return cast("Mechanism", _replaced(_with_speeds(mechanism), "", direction))


def _with_speeds(mechanism: Mechanism) -> Mechanism:
    speeds = mechanism.start_speeds or (0.0,) * len(mechanism.start)
    return mechanism.model_copy(update={"start_speeds": speeds})


def _parts(value: object) -> Iterator[tuple[str, Any]]:
    """Fields of a description by their names; items of a tuple by theirs, or by number."""
    if isinstance(value, Spec):
        for field in type(value).model_fields:
            yield field, getattr(value, field)
    elif isinstance(value, tuple):
        for i, item in enumerate(cast("tuple[object, ...]", value)):
            yield str(getattr(item, "name", i)), item


def _walk(value: object, path: str) -> Iterator[tuple[str, float]]:
    if isinstance(value, float):
        yield path, value
    for name, part in _parts(value):
        yield from _walk(part, f"{path}.{name}" if path else name)


def _replaced(value: object, path: str, direction: Direction) -> object:
    if isinstance(value, float):
        return float(direction.get(path, 0.0))
    parts = {name: _replaced(part, f"{path}.{name}" if path else name, direction) for name, part in _parts(value)}
    if isinstance(value, Spec):
        return value.model_copy(update=parts)
    return tuple(parts.values()) if isinstance(value, tuple) else value


@dataclass(frozen=True)
class DataTangent:
    """Derivatives of what the equations of motion are made of, one row per direction; symbols as in `Equations`."""

    products: ComplexArray
    """dK, shape (m, n_q, n_q)."""
    weights: ComplexArray
    """d of -i g C^H m, shape (m, n_q)."""
    inertias: FloatArray
    """dI, shape (m, n_q)."""
    loops: ComplexArray
    """d of the loop rows L, shape (m, n_loops, n_q)."""
    loop_offsets: ComplexArray
    """d of the loops' constant parts, shape (m, n_loops)."""

    @classmethod
    def along(cls, mechanism: Mechanism, tangents: list[Mechanism]) -> DataTangent:
        """By the product rule, from the tangent mechanisms."""
        n_q, n_l = len(mechanism.coordinates), len(Kinematics(mechanism).loop_closures)
        loops = np.array([_loop_tangents(mechanism, tangent) for tangent in tangents])
        loops = loops.reshape(len(tangents), n_l, n_q + 1)
        return cls(
            products=np.array([_product_tangent(mechanism, tangent) for tangent in tangents]),
            weights=np.array([_weight_tangent(mechanism, tangent) for tangent in tangents]),
            inertias=np.array([Kinematics(tangent).inertias for tangent in tangents]),
            loops=loops[..., :-1],
            loop_offsets=loops[..., -1],
        )

    @classmethod
    def none(cls, n_q: int, n_loops: int) -> DataTangent:
        """One direction in which the data do not change: along it states move by themselves, as in time."""
        zero = np.zeros((1, n_q, n_q), dtype=np.complex128)
        loops = np.zeros((1, n_loops, n_q), dtype=np.complex128)
        return cls(zero, zero[:, 0], np.zeros((1, n_q)), loops, loops[..., 0])


def _product_tangent(mechanism: Mechanism, tangent: Mechanism) -> ComplexArray:
    """D of K = C^H diag(m) C."""
    base, derivative = Kinematics(mechanism), Kinematics(tangent)
    mixed = (derivative.centres.conj().T * base.masses) @ base.centres
    return mixed + mixed.conj().T + (base.centres.conj().T * derivative.masses) @ base.centres


def _weight_tangent(mechanism: Mechanism, tangent: Mechanism) -> ComplexArray:
    """D of -i g C^H m."""
    base, derivative = Kinematics(mechanism), Kinematics(tangent)
    changed = derivative.centres.conj().T @ base.masses + base.centres.conj().T @ derivative.masses
    return -1j * (tangent.gravity * (base.centres.conj().T @ base.masses) + mechanism.gravity * changed)


def _loop_tangents(mechanism: Mechanism, tangent: Mechanism) -> ComplexArray:
    """D of each loop constraint's complex row, its constant part in the last column."""
    rows: list[ComplexArray] = []
    for joint, changed in zip(mechanism.loop_joints, tangent.loop_joints, strict=True):
        moved = _closure_coefficients(tangent, changed.name)
        if isinstance(joint, SlotJoint) and isinstance(changed, SlotJoint):
            # Distance from the slot's line: Re(conj(i axis) z); the axis itself may turn.
            turned = _closure_coefficients(mechanism, joint.name) * np.conj(1j * complex(*changed.axis))
            rows.append(moved * np.conj(1j * complex(*joint.axis)) + turned)
        else:
            rows += [moved, -1j * moved]
    return np.array(rows, dtype=np.complex128)


def _closure_coefficients(mechanism: Mechanism, name: str) -> ComplexArray:
    joint = next(joint for joint in mechanism.loop_joints if joint.name == name)
    kinematics = Kinematics(mechanism)
    parent = kinematics.point(joint.parent, joint.parent_point)
    child = kinematics.point(joint.child, joint.child_point)
    return np.append(child.coefficients - parent.coefficients, child.offset - parent.offset)


@dataclass(frozen=True)
class Tangent:
    """Accelerations and multipliers of one state, and their derivatives along m directions."""

    a: FloatArray
    """[rad/s^2 or m/s^2], shape (n_q,)."""
    multipliers: FloatArray
    """[N or N m], shape (n_loops + n_closed,)."""
    da: FloatArray
    """Shape (m, n_q)."""
    d_multipliers: FloatArray
    """Shape (m, n_loops + n_closed)."""


class VariationalEquations(Equations):
    """The equations of motion and their derivatives along directions of the mechanism's numbers.

    Raises:
        UnsupportedProblemError: there is a stop on a point, whose gap's derivatives are not written here, or some
            constraints follow from others.
    """

    def __init__(self, mechanism: Mechanism, directions: Sequence[Direction]) -> None:
        if mechanism.point_stops:
            names = ", ".join(stop.name for stop in mechanism.point_stops)
            raise UnsupportedProblemError(f"sensitivities are derived for stops on angles only, not for {names}.")
        refuse_features(mechanism, (), "the derivative of a motion")
        super().__init__(mechanism)
        closed = [stop.name for stop in mechanism.stops if stop.closed]
        refuse_dependent(self, np.array(mechanism.start), closed, "the derivative of a motion")
        self.tangents = [tangent_mechanism(mechanism, direction) for direction in directions]
        self._data = DataTangent.along(mechanism, self.tangents)

    @cached_property
    def _rows(self) -> ComplexArray:
        """Complex rows of the loop constraints, shape (n_loops, n_q)."""
        return np.zeros((0, len(self.mechanism.coordinates)), dtype=complex) if self._loops is None else self._loops

    @cached_property
    def _still(self) -> DataTangent:
        return DataTangent.none(len(self.mechanism.coordinates), self.n_loops)

    def start(self, q: FloatArray, u: FloatArray, closed: Sequence[str]) -> tuple[FloatArray, FloatArray]:
        """Derivatives of the start's q and u, each of shape (m, n_q).

        A change of a start speed is a kick before the start: the part that the closed stops and the joints of loops
        take up is gone at once (their impulses solve M du+ - G^T P = M du, G du+ + dG u = 0). A kick away from a stop
        that pushes ends the same way under the unilateral law with e = 0: the stop catches the body again after a time
        that shrinks with the kick, and to first order in it only impulses along the gaps have acted by then.

        Args:
            q, u: the start, shape (n_q,).
            closed: stops that are active from the start on.

        Raises:
            InputError: a direction would open or penetrate an active stop, or open a loop, at the start.
        """
        dq = np.array([tangent.start for tangent in self.tangents])
        du = np.array([tangent.start_speeds for tangent in self.tangents])
        self._refuse_misfits(q, dq, closed)
        jacobian, mass = self.constraint_jacobian(q, closed), self.mass_matrix(q)
        torn = self._loop_tangent(q, u.astype(np.complex128), dq, self._data)
        right = np.concatenate([du @ mass, -torn, np.zeros((len(du), len(closed)))], axis=1)
        after = np.asarray(np.linalg.solve(kkt_matrix(mass, jacobian), right.T).T, dtype=np.float64)
        return dq, after[:, : len(q)]

    def _refuse_misfits(self, q: FloatArray, dq: FloatArray, closed: Sequence[str]) -> None:
        for j, tangent in enumerate(self.tangents):
            positions = {stop.name: stop.position for stop in tangent.stops}
            gaps = [self.kinematics.gap_jacobian(name, q) @ dq[j] - positions[name] for name in closed]
            moved = self._data.loops[j] @ self.kinematics.phasors(q) + self._data.loop_offsets[j]
            loops = (moved + self._rows @ (self._rates(q) * dq[j])).real
            misfit = np.abs(np.concatenate([np.array(gaps), loops])).max(initial=0.0)
            if misfit > _FITS * max(1.0, float(np.abs(dq[j]).max())):
                raise InputError(
                    f"direction {j} moves the start off its closed stops {tuple(closed)} or loops by {misfit:.3g} per "
                    "unit; a motion is not differentiable there: move the stop's limit (or the joint) along."
                )

    def _loop_tangent(self, q: FloatArray, v: ComplexArray, dq: FloatArray, data: DataTangent) -> FloatArray:
        """D Re(L (r v)) at fixed v, shape (m, n_loops)."""
        moving = self._rates(q) * v
        return (data.loops @ moving + (-1j * self._angles * dq * moving) @ self._rows.T).real

    def tangent(self, q: FloatArray, u: FloatArray, dq: FloatArray, du: FloatArray, closed: Sequence[str]) -> Tangent:
        """Along the directions, for a state (n_q,) and its derivatives (m, n_q)."""
        return self._tangent(q, u, dq, du, closed, self._data)

    def in_time(self, q: FloatArray, u: FloatArray, closed: Sequence[str]) -> Tangent:
        """Time derivatives along the motion itself: one direction, (u, a) with the data as they are."""
        a = self.solve(q, u, closed)[0]
        return self._tangent(q, u, u[None], a[None], closed, self._still)

    def _tangent(
        self, q: FloatArray, u: FloatArray, dq: FloatArray, du: FloatArray, closed: Sequence[str], data: DataTangent
    ) -> Tangent:
        n_q, n_c, n_l = len(q), self.n_loops + len(closed), self.n_loops
        rates = self._rates(q)
        quadratic = self._quadratic(q, rates)
        weights = rates.conj() * self._weights
        spin = self._angles * u
        inverse = np.linalg.inv(kkt_matrix(quadratic.real + self._inertias, self.constraint_jacobian(q, closed)))
        right = np.zeros(n_q + n_c)
        right[:n_q] = weights.real - quadratic.imag @ (spin * u)
        right[n_q : n_q + n_l] = (1j * self._rows @ (rates * spin * u)).real
        solution = inverse @ right
        a, multipliers = solution[:n_q], solution[n_q:]

        z = a - 1j * spin * u
        turn, dz = 1j * self._angles * dq, -2j * spin * du
        changed = rates.conj() * (data.products @ (rates * z)) + turn * (quadratic @ z)  # dH z, and H dz below
        changed = changed + (dz - turn * z) @ quadratic.T
        pull = rates.conj() * data.weights + turn * weights
        d_right = np.zeros((len(dq), n_q + n_c))
        d_right[:, :n_q] = (pull - changed).real - data.inertias * a
        if n_l:
            loops = multipliers[:n_l]
            d_right[:, :n_q] += ((loops @ data.loops) * rates - turn * ((loops @ self._rows) * rates)).real
            moved = self._loop_tangent(q, z, dq, data) + ((dz * rates) @ self._rows.T).real
            d_right[:, n_q : n_q + n_l] = -moved
        d_solution = d_right @ inverse.T
        return Tangent(a, multipliers, d_solution[:, :n_q], d_solution[:, n_q:])
