"""The result of every engine: a motion at its own times, as a dataset and as NetCDF."""

from __future__ import annotations

import io
import json
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, field
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple, TypeVar, cast

import numpy as np

from .arrays import FloatArray
from .errors import InputError
from .files import refuse_irregular, write_bytes
from .kinematics import Kinematics
from .launch import Launch, locate_launch, rest_opened
from .mechanism import Mechanism
from .shown import Playable, Reported, Shown, renderer

if TYPE_CHECKING:
    import pandas as pd
    import xarray as xr

FORMAT = "trebucheck-trajectory-1"

_T = TypeVar("_T")
_Variable = tuple[tuple[str, ...], Any, Mapping[str, str]]
"""Dimensions, values and attributes."""


class _Content(NamedTuple):
    """Variables and attributes of a file; every dimension has a coordinate."""

    coordinates: Mapping[str, _Variable]
    data: Mapping[str, _Variable]
    attributes: Mapping[str, str]


@dataclass(frozen=True)
class PointMotion:
    """A point's motion in the world."""

    position: FloatArray
    """[m], shape (n, 2)."""
    velocity: FloatArray
    """[m/s], shape (n, 2)."""


@dataclass(frozen=True)
class Provenance:
    """Origin and cost of a trajectory."""

    engine: str
    engine_version: str
    preset: str
    settings: Mapping[str, object]
    mechanism_hash: str
    duration: float
    stop_law: str
    steps: int
    wall_time: float
    """Time of the whole `simulate`: build, run and read-out [s]."""
    processor_time: float | None = None
    """Processor time of the same, all threads of the process together [s]; None: not measured."""
    reading_time: float | None = None
    """Part of it in which the adapter read the engine, not the engine's own work [s].

    None: the adapter does not tell it apart.
    """

    def known(self) -> dict[str, object]:
        """Fields by name, without what was not measured."""
        return {name: value for name, value in asdict(self).items() if value is not None}

    @property
    def cost(self) -> float | None:
        """Processor time without reading, as far as that is told apart [s]; None: not measured."""
        if self.processor_time is None:
            return None
        return self.processor_time - (self.reading_time or 0.0)


@dataclass(frozen=True, repr=False)
class Trajectory(Reported):
    """States, forces and energies at an engine's own sample times.

    What an engine cannot observe is absent from the mappings, never zeros; the methods then raise
    an error. Points, torques, reactions and energies come from the engine's own quantities, not
    from q by our formulas, wherever the engine has them.
    """

    mechanism: Mechanism
    t: FloatArray
    """[s], shape (n,), increasing from 0."""
    q: FloatArray
    """Generalized coordinates, shape (n, n_q), in `mechanism.coordinates`' order [rad or m]."""
    u: FloatArray
    """Generalized speeds dq/dt, shape (n, n_q)."""
    markers: Mapping[str, PointMotion]
    kinetic_energy: FloatArray
    """[J], shape (n,)."""
    potential_energy: FloatArray
    """[J], shape (n,), zero at the fulcrum's height at the start."""
    stop_torques: Mapping[str, FloatArray]
    """[N m, or N of a stop on a point], each of shape (n,), >= 0 while the stop pushes."""
    release_times: Mapping[str, float | None]
    """[s]; None for a stop that did not open (or was never closed)."""
    joint_reactions: Mapping[str, FloatArray]
    """Force on the child, world frame [N], each of shape (n, 2)."""
    provenance: Provenance
    joint_gaps: Mapping[str, FloatArray] = field(default_factory=dict[str, FloatArray])
    """Constraint drift: distance of a joint's points [m], shape (n,), where an engine has it."""
    impacts: tuple[tuple[float, Mapping[str, float]], ...] = ()
    """Time [s] and impulses by stop [N m s] of every impact; a soft stop has none."""

    def headline(self) -> str:
        """Engine, mechanism, samples and end."""
        run, name = self.provenance, self.mechanism.name
        samples = f"{len(self.t)} samples to {self.t[-1]:.6g} s"
        return f"Trajectory of {name!r} by {run.engine} {run.preset}: {samples}"

    def facts(self) -> Iterator[tuple[str, str]]:
        """Cost, releases and what was observed."""
        run = self.provenance
        yield "engine", f"{run.engine} {run.engine_version}, {run.steps} steps"
        yield "wall time", f"{run.wall_time:.3f} s"
        for name, time in self.release_times.items():
            if self.mechanism.stop(name).closed:
                yield f"{name} opens", "not" if time is None else f"{time:.9f} s"
        yield "markers", ", ".join(self.markers)
        yield "joint reactions", ", ".join(self.joint_reactions) or "not observed"

    _repr_html_ = Shown._repr_html_  # a table: the page of a run is for `write_html`

    def rows(self) -> Iterator[Mapping[str, object]]:
        """A sample a row, as :meth:`to_dataframe`."""
        yield from self.to_dataframe().reset_index().to_dict("records")

    def to_dataframe(self) -> pd.DataFrame:
        """Samples as a pandas data frame by time [s], in SI units.

        Columns are called 'q theta', 'projectile x', 'projectile vx', 'stop hanger rest', 'joint
        fulcrum x'.
        """
        import pandas as pd

        columns: dict[str, FloatArray] = {}
        for i, name in enumerate(self.mechanism.coordinates):
            columns |= {f"q {name}": self.q[:, i], f"u {name}": self.u[:, i]}
        for name, motion in self.markers.items():
            for i, axis in enumerate("xy"):
                columns[f"{name} {axis}"] = motion.position[:, i]
                columns[f"{name} v{axis}"] = motion.velocity[:, i]
        columns |= {f"stop {name}": values for name, values in self.stop_torques.items()}
        for name, force in self.joint_reactions.items():
            for i, axis in enumerate("xy"):
                columns[f"joint {name} {axis}"] = force[:, i]
        columns["kinetic energy"] = self.kinetic_energy
        columns["potential energy"] = self.potential_energy
        return pd.DataFrame(columns, index=pd.Index(self.t, name="t"))

    def marker(self, name: str) -> PointMotion:
        """Motion of a marker.

        Raises:
            InputError: there is no such marker.
        """
        return _named("marker", name, self.markers)

    def stop_torque(self, name: str) -> FloatArray:
        """Torque of a stop [N m], or force of one on a point [N], shape (n,).

        Raises:
            InputError: there is no such stop, or the engine cannot observe it.
        """
        return _named("stop torque", name, self.stop_torques)

    def release_time(self, name: str) -> float | None:
        """Time at which a stop opened [s]; None if it did not.

        Raises:
            InputError: there is no such stop.
        """
        return _named("release time", name, self.release_times)

    def joint_reaction(self, name: str) -> FloatArray:
        """Force on the joint's child, world frame [N], shape (n, 2).

        Raises:
            InputError: there is no such joint, or the engine cannot observe it.
        """
        return _named("joint reaction", name, self.joint_reactions)

    def stop_gap(self, name: str) -> FloatArray:
        """Gap of a stop [rad or m], shape (n,), from q; negative where it is penetrated."""
        return self.kinematics.gap(name, self.q)

    @cached_property
    def kinematics(self) -> Kinematics:
        """Point kinematics of the mechanism."""
        return Kinematics(self.mechanism)

    @property
    def total_energy(self) -> FloatArray:
        """[J], shape (n,)."""
        return self.kinetic_energy + self.potential_energy

    @property
    def momentum(self) -> FloatArray:
        """Linear momentum of all bodies [kg m/s], shape (n, 2), from q and u."""
        return self.kinematics.momentum(self.q, self.u)

    def to_dataset(self) -> xr.Dataset:
        """A labelled dataset with units; quantities that the engine cannot observe are left out."""
        import xarray as xr  # it takes a third of a second

        content = self._content()
        return xr.Dataset(content.data, coords=content.coordinates, attrs=content.attributes)

    def _content(self) -> _Content:
        """The same as arrays: variables by name, with their dimensions, values and attributes."""
        names = list(self.mechanism.coordinates)
        time = {"units": "s", "long_name": "time"}
        coordinates: dict[str, _Variable] = {"time": (("time",), self.t, time)}
        data: dict[str, _Variable] = {}

        def name(dim: str, values: Iterable[str]) -> None:
            coordinates[dim] = (dim,), np.array(list(values), dtype=np.str_), {}

        def put(name: str, values: FloatArray, dims: Sequence[str], label: str, unit: str) -> None:
            data[name] = tuple(dims), values, {"long_name": label, "units": unit}

        name("coordinate", names)
        name("axis", ("x", "y"))
        states = ("time", "coordinate")
        put("q", self.q, states, "generalized coordinates", "rad (slides: m)")
        put("u", self.u, states, "generalized speeds", "rad/s (slides: m/s)")
        put("kinetic_energy", self.kinetic_energy, ("time",), "kinetic energy", "J")
        put("potential_energy", self.potential_energy, ("time",), "potential energy", "J")
        positions = {name: motion.position for name, motion in self.markers.items()}
        velocities = {name: motion.velocity for name, motion in self.markers.items()}
        torque = "N m (stops on points: N)" if self.mechanism.point_stops else "N m"
        # Quantities of named parts: name, dimension, values by name, label and unit.
        parts: tuple[tuple[str, str, Mapping[str, FloatArray], str, str], ...] = (
            ("position", "marker", positions, "position of the markers", "m"),
            ("velocity", "marker", velocities, "velocity of the markers", "m/s"),
            ("stop_torque", "stop", self.stop_torques, "torque of the stops", torque),
            ("joint_reaction", "joint", self.joint_reactions, "force on the joint's child", "N"),
            ("joint_gap", "open_joint", self.joint_gaps, "distance of the joint's points", "m"),
        )
        for quantity, dim, values, label, unit in parts:
            if values:
                name(dim, values)
                stacked = np.stack(list(values.values()), axis=1)
                put(quantity, stacked, ("time", dim, "axis")[: stacked.ndim], label, unit)
        name("releasable_stop", self.release_times)
        released = [np.nan if time is None else time for time in self.release_times.values()]
        label = "time of release (NaN: did not open)"
        put("release_time", np.array(released), ("releasable_stop",), label, "s")
        attributes = {
            "format": FORMAT,
            "mechanism": self.mechanism.model_dump_json(),
            "provenance": json.dumps(self.provenance.known()),
            "impacts": json.dumps([[time, dict(impulses)] for time, impulses in self.impacts]),
        }
        return _Content(coordinates, data, attributes)

    def animate(self, *others: Trajectory) -> Playable:
        """The motion, to be played in a notebook and saved as GIF, MP4, SVG or page.

        Args:
            others: of the same mechanism; drawn over this one, with their deviations from it
                magnified.

        Raises:
            InputError: another one is of another mechanism.
        """
        return renderer().animation(self, others)

    def launch(self, angle: float | None = None, marker: str = "projectile") -> Launch | None:
        """First launch: the marker's velocity comes down to the launch angle; None without one.

        Args:
            angle: above the horizontal [rad]; 45 degrees if left out.
            marker: which point is thrown.
        """
        body = next(m.body for m in self.mechanism.markers if m.name == marker)
        opened = rest_opened(self.mechanism, body, self.release_times)
        if opened is None:
            return None
        motion = self.marker(marker)
        return locate_launch(self.t, motion.position, motion.velocity, angle, opened)


def _named(what: str, name: str, among: Mapping[str, _T]) -> _T:
    if name not in among:
        raise InputError(f"there is no {what} {name!r} here; there is {sorted(among) or 'none'}.")
    return among[name]


def from_dataset(dataset: xr.Dataset) -> Trajectory:
    """The trajectory a dataset was made from.

    Raises:
        InputError: the dataset was not made by :meth:`Trajectory.to_dataset`.
    """
    if dataset.attrs.get("format") != FORMAT:
        raise InputError(
            f"the dataset's format is {dataset.attrs.get('format')!r}; {FORMAT!r} is needed."
        )

    def values(name: str) -> FloatArray:
        return np.asarray(dataset[name].values, dtype=np.float64)

    def by_name(name: str, dim: str) -> dict[str, FloatArray]:
        if name not in dataset:
            return {}
        labels = [str(label) for label in dataset[dim].values]
        return {label: values(name)[:, i] for i, label in enumerate(labels)}

    positions, velocities = by_name("position", "marker"), by_name("velocity", "marker")
    releases: dict[str, float | None] = {}
    stops = dataset["releasable_stop"].values
    for name, time in zip(stops, values("release_time").tolist(), strict=True):
        releases[str(name)] = None if np.isnan(time) else time
    impacts = json.loads(dataset.attrs["impacts"])
    return Trajectory(
        mechanism=Mechanism.from_json(dataset.attrs["mechanism"]),
        t=values("time"),
        q=values("q"),
        u=values("u"),
        markers={name: PointMotion(positions[name], velocities[name]) for name in positions},
        kinetic_energy=values("kinetic_energy"),
        potential_energy=values("potential_energy"),
        stop_torques=by_name("stop_torque", "stop"),
        release_times=releases,
        joint_reactions=by_name("joint_reaction", "joint"),
        provenance=Provenance(**json.loads(dataset.attrs["provenance"])),
        joint_gaps=by_name("joint_gap", "open_joint"),
        impacts=tuple((float(time), dict(impulses)) for time, impulses in impacts),
    )


def save(trajectory: Trajectory, path: str | Path) -> None:
    """Write NetCDF; the file appears whole or not at all.

    Raises:
        UnwritableError: the folder cannot be written to, or has no room.
    """
    import h5py

    content = trajectory._content()  # pyright: ignore[reportPrivateUsage]
    # NetCDF-4 is HDF5 with dimension scales. Written so, not by xarray and h5netcdf, a file takes a
    # twelfth of the time: into memory first, as below.
    buffer = io.BytesIO()
    with h5py.File(buffer, "w") as file:
        file.attrs.update(content.attributes)
        scales = dict[str, Any]()
        for number, (name, (_, values, attributes)) in enumerate(content.coordinates.items()):
            words = values.dtype.kind == "U"
            kind = h5py.string_dtype() if words else values.dtype
            scale = file.create_dataset(
                name, data=values.astype(object) if words else values, dtype=kind
            )
            scale.make_scale(name)
            scale.attrs.update({"_Netcdf4Dimid": np.int32(number), **attributes})
            scales[name] = scale
        for name, (dims, values, attributes) in content.data.items():
            variable = file.create_dataset(name, data=values)
            variable.attrs.update(attributes)
            for axis, dim in zip(variable.dims, dims, strict=True):
                axis.attach_scale(scales[dim])
    write_bytes(path, buffer.getbuffer())


def write_dataset(dataset: xr.Dataset, path: str | Path, *, compressed: bool = False) -> None:
    """Write a dataset as NetCDF, as :func:`save` does.

    Args:
        compressed: without loss, in the file format of HDF5 1.10, which takes less room.

    Raises:
        UnwritableError: the folder cannot be written to, or has no room.
    """
    import h5netcdf
    from xarray.backends import H5NetCDFStore

    # Into memory first: where a disk is full, HDF5 ends the process.
    buffer = io.BytesIO()
    newer: dict[str, Any] = {"libver": ("v110", "v110")} if compressed else {}
    with h5netcdf.File(buffer, "w", **newer) as file:
        encoding: dict[str, Any] | None = None
        if compressed:
            encoding = {}
            for name, values in dataset.data_vars.items():
                if values.ndim and values.dtype.kind == "f":
                    encoding[str(name)] = {"zlib": True, "complevel": 9, "shuffle": True}
        dataset.dump_to_store(H5NetCDFStore(file), encoding=encoding)
    write_bytes(path, buffer.getbuffer())


def load(path: str | Path) -> Trajectory:
    """Read a trajectory written by :func:`save`.

    Raises:
        InputError: the file cannot be read, or holds something else.
    """
    import xarray as xr

    refuse_irregular(path)
    try:
        with xr.open_dataset(path, engine="h5netcdf") as dataset:
            return from_dataset(dataset.load())
    except InputError as error:
        raise InputError(f"{path}: {error}") from None
    except Exception as error:  # HDF5, h5netcdf and xarray raise any kind for a broken file
        raise InputError(f"{path} is not a trajectory file: {cast('object', error)}.") from None
