"""Expected results of importing a model, as data: masses, accelerations, limits, certified motion.

All of it is in the coordinates of the file's joints.
"""

from __future__ import annotations

import io
import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Self

import numpy as np
from trebucheck.api.mechanics import Equations, FloatArray, Mechanism
from trebucheck.api.studies import size

from .zoo.model import TIME_CONSTANT, FileVariant, Needs, ZooModel

if TYPE_CHECKING:
    import xarray as xr

_SHARES = (0.0, 0.35, 0.8)  # of the time without events: where the three states are taken
_ROUNDED = 1e-9  # [s] by which a sample may miss an event


def with_joint_values(model: ZooModel, dataset: xr.Dataset) -> xr.Dataset:
    """A certified motion of a model's mechanism with what an importer is held to.

    Adds positions and speeds of the joints with their uncertainties, the generalized forces of
    limits and contacts on them (`constraint_force`), ranges, the total mass, and of three states
    mass matrix and accelerations. States of a mechanism with loops are at rest.
    """
    weights, equations = model.weights, Equations(model.mechanism)
    inverse = np.asarray(np.linalg.inv(weights), dtype=np.float64)
    added = dataset.assign_coords(file_joint=list(model.joint_names))
    q, u = (np.asarray(dataset[name].values, dtype=np.float64) for name in ("q", "u"))
    spread = abs(weights).T
    for name, values, bound in (
        (
            "position",
            q @ weights.T + model.zeros,
            np.asarray(dataset["q_uncertainty"].values) @ spread,
        ),
        ("velocity", u @ weights.T, np.asarray(dataset["u_uncertainty"].values) @ spread),
    ):
        added[f"joint_{name}"] = (
            ("time", "file_joint"),
            values,
            {"long_name": f"{name}s of the file's joints (SI)"},
        )
        added[f"joint_{name}_uncertainty"] = (
            ("time", "file_joint"),
            bound,
            {"long_name": f"bounds of the errors of {name}"},
        )
    added["constraint_force"] = (
        ("time", "file_joint"),
        _constraint_forces(equations, dataset, q) @ inverse,
        _FORCES,
    )
    low, high = np.array(
        [model.limits.get(joint, (-math.inf, math.inf)) for joint in model.joint_names]
    ).T
    added["range_low"], added["range_high"] = ("file_joint", low), ("file_joint", high)
    added["total_mass"] = ((), model.total_mass, {"units": "kg"})
    first, last = _free_interval(dataset)
    added["free_start"] = (
        (),
        first,
        {"units": "s", "long_name": "from here on no limit or contact acts"},
    )
    added["free_end"] = (
        (),
        last,
        {"units": "s", "long_name": "up to here no limit or contact acts"},
    )
    _add_states(added, model, equations, inverse, q, u)
    return added


_FORCES = {"long_name": "generalized forces of limits and contacts on the file's joints"}


def _constraint_forces(equations: Equations, dataset: xr.Dataset, q: FloatArray) -> FloatArray:
    """Generalized forces of the stops on the mechanism's coordinates, shape (n, n_q)."""
    forces = np.zeros_like(q)
    for stop in equations.mechanism.stops:
        pushes = np.asarray(dataset["stop_torque"].sel(stop=stop.name).values, dtype=np.float64)
        forces += pushes[:, None] * equations.kinematics.gap_jacobian(stop.name, q)
    return forces


def _free_interval(dataset: xr.Dataset) -> tuple[float, float]:
    """Samples between which no stop acts: after the last release, before the first impact [s]."""
    times = np.asarray(dataset["time"].values, dtype=np.float64)
    released = (
        np.asarray(dataset["release_time"].values) if "release_time" in dataset else np.array([])
    )
    struck = np.asarray(dataset["impact_time"].values) if "impact_time" in dataset else np.array([])
    first = max([0.0, *released[np.isfinite(released)]])
    last = min([float(times[-1]), *struck])
    inside = times[(times >= first - _ROUNDED) & (times <= last + _ROUNDED)]
    return float(inside[0]), float(inside[-1])


def _add_states(
    added: xr.Dataset,
    model: ZooModel,
    equations: Equations,
    inverse: FloatArray,
    q: FloatArray,
    u: FloatArray,
) -> None:
    times = np.asarray(added["time"].values)
    first, last = float(added["free_start"]), float(added["free_end"])
    chosen = [int(np.argmin(abs(times - (first + share * (last - first))))) for share in _SHARES]
    at, speeds = q[chosen], u[chosen] * (0.0 if model.mechanism.loop_joints else 1.0)
    accelerations = np.array(
        [equations.solve(a, b, ())[0] for a, b in zip(at, speeds, strict=True)]
    )
    added["state_position"] = (("state", "file_joint"), at @ model.weights.T + model.zeros)
    added["state_velocity"] = (("state", "file_joint"), speeds @ model.weights.T)
    added["mass_matrix"] = (
        ("state", "file_joint", "of_file_joint"),
        inverse.T @ equations.mass_matrix(at) @ inverse,
    )
    added["acceleration"] = (("state", "file_joint"), accelerations @ model.weights.T)


@dataclass(frozen=True)
class Motion:
    """A motion at equal intervals of time."""

    interval: float
    """[s]"""
    positions: FloatArray
    """Shape (n, n_joints) [rad or m]."""
    speeds: FloatArray
    uncertainty: FloatArray
    """Uncertainty of the positions, shape (n, n_joints)."""


@dataclass(frozen=True)
class Expected:
    """Expected results of a model."""

    name: str
    feature: str
    xml: str
    joints: tuple[str, ...]
    needs: tuple[Needs, ...]
    total_mass: float | None
    """[kg]; None where some of it is fixed to the ground, which a program may leave out."""
    limits: Mapping[str, tuple[float, float]]
    start: tuple[FloatArray, FloatArray] | None
    """Positions and speeds of the joints in the file's keyframe; None: not judged."""
    states: Sequence[tuple[FloatArray, FloatArray]]
    mass_matrices: FloatArray
    accelerations: FloatArray
    rounding: FloatArray
    """Change of accelerations by relative position errors of 1 through loops, shape (3, n)."""
    whole: Motion
    free: Motion
    """The part of it in which no limit or contact acts."""
    has_events: bool
    resting_force: FloatArray
    """Generalized forces of limits and contacts on the joints at the end; zero where none acts."""
    pressing: float
    """Acceleration that presses a touched limit at the end [rad/s^2 or m/s^2]; else 0."""
    variants: Mapping[str, FileVariant]
    """Other files of the same motion."""
    path: Path | None = None
    """Path of a file of one's own, which may name others beside it."""

    @classmethod
    def of(cls, model: ZooModel, data: xr.Dataset) -> Self:
        """Read the model and its data as :func:`with_joint_values` gives them."""
        whole = _motion(data)
        events = len(whole.positions) != int(_free(data).sum())
        force = np.asarray(data["constraint_force"].values[-1], dtype=np.float64)
        masses = np.asarray(data["mass_matrix"].values, dtype=np.float64)
        states = [*zip(data["state_position"].values, data["state_velocity"].values, strict=True)]
        return cls(
            model.name,
            model.feature,
            model.xml,
            model.joint_names,
            model.needs,
            model.total_mass,
            model.limits,
            start=(whole.positions[0], whole.speeds[0]),
            states=states,
            mass_matrices=masses,
            accelerations=np.asarray(data["acceleration"].values, dtype=np.float64),
            rounding=np.array(
                [rounding(model.mechanism, model.weights, q - model.zeros) for q, _ in states]
            ),
            whole=whole,
            free=_motion(data.isel(time=_free(data))),
            has_events=events,
            resting_force=force,
            pressing=float(abs(np.linalg.solve(masses[-1], force)).max()),
            variants=model.variants,
        )

    def of_variants(self) -> Iterator[tuple[str, Expected]]:
        """The same of each variant, with its name."""
        for name, variant in self.variants.items():
            yield name, replace(self, xml=variant.text, total_mass=variant.total_mass)


def rounding(mechanism: Mechanism, weights: FloatArray, joints: FloatArray) -> FloatArray:
    """Change of the joints' accelerations by relative position errors of 1, in loops of the file.

    Args:
        mechanism: of the file.
        weights: W in joint values = W q + zeros, shape (n_q, n_q).
        joints: values of the joints less those zeros, shape (n_q,).

    The file closes one that is open by r with the acceleration r / T^2. Joint positions that are
    off by d open it by |J| d, points of both its bodies, as large as the machine, by their own
    errors.
    """
    if not mechanism.loop_joints:
        return np.zeros_like(joints)
    equations = Equations(mechanism)
    q = np.asarray(np.linalg.solve(weights, joints), dtype=np.float64)
    jacobian = equations.constraint_jacobian(q, ())
    moved = np.linalg.solve(equations.mass_matrix(q), jacobian.T)
    closing = abs(weights @ moved @ np.linalg.pinv(jacobian @ moved))
    opened = abs(jacobian) @ np.maximum(1.0, abs(q)) + 2 * max(1.0, size(mechanism))
    return closing @ opened / TIME_CONSTANT**2


def _free(data: xr.Dataset) -> np.ndarray[tuple[int], np.dtype[np.bool_]]:
    times = np.asarray(data["time"].values)
    return (times >= float(data["free_start"]) - _ROUNDED) & (
        times <= float(data["free_end"]) + _ROUNDED
    )


def _motion(data: xr.Dataset) -> Motion:
    times = np.asarray(data["time"].values, dtype=np.float64)
    values = (
        np.asarray(data[name].values, dtype=np.float64)
        for name in ("joint_position", "joint_velocity", "joint_position_uncertainty")
    )
    return Motion(float(times[-1] - times[0]) / (len(times) - 1), *values)


def read_dataset(content: bytes) -> xr.Dataset:
    """A NetCDF file's content, in memory."""
    import xarray as xr

    with xr.open_dataset(io.BytesIO(content), engine="h5netcdf") as dataset:
        return dataset.load()
