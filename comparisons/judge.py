"""A motion from a file of others against the reference, in every quantity that the file gives.

A file is CSV with a heading of names and units, or NetCDF. Nothing that it says of itself is
believed: mechanism, engine and settings are not read. Points and energies that it does not give
follow from its coordinates and speeds, if it gives those; the rest is the reference's, and is
reported as not given instead of judged.
"""

from __future__ import annotations

import csv
import hashlib
import json
import math
from collections.abc import Generator, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from difflib import get_close_matches
from io import BytesIO
from pathlib import Path
from typing import Any, Literal, cast

import numpy as np
from pydantic import Field

from ..models.arrays import BoolArray, FloatArray
from ..models.errors import InputError
from ..models.files import read_bytes
from ..models.kinematics import Kinematics
from ..models.library.registry import Model, model_of
from ..models.mechanism import AnyStop, Mechanism
from ..models.problem import StopLaw
from ..models.spec import Spec
from ..models.trajectory import PointMotion, Provenance, Trajectory
from ..reference.equations import Equations
from ..reference.solution import Solution
from .diagnosis.case import ENERGIES
from .diagnosis.diagnose import diagnose_motion, failed_diagnosis
from .runs.metrics import UNSEEN, against, not_observed
from .runs.record import machine_row
from .runs.results import Diagnosis, Machine, Measured, Metric, Outcome, ResultFile, Run, verdict_on
from .runs.runner import Runner
from .runs.study import REFERENCE, Counter, Progress, Study, one_end
from .runs.tolerances import judge as judge_run

__path__: list[str] = []  # names of earlier releases below this module: see renamed.py

NOT_GIVEN = "the file does not give it"
FAR_APART = "the samples are far apart, and what moves between them is not seen"
TIME = "t"
_LARGEST_FILE = 500_000_000  # [B]
_LARGEST = 1e100  # in SI units: its square is still a number
_COUNTED = 10  # impacts of a stop: as many as have their times judged
_SAME = 1e-9  # of the duration: how far a sample may be from an impact that it belongs to
_MET = 1e-2  # of an angle, or of the longest arm: gap of a stop that is met
_JUMP = 1e-9  # of the largest speed

_ANGLE = {"rad": 1.0, "deg": math.pi / 180}
_LENGTH = {"m": 1.0, "cm": 1e-2, "mm": 1e-3, "km": 1e3}
_TIME = {"s": 1.0, "ms": 1e-3}
_FORCE = {"N": 1.0, "kN": 1e3}
_TORQUE = {"N m": 1.0, "kN m": 1e3}
_ENERGY = {"J": 1.0, "kJ": 1e3}

_Units = Mapping[str, float]  # SI value of each unit that a column may be in


class Judgement(Measured, ResultFile):
    """Judgement of one file."""

    format: Literal["trebucheck-judgement-1"] = "trebucheck-judgement-1"
    file: str
    sha256: str = Field(description="of the file")
    machine: Machine
    samples: int
    given: tuple[str, ...] = Field(description="columns, and what follows by kinematics")
    metrics: tuple[Metric, ...]
    diagnosis: Diagnosis | None = Field(default=None, description="of a broken tolerance")

    @property
    def outcome(self) -> Outcome:
        """The verdict on what is given."""
        return verdict_on(self.metrics)


def judge(
    file: str | Path,
    model: Model = "fixed",
    *,
    parameters: Spec | None = None,
    duration: float | None = None,
    until: str | float | None = None,
    stop_law: StopLaw | str | None = None,
    tolerances: Mapping[str, float | str] | None = None,
    diagnosed: bool = True,
    progress: Progress | None = None,
) -> Judgement:
    """Judge a motion from a file against the reference, in every quantity that it gives.

        >>> import trebucheck as tb
        >>> judgement = tb.judge("mine.csv", "rolling")  # doctest: +SKIP
        >>> judgement.outcome, judgement.given  # doctest: +SKIP

    Args:
        file: CSV with names and units in its first line, or NetCDF (.nc); as `trebucheck judge`
            reads it.
        model: name of a machine or of a problem of the library, path of a mechanism's .json file, a
            mechanism, or a problem.
        parameters: of the named model; its defaults if left out.
        duration: end of the compared motion [s]; a problem's own, else the launch, if left out.
        until: the end in other words: 'launch:MARKER', 'release:STOP', or a time [s].
        stop_law: 'release-once' or 'unilateral'; a problem's own, else 'release-once', if left out.
        tolerances: needs by quantity, as `tb.compare` takes them.
        diagnosed: look for the causes of what is broken, which takes seconds.
        progress: called before each part.

    Raises:
        InputError: the file cannot be read, or is not a motion of the mechanism, or a name or value
            is not valid.
        SimulationError: the reference cannot move it.
    """
    study = Study(
        [model_of(model, parameters)],
        [],
        (),
        stop_law=stop_law,
        until=one_end(duration, until),
        tolerances=tolerances,
        progress=progress,
    )
    return judge_file(Path(file), study, diagnosed)


def judge_file(path: Path, study: Study, diagnosed: bool = True) -> Judgement:
    """Judge a file on the one mechanism of a study; see :func:`judge`."""
    (mechanism,) = study.mechanisms
    given = read(path, mechanism)
    counter = Counter(2, study.progress)
    counter.start("reference")
    runner = Runner(mechanism, None, study.end_of(mechanism), study.law_of(mechanism))
    machine = machine_row(runner, study.needs)
    motion = _FileMotion(given, runner)
    # Of no engine: nobody's claims apply, and an event that is given is taken as located.
    run = Run(
        model=mechanism.name,
        engine=REFERENCE,
        preset="file",
        outcome=Outcome.NOT_JUDGED,
        engine_version="",
        metrics=tuple(motion.metrics()),
    )
    counter.start("causes")
    run = run.model_copy(update={"metrics": judge_run(run, machine, study.needs)})
    return Judgement.made_here(
        file=path.name,
        sha256=given.sha256,
        machine=machine,
        samples=len(given.t),
        given=tuple(sorted(motion.known)),
        metrics=run.metrics,
        diagnosis=motion.diagnosis(run.broken) if diagnosed and run.broken else None,
    )


class _FileMotion:
    """The file's motion as a trajectory, completed by kinematics and by the reference."""

    def __init__(self, given: GivenMotion, runner: Runner) -> None:
        self.given, self.runner, self.mechanism = given, runner, runner.mechanism
        mechanism, values, kinematics = self.mechanism, given.values, Kinematics(self.mechanism)
        n = len(mechanism.coordinates)
        self.state = [f"{kind} {name}" for kind in "qu" for name in mechanism.coordinates]
        # Names of columns that the file gives; below, those that follow from them
        self.known = {name for name in values if name != TIME}
        self.known |= {f"release {name}" for name in given.releases}
        has_q = self.known.issuperset(self.state[:n])
        has_u = has_q and self.known.issuperset(self.state)
        self.keep: BoolArray = given.t <= runner.solution.problem.duration
        t = given.t[self.keep]
        reference = runner.reference(t)
        q = self._columns(self.state[:n], reference.q)
        u = self._columns(self.state[n:], reference.u)
        self.impacts = given.impacts
        if not self.impacts and has_u:
            self.impacts = tuple(jumps(t, q, u, kinematics, runner.scales.length))
        self.known |= {f"impact {impact.stop}" for impact in self.impacts}
        if has_q:
            self.known.add("potential energy")
        if has_u:
            self.known.add("kinetic energy")
        markers: dict[str, PointMotion] = {}
        for marker in mechanism.markers:
            name, row = marker.name, kinematics.point(marker.body, marker.point)
            position = reference.marker(name).position
            velocity = reference.marker(name).velocity
            if has_q:
                position = kinematics.position(row, q)
                self.known.add(f"{name} x")
            if has_u:
                velocity = kinematics.velocity(row, q, u)
                self.known.add(f"{name} vx")
            markers[name] = PointMotion(
                self._columns([f"{name} x", f"{name} y"], position),
                self._columns([f"{name} vx", f"{name} vy"], velocity),
            )
        torques: dict[str, FloatArray] = {}
        for stop in mechanism.stops:
            if f"stop {stop.name}" in values:
                torques[stop.name] = values[f"stop {stop.name}"][self.keep]
        reactions: dict[str, FloatArray] = {}
        for joint in mechanism.joints:
            if f"joint {joint.name} x" in values:
                axes = [f"joint {joint.name} x", f"joint {joint.name} y"]
                reactions[joint.name] = self._columns(axes, t)
        # An impulse that is not given counts as one that pushes.
        impacts: dict[float, dict[str, float]] = {}
        for impact in sorted(self.impacts, key=lambda impact: impact.time):
            impulse = 1.0 if math.isnan(impact.impulse) else impact.impulse
            impacts.setdefault(impact.time, {})[impact.stop] = impulse
        potential = Equations(mechanism).potential_energy(q)
        self.trajectory = Trajectory(
            mechanism=mechanism,
            t=t,
            q=q,
            u=u,
            markers=markers,
            kinetic_energy=self._columns(["kinetic energy"], kinematics.kinetic_energy(q, u)),
            potential_energy=self._columns(["potential energy"], potential),
            stop_torques=torques,
            release_times={**reference.release_times, **given.releases},
            impacts=tuple(impacts.items()),
            joint_reactions=reactions,
            provenance=Provenance(
                "file", "", "", {}, mechanism.content_hash, float(t[-1]), "", 0, 0.0
            ),
        )

    def _columns(self, names: list[str], otherwise: FloatArray) -> FloatArray:
        """Columns of the file; :func:`read` sees to it that all of them are there or none."""
        if names[0] not in self.given.values:
            return otherwise
        columns = [self.given.values[name][self.keep] for name in names]
        return columns[0] if otherwise.ndim == 1 and len(names) == 1 else np.stack(columns, axis=1)

    def metrics(self) -> Iterator[Metric]:
        """Metrics against the reference; without a value of what the file does not give."""
        solution, end, thrown = (
            self.runner.solution,
            self.runner.judged_to,
            self.runner.until.thrown,
        )
        coordinates = self.mechanism.coordinates
        q = self.state[: len(coordinates)]
        closed = [f"release {stop.name}" for stop in self.mechanism.stops if stop.closed]
        launch = [f"{thrown} x", f"{thrown} vx", *closed]
        beside = impact_metrics(self.trajectory, self.impacts, solution, end)
        metrics = (*self.runner.measured(self.trajectory), *beside)
        far_apart = any(metric.name == UNSEEN for metric in metrics)
        for metric in metrics:
            # Names of the columns that it is computed from
            subject = metric.subject
            needed = {
                "position_max": [f"{subject} x"],
                "position_rms": [f"{subject} x"],
                "velocity_max": [f"{subject} vx"],
                "angle_max": [f"q {subject}"],
                "slide_max": [f"q {subject}"],
                "angular_speed_max": [f"u {subject}"],
                "slide_speed_max": [f"u {subject}"],
                "launch_time": launch,
                "launch_speed": launch,
                "release_time": [f"release {subject}"],
                "impact_time": [f"impact {subject}"],
                "impact_speed": [f"u {subject}" if subject in coordinates else f"{subject} vx"],
                "kinetic_energy_max": ["kinetic energy"],
                "potential_energy_max": ["potential energy"],
                "energy_balance": [*ENERGIES],
                "energy_drift": [*ENERGIES],
                "energy_drift_kinetic": [*ENERGIES],
                "horizontal_momentum": self.state,
                "stop_gap_held": [*q, f"release {subject}"],
                "stop_penetration": q,
                "complementarity": [*q, f"stop {subject}"],
                "stop_torque_max": [f"stop {subject}"],
                "joint_reaction_max": [f"joint {subject} x"],
            }
            if metric.name == UNSEEN:
                # An engine has to tell its whole motion; a file is judged where it has samples.
                yield metric.model_copy(update={"observed": False, "note": FAR_APART})
            elif metric.name == "energy_balance" and metric.sampling_error and far_apart:
                why = "the samples are too far apart to tell the work of its forces"
                yield not_observed(metric.name, metric.subject, metric.unit, why)
            elif self.known.issuperset(needed.get(metric.name, [])):
                yield metric
            else:
                yield not_observed(metric.name, subject, metric.unit, NOT_GIVEN)

    def diagnosis(self, broken: Sequence[Metric]) -> Diagnosis:
        """Find when and in what it leaves the reference, and which faults account for it.

        It is looked for in what the file itself gives, without what follows from that: a mistake
        in its coordinates would show in all points, as a wrong motion does.
        """
        mechanism = self.mechanism
        columns = {name: name for name in ENERGIES}
        columns["coordinates"] = self.state[0]
        columns["speeds of coordinates"] = self.state[len(mechanism.coordinates)]
        for marker in mechanism.markers:
            columns[f"position of the {marker.name}"] = f"{marker.name} x"
            columns[f"velocity of the {marker.name}"] = f"{marker.name} vx"
        for stop in mechanism.stops:
            columns[f"{stop.effort} of the {stop.name}"] = f"stop {stop.name}"
        for joint in mechanism.joints:
            columns[f"force of the {joint.name}"] = f"joint {joint.name} x"
        told = frozenset(name for name, column in columns.items() if column in self.given.values)
        motions = self.trajectory, self.runner.solution, self.runner.end
        try:
            return diagnose_motion(broken, *motions, told=told)
        except Exception as error:  # it solves many changed mechanisms
            return failed_diagnosis(broken, error)


# Impacts


@dataclass(frozen=True)
class GivenImpact:
    """One, as a file gives it."""

    stop: str
    time: float  # [s]
    impulse: float = math.nan  # [N m s or N s]; NaN: not given


def jumps(
    t: FloatArray, q: FloatArray, u: FloatArray, kinematics: Kinematics, arm: float
) -> Iterator[GivenImpact]:
    """Find the impacts that speeds show: two samples at one time, between which the speed jumps up.

    Samples are at times t [s], shape (n,); `arm` is the mechanism's longest [m].
    """
    for k in np.flatnonzero(np.diff(t) == 0):
        for stop in kinematics.mechanism.stops:
            rates = u[k : k + 2] @ kinematics.gap_jacobian(stop.name, q[k])
            reach = _MET * (1.0 if stop.gap_unit == "rad" else arm)
            met = abs(float(kinematics.gap(stop.name, q[k]))) <= reach
            least = _JUMP * float(np.abs(rates).max())
            if met and rates[0] < -least and rates[1] > rates[0] + least:
                yield GivenImpact(stop.name, float(t[k]))


def impact_metrics(
    motion: Trajectory, impacts: Sequence[GivenImpact], solution: Solution, end: float
) -> Iterator[Metric]:
    """Impulses of each stop, and speeds of coordinates and markers beside impacts, up to `end` [s].

    Impacts are as the file gives them.
    """
    comparison = against(motion, solution, end)
    common: list[tuple[float, float]] = []  # times of the file's and the reference's impacts [s]
    given = {(impact.stop, impact.time): impact.impulse for impact in impacts}
    impulses: dict[tuple[str, float], float] = {}
    for time, by_stop in solution.impacts:
        for name, impulse in by_stop.items():
            impulses[name, time] = impulse
    for stop in motion.mechanism.stops:
        errors: list[float] = []
        for time, due in comparison.impact_pairs(stop.name)[:_COUNTED]:
            if time is not None and due is not None and max(time, due) <= end:
                common.append((time, due))
                errors.append(given[stop.name, time] - impulses[stop.name, due])
        if not errors:
            continue
        (unit,) = _impulse_units(stop)
        if stop.name in solution.undetermined_stops:
            yield not_observed("impact_impulse", stop.name, unit, "it is not unique")
        elif np.isnan(errors).any():
            yield not_observed("impact_impulse", stop.name, unit, NOT_GIVEN)
        else:
            worst = float(np.abs(errors).max())
            yield Metric(name="impact_impulse", subject=stop.name, value=worst, unit=unit)
    yield from _speeds_beside(motion, common, solution)


def _speeds_beside(
    motion: Trajectory, pairs: Sequence[tuple[float, float]], solution: Solution
) -> Iterator[Metric]:
    """Largest errors of the file's two samples at an impact, against both sides of the reference's.

    Args:
        pairs: time of an impact in the file and in the reference [s].
    """
    mechanism, kinematics = motion.mechanism, Kinematics(motion.mechanism)
    n = len(mechanism.coordinates)
    units = ["rad/s" if name in mechanism.angles else "m/s" for name in mechanism.coordinates]
    errors: dict[tuple[str, str], list[float]] = {}
    for time, expected in pairs:
        near = np.flatnonzero(np.abs(motion.t - time) <= _SAME * motion.t[-1])
        if len(near) < 2:
            continue
        before = next(segment for segment in solution.segments if segment.end >= expected)
        y = np.asarray(before.interpolant(expected))
        after = solution.motion(np.array([expected]))
        for k, q, u in ((near[0], y[:n], y[n:]), (near[-1], after.q[0], after.u[0])):
            differences = np.abs(motion.u[k] - u).tolist()
            for name, unit, error in zip(mechanism.coordinates, units, differences, strict=True):
                errors.setdefault((name, unit), []).append(error)
            for marker in mechanism.markers:
                speed = kinematics.velocity(kinematics.point(marker.body, marker.point), q, u)
                distance = np.linalg.norm(motion.marker(marker.name).velocity[k] - speed)
                errors.setdefault((marker.name, "m/s"), []).append(float(distance))
    for (subject, unit), values in errors.items():
        yield Metric(name="impact_speed", subject=subject, value=max(values), unit=unit)


# Files


@dataclass(frozen=True)
class GivenMotion:
    """Content of a file of a motion, in SI units."""

    values: Mapping[str, FloatArray]  # by column, each of shape (n,), `t` among them
    releases: Mapping[str, float | None]  # of the stops that give one [s]; None: it does not open
    impacts: tuple[GivenImpact, ...]  # that the file states
    sha256: str  # of the file

    @property
    def t(self) -> FloatArray:
        """Times [s], shape (n,)."""
        return self.values[TIME]


_Contents = tuple[dict[str, FloatArray], dict[str, float | None], list[GivenImpact]]


def read(path: Path, mechanism: Mechanism) -> GivenMotion:
    """Read a .csv, or a .nc as NetCDF.

    Raises:
        InputError: it cannot be read, or is not a motion of the mechanism; the sentence has the
            line of a CSV file.
    """
    content = read_bytes(path, _LARGEST_FILE)
    reader = _netcdf if path.suffix.lower() in (".nc", ".nc4", ".h5") else _csv
    try:
        values, releases, impacts = reader(content, mechanism)
        _refuse_halves(values, mechanism)
    except InputError as error:
        raise InputError(f"{path}: {str(error).removesuffix('.')}.") from None
    return GivenMotion(values, releases, tuple(impacts), hashlib.sha256(content).hexdigest())


def _columns_of(mechanism: Mechanism) -> dict[str, _Units]:
    """Units of every column that a file may have, named as in a trajectory's data frame."""
    columns: dict[str, _Units] = {TIME: _TIME, **dict.fromkeys(ENERGIES, _ENERGY)}
    for name in mechanism.coordinates:
        units = _ANGLE if name in mechanism.angles else _LENGTH
        columns[f"q {name}"] = units
        columns[f"u {name}"] = _per_second(units)
    for marker in mechanism.markers:
        for axis in "xy":
            columns[f"{marker.name} {axis}"] = _LENGTH
            columns[f"{marker.name} v{axis}"] = _per_second(_LENGTH)
    for stop in mechanism.stops:
        columns[f"stop {stop.name}"] = _TORQUE if stop.effort == "torque" else _FORCE
    for joint in mechanism.joints:
        if joint.held_directions:
            columns |= dict.fromkeys((f"joint {joint.name} {axis}" for axis in "xy"), _FORCE)
    return columns


def _per_second(units: _Units) -> _Units:
    return {f"{unit}/s": value for unit, value in units.items()}


def _si_value(unit: str, units: _Units, column: str) -> float:
    """SI value of a column's unit."""
    if unit not in units:
        stated = f"the unit [{unit[:30]}]" if unit else "no unit"
        known = ", ".join(f"[{known}]" for known in units)
        raise InputError(f"column {column!r} has {stated}; there are: {known}")
    return units[unit]


def _impulse_units(stop: AnyStop) -> _Units:
    return {"N m s": 1.0} if stop.effort == "torque" else {"N s": 1.0}


def _refuse_unknown(name: str, columns: Mapping[str, _Units]) -> None:
    if name not in columns:
        close = get_close_matches(name, columns, n=1)
        hint = f" (did you mean {close[0]!r}?)" if close else ""
        there = ", ".join(columns)
        raise InputError(f"there is no column {name[:60]!r}{hint}; there are: {there}")


def _refuse_times(t: FloatArray, where: list[str]) -> None:
    """Times that do not begin at 0, that decrease, or that do not go on."""
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
    points = [[f"{m.name} {v}x", f"{m.name} {v}y"] for m in mechanism.markers for v in ("", "v")]
    forces = [[f"joint {joint.name} x", f"joint {joint.name} y"] for joint in mechanism.joints]
    q, u = ([f"{kind} {name}" for name in mechanism.coordinates] for kind in "qu")
    for whole in (*points, *forces, q, u):
        there = [name for name in whole if name in values]
        lacking = [name for name in whole if name not in values]
        if there and lacking:
            raise InputError(f"column {there[0]!r} is there without {lacking[0]!r}")
    if not any(name in values for name in (q[0], *(point[0] for point in points))):
        raise InputError(
            "it gives neither the coordinates nor the position of a marker: there is nothing to "
            "judge"
        )
    if u[0] in values and q[0] not in values:
        # Without them energies and points would be those of the reference's coordinates.
        raise InputError(f"column {u[0]!r} is there without {q[0]!r}")


@contextmanager
def _inside(part: str) -> Generator[None]:
    """Adds the line or the variable to errors."""
    try:
        yield
    except (InputError, csv.Error) as error:
        raise InputError(f"{part}: {error}") from None


# CSV


def _csv(content: bytes, mechanism: Mechanism) -> _Contents:
    try:
        lines = content.decode("utf-8-sig").splitlines()
    except UnicodeDecodeError as error:
        line = content.count(b"\n", 0, error.start) + 1
        raise InputError(f"line {line} is not UTF-8 text") from None
    releases, impacts = dict[str, float | None](), list[GivenImpact]()
    comments: list[tuple[int, list[str]]] = []
    rows: list[tuple[int, list[str]]] = []
    for number, line in enumerate(lines, 1):
        with _inside(f"line {number}"):
            if line.lstrip().startswith("#"):
                _read_comment(line, mechanism, releases, impacts)
                if not rows:
                    comments.append((number, _cells(line.strip().lstrip("# "), strict=False)))
            elif line.strip():
                rows.append((number, _cells(line)))
    if not rows:
        raise InputError(f"it is empty; {_HEADINGS_NEEDED}")
    (first, headings), *rows = _with_headings(rows, comments)
    with _inside(f"line {first}"):
        columns = _read_headings(headings, _columns_of(mechanism))
        if len(rows) < 2:
            raise InputError(f"{len(rows)} lines of numbers follow; at least two are needed")
    table = np.empty((len(rows), len(columns)))
    for k, (number, cells) in enumerate(rows):
        if len(cells) != len(columns):
            raise InputError(
                f"line {number} has {len(cells)} values; the headings are {len(columns)}"
            )
        with _inside(f"line {number}"):
            table[k] = [_number(cell, name) for cell, name in zip(cells, columns, strict=True)]
    table *= list(columns.values())
    values = {name: table[:, i].copy() for i, name in enumerate(columns)}
    _refuse_times(values[TIME], [f"line {number}" for number, _ in rows])
    return values, releases, impacts


_HEADINGS_NEEDED = "a line of headings such as 't [s],q theta [rad]' is needed"


def _cells(line: str, strict: bool = True) -> list[str]:
    """Headings or numbers of a line: between commas, else between blanks as NumPy writes them."""
    if "," in line:
        return next(csv.reader([line], strict=strict))
    return line.replace("]", "]\n").splitlines() if "[" in line else line.split()


def _with_headings(
    rows: list[tuple[int, list[str]]], comments: list[tuple[int, list[str]]]
) -> list[tuple[int, list[str]]]:
    """Lines of which the first has the headings, which stand in a comment where it has numbers.

    `numpy.savetxt` writes its `header` so.
    """
    number, cells = rows[0]
    if not all(_is_number(cell) for cell in cells):
        return rows
    headings = [line for line in comments if TIME in (_split_heading(cell)[0] for cell in line[1])]
    if not headings:
        raise InputError(f"line {number} has numbers; {_HEADINGS_NEEDED} before it")
    return [headings[-1], *rows]


def _is_number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return True


def _split_heading(heading: str) -> tuple[str, str]:
    """Name and unit of 'q theta [rad]'; without brackets no unit."""
    name, bracket, rest = heading.strip().partition("[")
    return " ".join(name.split()), rest.partition("]")[0].strip() if bracket else ""


def _read_headings(cells: list[str], columns: Mapping[str, _Units]) -> dict[str, float]:
    """SI value of the unit of each column, by its name."""
    if all(";" in cell for cell in cells[1:] or cells):
        raise InputError("columns are separated by ';'; commas are needed, and points in numbers")
    factors: dict[str, float] = {}
    for cell in cells:
        name, unit = _split_heading(cell)
        if name not in columns and f"q {name}" in columns:
            name = f"q {name}"
        _refuse_unknown(name, columns)
        if name in factors:
            raise InputError(f"column {name!r} is there twice")
        factors[name] = _si_value(unit, columns[name], name)
    if TIME not in factors:
        raise InputError("there is no column 't [s]'")
    return factors


def _read_comment(
    line: str, mechanism: Mechanism, releases: dict[str, float | None], impacts: list[GivenImpact]
) -> None:
    """Adds what a comment says of an event; any other comment says nothing.

    It is '# release hanger rest [s] = 0.81', '# release hanger rest [s] = never', or
    '# impact floor [s] = 0.45, impulse [N s] = 13.3' with or without the impulse.
    """
    text, equals, value = line.strip().lstrip("# ").partition("=")
    kind, space, heading = text.partition(" ")
    if not (equals and space and kind in ("release", "impact")):
        return
    name, unit = _split_heading(heading)
    stops = {stop.name: stop for stop in mechanism.stops}
    if name not in stops:
        there = ", ".join(stops) or "none"
        raise InputError(f"there is no stop {name[:60]!r}; there are: {there}")
    if kind == "release" and value.strip() == "never":
        releases[name] = None
        return
    rest = ""
    if kind == "impact":
        value, _, rest = value.partition(",")
    event = f"{kind} {name}"
    time = _si_value(unit, _TIME, event) * _number(value, event)
    if time < 0:
        raise InputError(f"{event} is {time:.6g} s; a time from 0 on is needed")
    if kind == "release":
        releases[name] = time
        return
    impulse = math.nan
    if rest.strip():
        heading, _, size = rest.partition("=")
        quantity, unit = _split_heading(heading)
        if quantity != "impulse":
            raise InputError(
                f"{rest.strip()[:40]!r} follows the time of an impact; 'impulse [N s] = 1.0' is "
                "understood"
            )
        factor = _si_value(unit, _impulse_units(stops[name]), "impulse")
        impulse = factor * _number(size, "impulse")
    impacts.append(GivenImpact(name, time, impulse))


def _number(text: str, name: str) -> float:
    try:
        value = float(text)
    except ValueError:
        raise InputError(f"{name} is {text.strip()[:30]!r}, which is no number") from None
    if not abs(value) <= _LARGEST:
        raise InputError(f"{name} is {text.strip()[:30]}; a finite number is needed")
    return value


# NetCDF

# Variables of a file: the dimension of their names, and the column that each is
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


def _netcdf(content: bytes, mechanism: Mechanism) -> _Contents:
    import xarray as xr

    try:
        with xr.open_dataset(BytesIO(content), engine="h5netcdf", decode_times=False) as file:
            dataset = file.load()
        t = np.asarray(dataset["time"].values, dtype=np.float64)
    # Of a broken file HDF5, h5netcdf and xarray raise errors of any kind
    except Exception as error:
        reason = cast("object", error)
        raise InputError(f"it is no NetCDF file with a variable 'time': {reason}") from None
    if t.ndim != 1 or len(t) < 2 or not np.isfinite(t).all():
        raise InputError("its times are not two or more finite numbers")
    _refuse_times(t, [f"sample {k}" for k in range(len(t))])
    columns = _columns_of(mechanism)
    values = {TIME: t * _stated_factor("time", dataset, columns[TIME], TIME)}
    for name, column, series in _series(dataset):
        with _inside(f"variable {name!r}"):
            _refuse_unknown(column, columns)
            if series.shape != t.shape or not (np.abs(series) <= _LARGEST).all():
                raise InputError(f"{column!r} does not have one finite number a time")
        values[column] = series * _stated_factor(name, dataset, columns[column], column)
    return values, _netcdf_releases(dataset, mechanism), _netcdf_impacts(dataset, mechanism)


def _stated_factor(variable: str, dataset: Any, units: _Units, column: str) -> float:
    """SI value of the unit that a variable states for a column.

    Units of several kinds are as `Trajectory.to_dataset` writes them, 'rad (slides: m)': the unit
    is the first that the column can have.
    """
    stated = str(dataset[variable].attrs.get("units", ""))
    first, _, others = stated.partition("(")
    several = [first.strip(), others.partition(":")[2].strip(" )")]
    unit = next((unit for unit in several if unit in units), stated)
    with _inside(f"variable {variable!r}"):
        return _si_value(unit, units, column)


def _series(dataset: Any) -> Iterator[tuple[str, str, FloatArray]]:
    """Variable, column and values, in the file's units, of all that is sampled and known."""
    for name, (dimension, column) in _VARIABLES.items():
        if name not in dataset:
            continue
        labels = [str(label) for label in dataset[dimension].values] if dimension else [""]
        for label in labels:
            chosen = dataset[name].sel({dimension: label}) if dimension else dataset[name]
            if "{axis}" not in column:
                yield name, column.format(label), np.asarray(chosen.values, dtype=np.float64)
                continue
            for axis in "xy":
                component = np.asarray(chosen.sel(axis=axis).values, dtype=np.float64)
                yield name, column.format(label, axis=axis), component


def _netcdf_releases(dataset: Any, mechanism: Mechanism) -> dict[str, float | None]:
    if "release_time" not in dataset:
        return {}
    factor = _stated_factor("release_time", dataset, _TIME, "release")
    times = np.asarray(dataset["release_time"].values, dtype=np.float64) * factor
    stops = {stop.name for stop in mechanism.stops}
    releases: dict[str, float | None] = {}
    for name, time in zip(map(str, dataset["releasable_stop"].values), times, strict=True):
        if name not in stops:
            continue
        if not (np.isnan(time) or 0 <= time <= _LARGEST):
            raise InputError(
                f"release_time of {name!r} is {time:.6g} s; a time from 0 on is needed"
            )
        releases[name] = None if np.isnan(time) else float(time)
    return releases


def _netcdf_impacts(dataset: Any, mechanism: Mechanism) -> list[GivenImpact]:
    """Impacts of a published file in variables, of one that `save` has written in an attribute."""
    stops = {stop.name: stop for stop in mechanism.stops}
    impacts: list[GivenImpact] = []
    try:
        if "impact_time" in dataset and "impact_impulse" in dataset:
            names = list(map(str, dataset["struck_stop"].values))
            times = np.asarray(dataset["impact_time"].values, dtype=np.float64)
            times *= _stated_factor("impact_time", dataset, _TIME, "impact")
            rows = np.asarray(dataset["impact_impulse"].values, dtype=np.float64)
            for name in set(names) & stops.keys():
                _stated_factor("impact_impulse", dataset, _impulse_units(stops[name]), "impulse")
            stated = [
                (time, dict(zip(names, row, strict=True)))
                for time, row in zip(times, rows, strict=True)
            ]
        else:
            stated = json.loads(dataset.attrs.get("impacts", "[]"))
        for time, impulses in stated:
            for name, impulse in dict(impulses).items():
                if impulse != 0:
                    impacts.append(GivenImpact(name, float(time), float(impulse)))
    except (KeyError, TypeError, ValueError, AttributeError) as error:
        raise InputError(f"its impacts cannot be read: {error}") from None
    for impact in impacts:
        numbers = 0 <= impact.time <= _LARGEST and abs(impact.impulse) <= _LARGEST
        if impact.stop not in stops or not numbers:
            raise InputError(
                f"its impact of {impact.stop[:60]!r} at {impact.time:.6g} s is of no stop, or "
                "no number"
            )
    return impacts
