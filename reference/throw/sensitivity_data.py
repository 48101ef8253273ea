"""The numbers of a mechanism by name, their tangents, and how the whipper's depend on its eleven parameters.

A *direction* maps names of a mechanism's numbers ("bodies.arm.mass", "start.0", "stops.hanger rest.limit") to their
derivatives with respect to one quantity; numbers it does not name do not change.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from typing import Any, cast

import numpy as np

from ...models.arrays import ComplexArray, FloatArray
from ...models.errors import InputError
from ...models.kinematics import Kinematics
from ...models.machines.parameters import TrebuchetParameters
from ...models.mechanism import Mechanism, SlotJoint
from ...models.spec import Spec

Direction = Mapping[str, float]

_STEP = 1e-200  # of the complex step: its square is far below the smallest float, so nothing is truncated
_SAME = 1e-14  # relative: the two formulas may round differently, by a few units in the last place


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
        n_q, n_l = len(mechanism.coordinates), len(_loop_tangents(mechanism, mechanism))
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
    here, there = Kinematics(mechanism), Kinematics(tangent)
    mixed = (there.centres.conj().T * here.masses) @ here.centres
    return mixed + mixed.conj().T + (here.centres.conj().T * there.masses) @ here.centres


def _weight_tangent(mechanism: Mechanism, tangent: Mechanism) -> ComplexArray:
    """D of -i g C^H m."""
    here, there = Kinematics(mechanism), Kinematics(tangent)
    changed = there.centres.conj().T @ here.masses + here.centres.conj().T @ there.masses
    return -1j * (tangent.gravity * (here.centres.conj().T @ here.masses) + mechanism.gravity * changed)


def _loop_tangents(mechanism: Mechanism, tangent: Mechanism) -> ComplexArray:
    """D of each loop constraint's complex row, its constant part in the last column."""
    rows: list[ComplexArray] = []
    for joint, changed in zip(mechanism.loop_joints, tangent.loop_joints, strict=True):
        moved = _apart(tangent, changed.name)
        if isinstance(joint, SlotJoint) and isinstance(changed, SlotJoint):
            # Distance from the slot's line: Re(conj(i axis) z); the axis itself may turn.
            turned = _apart(mechanism, joint.name) * np.conj(1j * complex(*changed.axis))
            rows.append(moved * np.conj(1j * complex(*joint.axis)) + turned)
        else:
            rows += [moved, -1j * moved]
    return np.array(rows, dtype=np.complex128)


def _apart(mechanism: Mechanism, name: str) -> ComplexArray:
    joint = next(joint for joint in mechanism.loop_joints if joint.name == name)
    kinematics = Kinematics(mechanism)
    parent = kinematics.point(joint.parent, joint.parent_point)
    child = kinematics.point(joint.child, joint.child_point)
    return np.append(child.coefficients - parent.coefficients, child.offset - parent.offset)


def whipper_numbers(p: Mapping[str, Any]) -> dict[str, Any]:
    """The numbers of the whipper that depend on its parameters, as `models/trebuchet.py` has them.

    Plain arithmetic, so that it can be followed by a complex step, which validated descriptions cannot. Checked
    against the machine itself on each use, and in the tests.

    Args:
        p: values of the fields of `TrebuchetParameters`, real or complex.
    """
    return {
        "bodies.arm.mass": p["m_a"],
        "bodies.arm.centre.0": (p["l1"] - p["l2"]) / 2,
        "bodies.arm.inertia": p["m_a"] * (p["l1"] + p["l2"]) ** 2 / 12,
        "bodies.sling.mass": p["m_b"],
        "bodies.sling.centre.0": p["r"],
        "bodies.hanger.mass": p["m_cw"],
        "bodies.hanger.centre.0": p["h"],
        "joints.sling pin.parent_point.0": p["l1"],
        "joints.hanger pin.parent_point.0": -p["l2"],
        "stops.hanger rest.limit": p["theta0"] - p["alpha0"],
        "stops.sling rest.limit": p["phi0"] - p["theta0"],
        "markers.projectile.point.0": p["r"],
        "markers.counterweight.point.0": p["h"],
        "markers.arm centre.point.0": (p["l1"] - p["l2"]) / 2,
        "gravity": p["g"],
        "start.0": p["theta0"],
        "start.1": p["phi0"],
        "start.2": p["alpha0"],
    }


def parameter_directions(
    build: Callable[[TrebuchetParameters], Mechanism], parameters: TrebuchetParameters
) -> dict[str, Direction]:
    """How the machine's numbers change with each field of the parameters: exact, by a complex step.

    f(p + i h) = f(p) + i h f'(p) + O(h^2) (Squire and Trapp, SIAM Review 40 (1998) 110-112): no difference is taken,
    so h can be so small that only rounding is left.

    Raises:
        InputError: `build` does not make a whipper, or makes its numbers otherwise than `models/trebuchet.py`.
    """
    values = {name: float(getattr(parameters, name)) for name in TrebuchetParameters.model_fields}
    _refuse_another_machine(build, parameters)
    directions: dict[str, Direction] = {}
    for name in values:
        stepped = whipper_numbers({k: complex(v, _STEP * (k == name)) for k, v in values.items()})
        directions[name] = {k: complex(v).imag / _STEP for k, v in stepped.items()}
    return directions


def _refuse_another_machine(build: Callable[[TrebuchetParameters], Mechanism], parameters: TrebuchetParameters) -> None:
    """Compare all numbers here and at a second set of parameters, which shows what depends on them."""
    values = {name: float(getattr(parameters, name)) for name in TrebuchetParameters.model_fields}
    other = {name: value * 1.01 + 0.001 * (i + 1) for i, (name, value) in enumerate(values.items())}
    first = numbers(build(parameters))
    second = numbers(build(parameters.model_copy(update=other)))
    for found, at in ((first, values), (second, other)):
        expected = first | whipper_numbers(at)
        for name in expected | found:
            a, b = found.get(name), expected.get(name)
            if a is None or b is None or abs(a - b) > _SAME * max(1.0, abs(a), abs(b)):
                raise InputError(
                    f"build makes {name} = {a!r} where the whipper trebuchet has {b!r}; sensitivities to its "
                    "parameters are known for the fixed and the rolling machine."
                )
