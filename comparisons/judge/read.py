"""Motions in files: CSV with a heading of names and units, or NetCDF; and the impacts in them."""

from __future__ import annotations

import csv
import hashlib
import json
import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from difflib import get_close_matches
from functools import partial
from io import BytesIO
from pathlib import Path
from typing import Any, cast

import numpy as np

from ...models.arrays import FloatArray
from ...models.errors import InputError
from ...models.files import read_bytes
from ...models.kinematics import Kinematics
from ...models.mechanism import AnyStop, Mechanism
from ...models.trajectory import Trajectory
from ...reference.solution import Solution
from ..runs.metrics import against, not_observed
from ..runs.results import Metric

SPEED, IMPULSE = "impact_speed", "impact_impulse"
_COUNTED = 10  # of a stop: as many as have their times judged
_SAME = 1e-9  # of the duration: how far a sample may be from an impact that it belongs to
_MET = 1e-2  # of an angle, or of the longest arm: gap of a stop that is met
_JUMP = 1e-9  # of the largest speed


@dataclass(frozen=True)
class GivenImpact:
    """One, as a file gives it."""

    stop: str
    time: float
    """[s]."""
    impulse: float = math.nan
    """[N m s or N s]; NaN: not given."""


def merged(impacts: Sequence[GivenImpact]) -> tuple[tuple[float, dict[str, float]], ...]:
    """Impacts as a trajectory has them; an impulse that is not given counts as one that pushes."""
    found: dict[float, dict[str, float]] = {}
    for impact in sorted(impacts, key=lambda impact: impact.time):
        found.setdefault(impact.time, {})[impact.stop] = (
            1.0 if math.isnan(impact.impulse) else impact.impulse
        )
    return tuple(found.items())


def jumps(
    t: FloatArray, q: FloatArray, u: FloatArray, kinematics: Kinematics, arm: float
) -> list[GivenImpact]:
    """Find the impacts that speeds show: two samples at one time, between which the speed jumps up.

    Args:
        t: times [s], shape (n,).
        q, u: states, shape (n, n_q).
        kinematics: of the mechanism.
        arm: its longest [m].
    """
    found: list[GivenImpact] = []
    for k in np.flatnonzero(np.diff(t) == 0):
        for stop in kinematics.mechanism.stops:
            rates = u[k : k + 2] @ kinematics.gap_jacobian(stop.name, q[k])
            met = abs(float(kinematics.gap(stop.name, q[k]))) <= _MET * (
                1.0 if stop.gap_unit == "rad" else arm
            )
            least = _JUMP * float(np.abs(rates).max())
            if met and rates[0] < -least and rates[1] > rates[0] + least:
                found.append(GivenImpact(stop.name, float(t[k])))
    return found


def metrics(
    given: Trajectory, impacts: Sequence[GivenImpact], solution: Solution, end: float
) -> Iterator[Metric]:
    """Measure impulses of each stop, and speeds beside impacts of coordinates and markers.

    Args:
        given: the file's motion, with its impacts.
        impacts: as the file gives them.
        solution: the reference.
        end: of what is judged [s].
    """
    pairs = list(_pairs(given, solution, end))
    if pairs:
        yield from _impulses(pairs, impacts, solution)
        yield from _speeds(given, [(own, other) for _, own, other in pairs], solution)


def _pairs(given: Trajectory, solution: Solution, end: float) -> Iterator[tuple[str, float, float]]:
    """Stop, time in the file and time in the reference of impacts that both have."""
    comparison = against(given, solution, end)
    for stop in given.mechanism.stops:
        for own, other in comparison.impact_pairs(stop.name)[:_COUNTED]:
            if own is not None and other is not None and max(own, other) <= end:
                yield stop.name, own, other


def _impulses(
    pairs: Sequence[tuple[str, float, float]], impacts: Sequence[GivenImpact], solution: Solution
) -> Iterator[Metric]:
    given = {(impact.stop, impact.time): impact.impulse for impact in impacts}
    expected = {
        (name, time): value
        for time, impulses in solution.impacts
        for name, value in impulses.items()
    }
    for stop in dict.fromkeys(name for name, _, _ in pairs):
        unit = "N m s" if solution.problem.mechanism.stop(stop).effort == "torque" else "N s"
        errors = [
            given[stop, own] - expected[stop, other] for name, own, other in pairs if name == stop
        ]
        if stop in solution.undetermined_stops or np.isnan(errors).any():
            why = (
                "it is not unique"
                if stop in solution.undetermined_stops
                else "the file does not give it"
            )
            yield not_observed(IMPULSE, stop, unit, why)
        else:
            yield Metric(name=IMPULSE, subject=stop, value=float(np.abs(errors).max()), unit=unit)


def _speeds(
    given: Trajectory, pairs: Sequence[tuple[float, float]], solution: Solution
) -> Iterator[Metric]:
    """Average both of the file's samples at an impact, given the reference's speeds at its own."""
    mechanism, kinematics = given.mechanism, Kinematics(given.mechanism)
    errors: dict[tuple[str, str], list[float]] = {}
    for own, other in pairs:
        near = np.flatnonzero(np.abs(given.t - own) <= _SAME * given.t[-1])
        if len(near) < 2:
            continue
        for k, (q, u) in zip((near[0], near[-1]), _beside(solution, other), strict=True):
            for name, error in zip(mechanism.coordinates, np.abs(given.u[k] - u), strict=True):
                errors.setdefault(
                    (name, "rad/s" if name in mechanism.angles else "m/s"), []
                ).append(float(error))
            for marker in mechanism.markers:
                speed = kinematics.velocity(kinematics.point(marker.body, marker.point), q, u)
                apart = float(np.linalg.norm(given.marker(marker.name).velocity[k] - speed))
                errors.setdefault((marker.name, "m/s"), []).append(apart)
    for (subject, unit), found in errors.items():
        yield Metric(name=SPEED, subject=subject, value=max(found), unit=unit)


def _beside(solution: Solution, time: float) -> Iterator[tuple[FloatArray, FloatArray]]:
    """States of the reference before and after its impact."""
    n = len(solution.problem.mechanism.coordinates)
    before = next(segment for segment in solution.segments if segment.end >= time)
    after = solution.motion(np.array([time]))
    y = np.asarray(before.interpolant(time))
    yield y[:n], y[n:]
    yield after.q[0], after.u[0]


_ANGLE = {"rad": 1.0, "deg": math.pi / 180}
_LENGTH = {"m": 1.0, "cm": 1e-2, "mm": 1e-3, "km": 1e3}
_TIME = {"s": 1.0, "ms": 1e-3}
_FORCE = {"N": 1.0, "kN": 1e3}
_TORQUE = {"N m": 1.0, "kN m": 1e3}
_ENERGY = {"J": 1.0, "kJ": 1e3}
TIME = "t"


def _rates(units: Mapping[str, float]) -> dict[str, float]:
    return {f"{unit}/s": value for unit, value in units.items()}


@dataclass(frozen=True)
class ColumnKind:
    """A column that a file may have."""

    name: str
    units: Mapping[str, float]
    """SI value of each unit it may be in."""

    def factor(self, unit: str) -> float:
        """SI value of a unit.

        Raises:
            InputError: it is not one of its units.
        """
        if unit not in self.units:
            given = f"the unit [{unit[:30]}]" if unit else "no unit"
            raise InputError(
                f"column {self.name!r} has {given}; there are: "
                f"{', '.join(f'[{u}]' for u in self.units)}"
            )
        return self.units[unit]


def columns_of(mechanism: Mechanism) -> dict[str, ColumnKind]:
    """List every column a file on a mechanism may have, as in a trajectory's data frame."""
    kinds = [
        ColumnKind(TIME, _TIME),
        ColumnKind("kinetic energy", _ENERGY),
        ColumnKind("potential energy", _ENERGY),
    ]
    for name in mechanism.coordinates:
        units = _ANGLE if name in mechanism.angles else _LENGTH
        kinds += [ColumnKind(f"q {name}", units), ColumnKind(f"u {name}", _rates(units))]
    for marker in mechanism.markers:
        for axis in "xy":
            kinds += [
                ColumnKind(f"{marker.name} {axis}", _LENGTH),
                ColumnKind(f"{marker.name} v{axis}", _rates(_LENGTH)),
            ]
    for stop in mechanism.stops:
        kinds.append(
            ColumnKind(f"stop {stop.name}", _TORQUE if stop.effort == "torque" else _FORCE)
        )
    for joint in mechanism.joints:
        kinds += [
            ColumnKind(f"joint {joint.name} {axis}", _FORCE)
            for axis in "xy"
            if joint.held_directions
        ]
    return {kind.name: kind for kind in kinds}


def split_heading(heading: str) -> tuple[str, str]:
    """Name and unit of 'q theta [rad]'; without brackets no unit."""
    name, bracket, rest = heading.strip().partition("[")
    return " ".join(name.split()), rest.partition("]")[0].strip() if bracket else ""


def known(name: str, columns: Mapping[str, ColumnKind]) -> ColumnKind:
    """The column of that name.

    Raises:
        InputError: there is none; the sentence lists those there are.
    """
    if name in columns:
        return columns[name]
    close = get_close_matches(name, columns, n=1)
    hint = f" (did you mean {close[0]!r}?)" if close else ""
    raise InputError(f"there is no column {name[:60]!r}{hint}; there are: {', '.join(columns)}")


_LARGEST = 500_000_000  # [B]
_SIZE = 1e100  # in SI units: its square is still a number


@dataclass(frozen=True)
class GivenMotion:
    """Content of a file of a motion, in SI units."""

    values: Mapping[str, FloatArray]
    """Values by column, each of shape (n,), `t` among them."""
    releases: Mapping[str, float | None]
    """Releases of the stops that give one [s]; None: it does not open."""
    impacts: tuple[GivenImpact, ...]
    """Impacts that the file states in comments."""
    sha256: str
    """Digest of the file."""

    @property
    def t(self) -> FloatArray:
        """Times [s], shape (n,)."""
        return self.values[TIME]


def read(path: Path, mechanism: Mechanism) -> GivenMotion:
    """Read a .csv, or a .nc as NetCDF.

    Raises:
        InputError: it cannot be read, or is not a motion of the mechanism; the sentence has the
            line of a CSV file.
    """
    content = read_bytes(path, _LARGEST)
    reader = _netcdf if path.suffix.lower() in (".nc", ".nc4", ".h5") else _csv
    try:
        values, releases, impacts = reader(content, mechanism)
        _refuse_halves(values, mechanism)
    except InputError as error:
        raise InputError(f"{path}: {str(error).removesuffix('.')}.") from None
    return GivenMotion(values, releases, tuple(impacts), hashlib.sha256(content).hexdigest())


_Read = tuple[dict[str, FloatArray], dict[str, float | None], list[GivenImpact]]


def _csv(content: bytes, mechanism: Mechanism) -> _Read:
    try:
        lines = content.decode("utf-8-sig").splitlines()
    except UnicodeDecodeError as error:
        line = content.count(b"\n", 0, error.start) + 1
        raise InputError(f"line {line} is not UTF-8 text") from None
    columns, releases, impacts = (
        columns_of(mechanism),
        dict[str, float | None](),
        list[GivenImpact](),
    )
    body: list[tuple[int, list[str]]] = []
    for number, line in enumerate(lines, 1):
        if line.lstrip().startswith("#"):
            releases |= _at(number, lambda line=line: _release(line, mechanism))
            impacts += _at(number, lambda line=line: _impact(line, mechanism))
        elif line.strip():
            body.append(
                (number, _at(number, lambda line=line: next(csv.reader([line], strict=True))))
            )
    if not body:
        raise InputError("it is empty; a line of headings such as 't [s],q theta [rad]' is needed")
    first, heading = body[0]
    found = _at(first, lambda: _headings(heading, columns))
    return _table(found, body[1:], first), releases, impacts


def _at(line: int, make: Any) -> Any:
    """Result of reading a line; its errors with the line's number."""
    try:
        return make()
    except (InputError, csv.Error) as error:
        raise InputError(f"line {line}: {error}") from None


def _release(line: str, mechanism: Mechanism) -> dict[str, float | None]:
    """From '# release hanger rest [s] = 0.81'; any other comment says nothing."""
    text, equals, value = line.strip().lstrip("# ").partition("=")
    if not (equals and text.startswith("release ")):
        return {}
    name, unit = split_heading(text.removeprefix("release "))
    _stop(name, mechanism)
    return {name: None if value.strip() == "never" else _time(f"release {name}", unit, value)}


def _time(what: str, unit: str, value: str) -> float:
    """Time of an event [s]."""
    at = ColumnKind(what, _TIME).factor(unit) * _number(value, what)
    if at < 0:
        raise InputError(f"{what} is {at:.6g} s; a time from 0 on is needed")
    return at


def _stop(name: str, mechanism: Mechanism) -> AnyStop:
    for stop in mechanism.stops:
        if stop.name == name:
            return stop
    stops = ", ".join(stop.name for stop in mechanism.stops) or "none"
    raise InputError(f"there is no stop {name[:60]!r}; there are: {stops}")


def _impact(line: str, mechanism: Mechanism) -> list[GivenImpact]:
    """From '# impact floor [s] = 0.45', or '# impact floor [s] = 0.45, impulse [N s] = 13.3'."""
    text, equals, value = line.strip().lstrip("# ").partition("=")
    if not (equals and text.startswith("impact ")):
        return []
    name, unit = split_heading(text.removeprefix("impact "))
    stop = _stop(name, mechanism)
    time, _, rest = value.partition(",")
    at = _time(f"impact {name}", unit, time)
    if not rest.strip():
        return [GivenImpact(name, at)]
    told, _, size = rest.partition("=")
    what, unit = split_heading(told)
    if what != "impulse":
        raise InputError(
            f"{rest.strip()[:40]!r} follows the time of an impact; 'impulse [N s] = 1.0' is "
            f"understood"
        )
    return [GivenImpact(name, at, _impulse_of(stop).factor(unit) * _number(size, "impulse"))]


def _impulse_of(stop: AnyStop) -> ColumnKind:
    return ColumnKind("impulse", {"N m s": 1.0} if stop.effort == "torque" else {"N s": 1.0})


def _headings(cells: list[str], columns: Mapping[str, ColumnKind]) -> list[tuple[str, float]]:
    """Name and SI value of the unit of each column."""
    if len(cells) == 1 and (mark := next((mark for mark in ";\t" if mark in cells[0]), "")):
        raise InputError(
            f"columns are separated by {mark!r}; commas are needed, and points in numbers"
        )
    found: list[tuple[str, float]] = []
    for cell in cells:
        name, unit = split_heading(cell)
        short = f"q {name}"
        kind = known(short if name not in columns and short in columns else name, columns)
        if kind.name in (other for other, _ in found):
            raise InputError(f"column {kind.name!r} is there twice")
        found.append((kind.name, kind.factor(unit)))
    if TIME not in dict(found):
        raise InputError("there is no column 't [s]'")
    return found


def _table(
    found: list[tuple[str, float]], rows: list[tuple[int, list[str]]], heading: int
) -> dict[str, FloatArray]:
    if len(rows) < 2:
        raise InputError(
            f"line {heading}: {len(rows)} lines of numbers follow; at least two are needed"
        )
    values = np.empty((len(rows), len(found)))
    for k, (number, cells) in enumerate(rows):
        if len(cells) != len(found):
            raise InputError(
                f"line {number} has {len(cells)} values; the headings are {len(found)}"
            )
        values[k] = _at(number, partial(_numbers, cells, found))
    values *= [factor for _, factor in found]
    table = {name: values[:, i].copy() for i, (name, _) in enumerate(found)}
    _refuse_times(table[TIME], [f"line {number}" for number, _ in rows])
    return table


def _numbers(cells: list[str], found: list[tuple[str, float]]) -> list[float]:
    return [_number(cell, name) for cell, (name, _) in zip(cells, found, strict=True)]


def _number(text: str, name: str) -> float:
    try:
        value = float(text)
    except ValueError:
        raise InputError(f"{name} is {text.strip()[:30]!r}, which is no number") from None
    if not abs(value) <= _SIZE:
        raise InputError(f"{name} is {text.strip()[:30]}; a finite number is needed")
    return value


def _refuse_times(t: FloatArray, where: list[str]) -> None:
    if t[0] != 0.0:
        raise InputError(f"{where[0]}: t begins at {t[0]:.6g} s instead of 0")
    late = np.flatnonzero(np.diff(t) < 0)
    if len(late):
        k = int(late[0]) + 1
        raise InputError(f"{where[k]}: t decreases from {t[k - 1]:.9g} s to {t[k]:.9g} s")
    if t[-1] == 0.0:
        raise InputError(f"{where[-1]}: t is 0 to the end")


def _refuse_halves(values: Mapping[str, FloatArray], mechanism: Mechanism) -> None:
    """Vectors with one component, states that are not whole, and files without any position."""
    pairs = [(f"{m.name} {v}x", f"{m.name} {v}y") for m in mechanism.markers for v in ("", "v")]
    pairs += [(f"joint {joint.name} x", f"joint {joint.name} y") for joint in mechanism.joints]
    wholes = [[f"{kind} {name}" for name in mechanism.coordinates] for kind in "qu"]
    for whole in (*pairs, *wholes):
        there = [name for name in whole if name in values]
        if there and len(there) < len(whole):
            lacking = next(name for name in whole if name not in values)
            raise InputError(f"column {there[0]!r} is there without {lacking!r}")
    place, speed = wholes[0][0], wholes[1][0]
    if not any(
        name in values
        for name in (place, *(first for first, _ in pairs[: 2 * len(mechanism.markers)]))
    ):
        raise InputError(
            "it gives neither the coordinates nor the position of a marker: there is nothing to "
            "judge"
        )
    if speed in values and place not in values:
        # Without them energies and points would be those of the reference's coordinates.
        raise InputError(f"column {speed!r} is there without {place!r}")


_VARIABLES = {
    "q": ("coordinate", "q {}"),
    "u": ("coordinate", "u {}"),
    "position": ("marker", "{} {axis}"),
    "velocity": ("marker", "{} v{axis}"),
    "stop_torque": ("stop", "stop {}"),
    "joint_reaction": ("joint", "joint {} {axis}"),
    "kinetic_energy": ("", "kinetic energy"),
    "potential_energy": ("", "potential energy"),
}
"""Variables of a NetCDF file: the dimension of their names, and the column that each is."""


def _netcdf(content: bytes, mechanism: Mechanism) -> _Read:
    import xarray as xr

    try:
        with xr.open_dataset(BytesIO(content), engine="h5netcdf", decode_times=False) as file:
            dataset = file.load()
        t = np.asarray(dataset["time"].values, dtype=np.float64)
    except (
        Exception
    ) as error:  # of a broken file HDF5, h5netcdf and xarray raise errors of any kind
        raise InputError(
            f"it is no NetCDF file with a variable 'time': {cast('object', error)}"
        ) from None
    if t.ndim != 1 or len(t) < 2 or not np.isfinite(t).all():
        raise InputError("its times are not two or more finite numbers")
    _refuse_times(t, [f"sample {k}" for k in range(len(t))])
    columns = columns_of(mechanism)
    values = {TIME: t * _factor("time", dataset, columns[TIME])}
    for name, column, series in _series(dataset):
        if column not in columns:
            raise InputError(f"variable {name!r}: {_unknown(column, columns)}")
        if series.shape != t.shape or not (np.abs(series) <= _SIZE).all():
            raise InputError(
                f"variable {name!r}: {column!r} does not have one finite number a time"
            )
        values[column] = series * _factor(name, dataset, columns[column])
    return values, _releases(dataset, mechanism), _impacts(dataset, mechanism)


def _factor(variable: str, dataset: Any, kind: ColumnKind) -> float:
    """SI value of the unit that a variable states for a column.

    Units of several kinds are as `Trajectory.to_dataset` writes them, 'rad (slides: m)': the unit
    is the first that the column can have.

    Raises:
        InputError: the variable states no unit that the column can have.
    """
    stated = str(dataset[variable].attrs.get("units", ""))
    first, _, others = stated.partition("(")
    units = [first.strip(), others.partition(":")[2].strip(" )")]
    unit = next((unit for unit in units if unit in kind.units), stated)
    try:
        return kind.factor(unit)
    except InputError as error:
        raise InputError(f"variable {variable!r}: {error}") from None


def _unknown(column: str, columns: Mapping[str, ColumnKind]) -> str:
    try:
        known(column, columns)
    except InputError as error:
        return str(error)
    return ""


def _series(dataset: Any) -> Iterator[tuple[str, str, FloatArray]]:
    """Read variable, column and values, in the file's units, of all that is sampled and known."""
    for name, (dim, column) in _VARIABLES.items():
        if name not in dataset:
            continue
        labels = [str(label) for label in dataset[dim].values] if dim else [""]
        for label in labels:
            own = dataset[name].sel({dim: label}) if dim else dataset[name]
            for axis in "xy" if "{axis}" in column else ("",):
                chosen = own.sel(axis=axis) if axis else own
                yield (
                    name,
                    column.format(label, axis=axis),
                    np.asarray(chosen.values, dtype=np.float64),
                )


def _releases(dataset: Any, mechanism: Mechanism) -> dict[str, float | None]:
    if "release_time" not in dataset:
        return {}
    names: Iterable[str] = map(str, dataset["releasable_stop"].values)
    factor = _factor("release_time", dataset, ColumnKind("release", _TIME))
    times = np.asarray(dataset["release_time"].values, dtype=np.float64) * factor
    pairs = zip(names, times, strict=True)
    known_stops = {stop.name for stop in mechanism.stops}
    found = {
        name: None if np.isnan(time) else float(time) for name, time in pairs if name in known_stops
    }
    for name, at in found.items():
        if at is not None and not 0 <= at <= _SIZE:
            raise InputError(f"release_time of {name!r} is {at:.6g} s; a time from 0 on is needed")
    return found


def _impacts(dataset: Any, mechanism: Mechanism) -> list[GivenImpact]:
    """Impacts of a published file in variables, of one that `save` has written in an attribute."""
    known_stops = {stop.name for stop in mechanism.stops}
    try:
        if "impact_time" in dataset and "impact_impulse" in dataset:
            names = list(map(str, dataset["struck_stop"].values))
            times = np.asarray(dataset["impact_time"].values, dtype=np.float64)
            times *= _factor("impact_time", dataset, ColumnKind("impact", _TIME))
            rows = np.asarray(dataset["impact_impulse"].values, dtype=np.float64)
            _refuse_impulses(dataset, names, mechanism)
            told = [
                (float(t), dict(zip(names, row, strict=True)))
                for t, row in zip(times, rows, strict=True)
            ]
        else:
            told = [
                (float(t), dict(impulses))
                for t, impulses in json.loads(dataset.attrs.get("impacts", "[]"))
            ]
        impacts = [
            GivenImpact(name, t, float(p))
            for t, impulses in told
            for name, p in impulses.items()
            if p != 0
        ]
    except (KeyError, TypeError, ValueError, AttributeError) as error:
        raise InputError(f"its impacts cannot be read: {error}") from None
    for impact in impacts:
        if impact.stop not in known_stops or not (
            0 <= impact.time <= _SIZE and abs(impact.impulse) <= _SIZE
        ):
            raise InputError(
                f"its impact of {impact.stop[:60]!r} at {impact.time:.6g} s is of no stop, or "
                f"no number"
            )
    return impacts


def _refuse_impulses(dataset: Any, names: Iterable[str], mechanism: Mechanism) -> None:
    """Refuses impulses in other units than SI.

    Raises:
        InputError: the variable of the impulses states another unit, or none.
    """
    for stop in mechanism.stops:
        if stop.name in names:
            _factor("impact_impulse", dataset, _impulse_of(stop))
