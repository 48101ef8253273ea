"""Published trajectories of the reference: an uncertainty of every value, events and horizon."""

from __future__ import annotations

import hashlib
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import replace
from importlib.resources import files
from pathlib import Path
from typing import TYPE_CHECKING, Literal

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
from ...models.problem import Problem, StopLaw, mechanism_of
from ...models.trajectory import Trajectory, write_dataset
from ...reference.certification.redundant import solve_redundant
from ...reference.solution import Solution
from ...reference.solver import solve
from ...reference.taylor.solve import solve_taylor
from ...version import __version__
from ..runs.runner import Runner
from ..runs.study import Until

if TYPE_CHECKING:
    import xarray as xr


DATA_FORMAT = "trebucheck-data-1"
_SAMPLES = 200  # intervals of time
_COARSE = 1e-12  # tolerance of the second integration, some thirty times the reference's own
_SAFETY = 4.0
_ROUNDING = 64 * float(np.finfo(np.float64).eps)
_KNOWN = (
    "q",
    "u",
    "position",
    "velocity",
    "kinetic_energy",
    "potential_energy",
    "stop_torque",
    "joint_reaction",
)


def certified_dataset(given: Mechanism | Problem) -> xr.Dataset:
    """Solve a problem, or a mechanism up to its launch or for some characteristic times.

    A variable `NAME_uncertainty` beside each one bounds its error, at each time the largest up to
    then: four times the largest difference from other computations of the motion (a coarser
    integration; redundant coordinates and Taylor series in 80-bit floats, where they have all of
    its elements), and sixty-four roundings of its largest value.

    Raises:
        SimulationError: the reference cannot move it.
    """
    problem = given if isinstance(given, Problem) else None
    mechanism = mechanism_of(given)
    until = Until.of(problem.duration if problem else None)
    runner = Runner(
        mechanism, until=until, law=problem.stop_law if problem else StopLaw.RELEASE_ONCE
    )
    solution, end = runner.solution, runner.end
    times = np.linspace(0.0, end, _SAMPLES + 1)
    ours = solution.trajectory(times)
    # Nothing that differs from run to run.
    dataset = replace(ours, provenance=replace(ours.provenance, wall_time=0.0)).to_dataset()
    methods: list[str] = []
    differences: dict[str, FloatArray] = {}
    for method, other in _others(solution, times):
        methods.append(method)
        for name, values in _differences(dataset, other).items():
            differences[name] = np.maximum(differences.get(name, 0.0), values)
    _add_uncertainties(dataset, differences)
    _add_events(dataset, solution, end)
    dataset.attrs |= _described(mechanism, runner.judged_to, methods)
    return dataset


def _others(solution: Solution, times: FloatArray) -> Iterator[tuple[str, Trajectory]]:
    """Other computations of the same motion, read at the same times [s]."""
    given = solution.problem
    problem = Problem(
        given.mechanism,
        duration=min(given.duration, 1.02 * float(times[-1])),
        stop_law=given.stop_law,
    )
    yield (
        f"DOP853 at a tolerance of {_COARSE:g}",
        solve(problem, _COARSE, _COARSE).trajectory(times),
    )
    if (
        solution.singular_passages
    ):  # the others do not know of them, and may leave the smooth branch there
        return
    with suppress(UnsupportedProblemError, SimulationError):
        redundant = solve_redundant(problem)
        states = [redundant.state(float(t)) for t in times]
        q, u = (np.array(values) for values in zip(*states, strict=True))
        yield "redundant coordinates", solution.reading(times, solution.motion_of(times, q, u))
    with suppress(UnsupportedProblemError, SimulationError, EngineNotInstalledError):
        yield (
            "Taylor series in 80-bit floats",
            solve_taylor(problem, precision="extended").trajectory(times),
        )


def _differences(dataset: xr.Dataset, other: Trajectory) -> dict[str, FloatArray]:
    """Largest difference so far of every variable from another computation, over both axes."""
    theirs = other.to_dataset()
    differences: dict[str, FloatArray] = {}
    for name in _KNOWN:
        if name in dataset:
            apart = abs(dataset[name] - theirs[name])
            apart = apart.max("axis") if "axis" in apart.dims else apart
            differences[name] = np.maximum.accumulate(
                np.asarray(apart.values, dtype=np.float64), axis=0
            )
    return differences


def _add_uncertainties(dataset: xr.Dataset, differences: dict[str, FloatArray]) -> None:
    for name, values in differences.items():
        dims = [dim for dim in dataset[name].dims if dim != "axis"]
        others = [dim for dim in dataset[name].dims if dim not in dims[1:]]
        largest = np.asarray(abs(dataset[name]).max(others).values, dtype=np.float64)
        bound = (_SAFETY * values + _ROUNDING * largest).astype(np.float32)
        units = dataset[name].attrs["units"]
        label = f"bound of the error of {name} up to each time"
        dataset[f"{name}_uncertainty"] = (dims, bound, {"units": units, "long_name": label})


def _add_events(dataset: xr.Dataset, solution: Solution, end: float) -> None:
    """Impacts, rests and the launch up to the end; releases are there."""
    stops = [stop.name for stop in solution.problem.mechanism.stops]
    impacts = [(t, impulses) for t, impulses in solution.impacts if t <= end]
    if impacts:
        dataset.coords["struck_stop"] = stops
        times, impulses = (
            np.array([t for t, _ in impacts]),
            [[one.get(s, 0.0) for s in stops] for _, one in impacts],
        )
        dataset["impact_time"] = (
            ("impact",),
            times,
            {"units": "s", "long_name": "times of the impacts"},
        )
        about = {
            "units": "N s (stops on angles: N m s)",
            "long_name": "impulses of the stops in each impact",
        }
        dataset["impact_impulse"] = (("impact", "struck_stop"), np.array(impulses), about)
    rests = [(t, name) for name, times in solution.rest_times.items() for t in times if t <= end]
    if rests:
        dataset.coords["rest"] = [name for _, name in rests]
        about = {
            "units": "s",
            "long_name": "times at which stops ceased to bounce, and stayed closed",
        }
        dataset["rest_time"] = (("rest",), np.array([t for t, _ in rests]), about)
    launch: Launch | None = solution.launch
    if launch is not None and launch.time <= end:
        dataset["launch_time"] = (
            (),
            launch.time,
            {"units": "s", "long_name": "launch at 45 degrees"},
        )
        dataset["launch_speed"] = (
            (),
            launch.speed,
            {"units": "m/s", "long_name": "speed of the projectile then"},
        )


def _described(mechanism: Mechanism, horizon: float, methods: list[str]) -> dict[str, object]:
    found = find_benchmark(mechanism.name)
    return {
        "data_format": DATA_FORMAT,
        "title": f"Certified trajectory of {mechanism.name!r}"
        + (f": {found.text}" if found else ""),
        "references": found.source if found else "",
        "trebucheck_version": __version__,
        "mechanism_hash": mechanism.content_hash,
        "predictability_horizon": horizon,
        "predictability_horizon_units": "s",
        "uncertainty_method": "four times the largest difference from: " + "; ".join(methods),
        "convention": "angles from +x, positive clockwise; x to the right, y up; SI units",
    }


CHECKSUMS = "SHA256SUMS"
State = Literal["good", "changed", "missing"]


def names() -> tuple[str, ...]:
    """Names of all machines and problems."""
    return (*models(), *(entry.name for entry in benchmarks()))


def published() -> dict[str, str]:
    """Read the SHA-256 of each published file by name, as `sha256sum` writes them."""
    source = files(__package__ or "") / "trajectories" / CHECKSUMS
    lines = source.read_text().splitlines() if source.is_file() else []
    pairs = (line.split() for line in lines)
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
    data = _read(name)
    if data is None or hashlib.sha256(data).hexdigest() != known[name]:
        state = "missing" if data is None else "changed"
        raise InputError(
            f"the published trajectory of {name!r} is {state}: it does not have its checksum."
        )
    return data


def states() -> Iterator[tuple[str, str, int, State]]:
    """List each published file: name, SHA-256, size [B], and whether it is as it was published."""
    for name, digest in published().items():
        data = _read(name)
        if data is None:
            yield name, digest, 0, "missing"
        else:
            yield (
                name,
                digest,
                len(data),
                "good" if hashlib.sha256(data).hexdigest() == digest else "changed",
            )


def _read(name: str) -> bytes | None:
    file = files(__package__ or "") / "trajectories" / f"{name}.nc"
    return file.read_bytes() if file.is_file() else None


def publish(name: str, folder: Path) -> None:
    """Compute a machine's or problem's file anew, and its line in the list of checksums.

    Raises:
        SimulationError: the reference cannot move it.
    """
    path = folder / f"{name}.nc"
    write_dataset(certified_dataset(library_problem(name) or model(name)), path, compressed=True)
    present = (each for each in names() if (folder / f"{each}.nc").is_file())
    lines = (
        f"{hashlib.sha256((folder / f'{n}.nc').read_bytes()).hexdigest()}  {n}.nc" for n in present
    )
    write_text(folder / CHECKSUMS, "\n".join(lines) + "\n")
