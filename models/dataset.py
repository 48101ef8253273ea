"""Trajectories from labelled datasets, and as NetCDF files that read back exactly."""

from __future__ import annotations

import json
from pathlib import Path
from typing import cast

import numpy as np
import xarray as xr

from .arrays import FloatArray
from .errors import InputError
from .files import replacing
from .mechanism import Mechanism
from .trajectory import FORMAT, PointMotion, Provenance, Trajectory


def from_dataset(dataset: xr.Dataset) -> Trajectory:
    """The trajectory a dataset was made from.

    Raises:
        InputError: the dataset was not made by :meth:`.trajectory.Trajectory.to_dataset`.
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
        trajectory.to_dataset().to_netcdf(temporary, engine="h5netcdf")


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
