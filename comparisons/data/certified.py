"""Published trajectories of the reference: an uncertainty of every value, events and horizon."""

from __future__ import annotations

import hashlib
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import replace
from importlib.resources import files
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from ...models.arrays import FloatArray
from ...models.errors import (
    EngineNotInstalledError,
    InputError,
    SimulationError,
    UnsupportedProblemError,
)
from ...models.files import write_text
from ...models.launch import Launch
from ...models.library.registry import benchmarks, find_benchmark, library_problem, model, models
from ...models.mechanism import Mechanism
from ...models.problem import Problem
from ...models.trajectory import Trajectory, write_dataset
from ...reference.certification.redundant import solve_redundant
from ...reference.solution import Solution
from ...reference.solver import solve
from ...reference.taylor.solve import solve_taylor
from ...version import __version__
from ..runs.runner import motion_of

if TYPE_CHECKING:
    import xarray as xr


DATA_FORMAT = "trebucheck-data-1"
_SAMPLES = 200  # intervals of time
_COARSE = 1e-12  # tolerance of the second integration, some thirty times the reference's own
_SAFETY = 4.0
_ROUNDING = 64 * float(np.finfo(np.float64).eps)
_QUANTITIES = (
    "q", "u", "position", "velocity", "kinetic_energy", "potential_energy", "stop_torque",
    "joint_reaction",
)  # fmt: skip


def certified_dataset(given: Mechanism | Problem) -> xr.Dataset:
    """Solve a problem, or a mechanism up to its launch or for some characteristic times.

    A variable `NAME_uncertainty` beside each one bounds its error, at each time the largest up to
    then: four times the largest difference from other computations of the motion (a coarser
    integration; redundant coordinates and Taylor series in 80-bit floats, where they have all of
    its elements), and sixty-four roundings of its largest value.

    Raises:
        SimulationError: the reference cannot move it.
    """
    runner = motion_of(given)
    solution, end = runner.solution, runner.end
    times = np.linspace(0.0, end, _SAMPLES + 1)
    ours = solution.trajectory(times)
    # Nothing that differs from run to run.
    dataset = replace(ours, provenance=replace(ours.provenance, wall_time=0.0)).to_dataset()
    quantities = [name for name in _QUANTITIES if name in dataset]
    methods: list[str] = []
    differences: dict[str, FloatArray] = {}
    for method, other in _others(solution, times):
        methods.append(method)
        theirs = other.to_dataset()
        for name in quantities:  # the largest difference so far, over both axes
            difference = abs(dataset[name] - theirs[name])
            difference = difference.max("axis") if "axis" in difference.dims else difference
            values = np.asarray(difference.values, dtype=np.float64)
            largest = np.maximum.accumulate(values, axis=0)
            differences[name] = np.maximum(differences.get(name, 0.0), largest)
    for name, values in differences.items():
        dims = [dim for dim in dataset[name].dims if dim != "axis"]
        others = [dim for dim in dataset[name].dims if dim not in dims[1:]]
        largest = np.asarray(abs(dataset[name]).max(others).values, dtype=np.float64)
        bound = (_SAFETY * values + _ROUNDING * largest).astype(np.float32)
        units = dataset[name].attrs["units"]
        label = f"bound of the error of {name} up to each time"
        dataset[f"{name}_uncertainty"] = (dims, bound, {"units": units, "long_name": label})
    _add_events(dataset, solution, end)
    entry, name = find_benchmark(runner.mechanism.name), runner.mechanism.name
    dataset.attrs |= {
        "data_format": DATA_FORMAT,
        "title": f"Certified trajectory of {name!r}" + (f": {entry.text}" if entry else ""),
        "references": entry.source if entry else "",
        "trebucheck_version": __version__,
        "mechanism_hash": runner.mechanism.content_hash,
        "predictability_horizon": runner.judged_to,
        "predictability_horizon_units": "s",
        "uncertainty_method": "four times the largest difference from: " + "; ".join(methods),
        "convention": "angles from +x, positive clockwise; x to the right, y up; SI units",
    }
    return dataset


def _others(solution: Solution, times: FloatArray) -> Iterator[tuple[str, Trajectory]]:
    """Other computations of the same motion, read at the same times [s]."""
    given = solution.problem
    duration = min(given.duration, 1.02 * float(times[-1]))
    problem = Problem(given.mechanism, duration=duration, stop_law=given.stop_law)
    coarse = solve(problem, _COARSE, _COARSE)
    yield f"DOP853 at a tolerance of {_COARSE:g}", coarse.trajectory(times)
    if solution.singular_passages:
        return  # the others do not know of them, and may leave the smooth branch there
    with suppress(UnsupportedProblemError, SimulationError):
        redundant = solve_redundant(problem)
        states = [redundant.state(float(t)) for t in times]
        q, u = (np.array(values) for values in zip(*states, strict=True))
        yield "redundant coordinates", solution.reading(times, solution.motion_of(times, q, u))
    with suppress(UnsupportedProblemError, SimulationError, EngineNotInstalledError):
        series = solve_taylor(problem, precision="extended")
        yield "Taylor series in 80-bit floats", series.trajectory(times)


def _add_events(dataset: xr.Dataset, solution: Solution, end: float) -> None:
    """Impacts, rests and the launch up to the end; releases are there."""

    def add(name: str, dims: tuple[str, ...], values: Any, units: str, title: str) -> None:
        dataset[name] = (dims, values, {"units": units, "long_name": title})

    stops = [stop.name for stop in solution.problem.mechanism.stops]
    impacts = [(time, impulses) for time, impulses in solution.impacts if time <= end]
    if impacts:
        dataset.coords["struck_stop"] = stops
        times = np.array([time for time, _ in impacts])
        rows = np.array([[impulses.get(stop, 0.0) for stop in stops] for _, impulses in impacts])
        add("impact_time", ("impact",), times, "s", "times of the impacts")
        title, units = "impulses of the stops in each impact", "N s (stops on angles: N m s)"
        add("impact_impulse", ("impact", "struck_stop"), rows, units, title)
    rests = [(t, name) for name, times in solution.rest_times.items() for t in times if t <= end]
    if rests:
        dataset.coords["rest"] = [name for _, name in rests]
        title = "times at which stops ceased to bounce, and stayed closed"
        add("rest_time", ("rest",), np.array([time for time, _ in rests]), "s", title)
    launch: Launch | None = solution.launch
    if launch is not None and launch.time <= end:
        add("launch_time", (), launch.time, "s", "launch at 45 degrees")
        add("launch_speed", (), launch.speed, "m/s", "speed of the projectile then")


CHECKSUMS = "SHA256SUMS"
State = Literal["good", "changed", "missing"]


def names() -> tuple[str, ...]:
    """Names of all machines and problems."""
    return (*models(), *(entry.name for entry in benchmarks()))


def published() -> dict[str, str]:
    """Read the SHA-256 of each published file by name, as `sha256sum` writes them."""
    source = files(__package__ or "") / "trajectories" / CHECKSUMS
    lines = source.read_text().splitlines() if source.is_file() else []
    pairs = map(str.split, lines)
    return {file.removesuffix(".nc"): digest for digest, file in pairs}


def content(name: str) -> bytes:
    """A published file.

    Raises:
        InputError: there is none of that name, or it is not as it was published.
    """
    known = published()
    if name not in known:
        raise InputError(
            f"there is no published trajectory {name!r}; there are: {', '.join(known)}."
        )
    data, state = _read(name, known[name])
    if state != "good":
        raise InputError(
            f"the published trajectory of {name!r} is {state}: it does not have its checksum."
        )
    return data


def states() -> Iterator[tuple[str, str, int, State]]:
    """List each published file: name, SHA-256, size [B], and whether it is as it was published."""
    for name, digest in published().items():
        data, state = _read(name, digest)
        yield name, digest, len(data), state


def _read(name: str, digest: str) -> tuple[bytes, State]:
    file = files(__package__ or "") / "trajectories" / f"{name}.nc"
    if not file.is_file():
        return b"", "missing"
    data = file.read_bytes()
    return data, "good" if hashlib.sha256(data).hexdigest() == digest else "changed"


def publish(name: str, folder: Path) -> None:
    """Compute a machine's or problem's file anew, and its line in the list of checksums.

    Raises:
        SimulationError: the reference cannot move it.
    """
    path = folder / f"{name}.nc"
    write_dataset(certified_dataset(library_problem(name) or model(name)), path, compressed=True)
    lines: list[str] = []
    for other in names():
        file = folder / f"{other}.nc"
        if file.is_file():
            lines.append(f"{hashlib.sha256(file.read_bytes()).hexdigest()}  {file.name}\n")
    write_text(folder / CHECKSUMS, "".join(lines))
