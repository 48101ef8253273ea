"""Trajectories as labelled datasets with units, and as NetCDF files that read back exactly."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import asdict
from pathlib import Path
from typing import cast

import numpy as np
import xarray as xr

from .arrays import FloatArray
from .errors import InputError
from .files import replacing
from .mechanism import Mechanism
from .trajectory import PointMotion, Provenance, Trajectory

FORMAT = "trebucheck-trajectory-1"
_AXES = ["x", "y"]


def to_dataset(trajectory: Trajectory) -> xr.Dataset:
    """Label every array with its dimensions, names and units; what the engine cannot observe is left out."""
    names = list(trajectory.mechanism.coordinates)
    data: dict[str, xr.DataArray] = {
        "q": _array(trajectory.q, ("time", "coordinate"), "generalized coordinates", "rad (slides: m)"),
        "u": _array(trajectory.u, ("time", "coordinate"), "generalized speeds", "rad/s (slides: m/s)"),
        "kinetic_energy": _array(trajectory.kinetic_energy, ("time",), "kinetic energy", "J"),
        "potential_energy": _array(trajectory.potential_energy, ("time",), "potential energy", "J"),
    }
    coords: dict[str, object] = {"time": trajectory.t, "coordinate": names, "axis": _AXES}
    positions = {name: motion.position for name, motion in trajectory.markers.items()}
    velocities = {name: motion.velocity for name, motion in trajectory.markers.items()}
    _add(data, coords, "marker", "position", positions, "position of the markers", "m")
    _add(data, coords, "marker", "velocity", velocities, "velocity of the markers", "m/s")
    torque_unit = "N m (stops on points: N)" if trajectory.mechanism.point_stops else "N m"
    _add(data, coords, "stop", "stop_torque", trajectory.stop_torques, "torque of the stops", torque_unit)
    _add(data, coords, "joint", "joint_reaction", trajectory.joint_reactions, "force on the joint's child", "N")
    _add(data, coords, "open_joint", "joint_gap", trajectory.joint_gaps, "distance of the joint's points", "m")
    released = [time if time is not None else np.nan for time in trajectory.release_times.values()]
    coords["releasable_stop"] = list(trajectory.release_times)
    label = "time of release (NaN: did not open)"
    data["release_time"] = _array(np.array(released), ("releasable_stop",), label, "s")
    dataset = xr.Dataset(data, coords=coords, attrs=_attributes(trajectory))
    dataset["time"].attrs = {"units": "s", "long_name": "time"}
    return dataset


def _array(values: FloatArray, dims: tuple[str, ...], label: str, units: str) -> xr.DataArray:
    return xr.DataArray(values, dims=dims, attrs={"long_name": label, "units": units})


def _add(
    data: dict[str, xr.DataArray],
    coords: dict[str, object],
    dim: str,
    name: str,
    values: Mapping[str, FloatArray],
    label: str,
    units: str,
) -> None:
    if not values:
        return
    stacked = np.stack(list(values.values()), axis=1)
    dims = ("time", dim, "axis") if stacked.ndim == 3 else ("time", dim)
    coords[dim] = list(values)
    data[name] = _array(stacked, dims, label, units)


def _attributes(trajectory: Trajectory) -> dict[str, str]:
    return {
        "format": FORMAT,
        "mechanism": trajectory.mechanism.model_dump_json(),
        "provenance": json.dumps(asdict(trajectory.provenance)),
        "impacts": json.dumps([[time, dict(impulses)] for time, impulses in trajectory.impacts]),
    }


def from_dataset(dataset: xr.Dataset) -> Trajectory:
    """The trajectory a dataset was made from.

    Raises:
        InputError: the dataset was not made by :func:`to_dataset`.
    """
    if dataset.attrs.get("format") != FORMAT:
        raise InputError(f"the dataset's format is {dataset.attrs.get('format')!r}; {FORMAT!r} is needed.")
    positions, velocities = _split(dataset, "position", "marker"), _split(dataset, "velocity", "marker")
    releases = _values(dataset, "release_time")
    names = [str(name) for name in dataset["releasable_stop"].values]
    return Trajectory(
        mechanism=Mechanism.from_json(dataset.attrs["mechanism"]),
        t=np.asarray(dataset["time"].values, dtype=np.float64),
        q=_values(dataset, "q"),
        u=_values(dataset, "u"),
        markers={name: PointMotion(positions[name], velocities[name]) for name in positions},
        kinetic_energy=_values(dataset, "kinetic_energy"),
        potential_energy=_values(dataset, "potential_energy"),
        stop_torques=_split(dataset, "stop_torque", "stop"),
        release_times={n: None if np.isnan(v) else float(v) for n, v in zip(names, releases, strict=True)},
        joint_reactions=_split(dataset, "joint_reaction", "joint"),
        provenance=Provenance(**json.loads(dataset.attrs["provenance"])),
        joint_gaps=_split(dataset, "joint_gap", "open_joint"),
        impacts=tuple((float(time), dict(impulses)) for time, impulses in json.loads(dataset.attrs["impacts"])),
    )


def _values(dataset: xr.Dataset, name: str) -> FloatArray:
    return np.asarray(dataset[name].values, dtype=np.float64)


def _split(dataset: xr.Dataset, name: str, dim: str) -> dict[str, FloatArray]:
    if name not in dataset:
        return {}
    values = _values(dataset, name)
    return {str(label): values[:, i] for i, label in enumerate(dataset[dim].values)}


def save(trajectory: Trajectory, path: str | Path) -> None:
    """Write NetCDF; the file appears whole or not at all.

    Raises:
        InputError: the folder cannot be written to.
    """
    with replacing(path) as temporary:
        to_dataset(trajectory).to_netcdf(temporary, engine="h5netcdf")


def load(path: str | Path) -> Trajectory:
    """Read a trajectory written by :func:`save`.

    Raises:
        InputError: the file cannot be read, or holds something else.
    """
    try:
        with xr.open_dataset(path, engine="h5netcdf") as dataset:
            return from_dataset(dataset.load())
    except InputError as error:
        raise InputError(f"{path}: {error}") from None
    except (OSError, KeyError, ValueError, TypeError) as error:
        raise InputError(f"{path} is not a trajectory file: {cast('object', error)}.") from None
