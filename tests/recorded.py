"""Recorded values of small comparisons, judgements, diagnoses and runs; a test compares today's.

    python tests/recorded.py [NAME ...]

records them anew, after a change that is meant to change them. Engines are the tests' own, which
give the reference's motion with a fault, so that no value depends on an engine's build. Texts count
by the numbers in them: another wording changes nothing.
"""

from __future__ import annotations

import json
import math
import re
import sys
import tempfile
from collections.abc import Callable, Iterator
from dataclasses import fields
from functools import cache, partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import recorded_engines
import recorded_judging
import recorded_models
import recorded_reference
import trebucheck as tb
import wrong_engines
from mechanisms import (
    angle_stop,
    chain_on_a_slot,
    everything,
    floor,
    four_bar,
    hanging_bob,
    parallel_cranks,
    rods_on_a_slot,
    slider_crank,
)
from trebucheck.comparisons.diagnosis.equivalence import random_states
from trebucheck.comparisons.diagnosis.faults import machine_suspects, systematic_faults
from trebucheck.comparisons.diagnosis.readings import all_readings
from trebucheck.comparisons.judge import judge_file
from trebucheck.comparisons.runs.study import Study
from trebucheck.conformance.suite import Suite, Target
from trebucheck.engines.registry import ANNOUNCED
from trebucheck.models.trajectory import save
from trebucheck.reference.certification.certify import certify
from trebucheck.reference.certification.redundant import solve_redundant
from trebucheck.reference.solver import solve
from trebucheck.reference.throw.throw import perform

FOLDER = Path(__file__).with_name("recorded")
DIGITS = 5
LEAST = 1e-7
"""Smaller values are rounding, and counted as this."""
_NUMBER = re.compile(r"(?<![\w.])[-+]?\d+(?:\.\d+)?(?:e[-+]?\d+)?")
_LEFT_OUT = (
    "time_limit",
    "wall_time",
    "processor",
    "reading_time",
    "made",
    "version",
    "sha256",
    "hash",
    "settings",
    "seconds",
)


def flat(value: Any) -> Iterator[float | str]:
    """Numbers, names and the numbers in texts of a JSON value, in the order of its keys."""
    if isinstance(value, dict):
        for key in sorted(value):
            if not any(word in key for word in _LEFT_OUT):
                yield from flat(value[key])
    elif isinstance(value, list | tuple):
        for each in value:
            yield from flat(each)
    elif isinstance(value, str) and " " in value:
        yield from (rounded(float(number)) for number in _NUMBER.findall(value))
    elif isinstance(value, str | bool) or value is None:
        yield str(value)
    else:
        yield rounded(float(value))


def rounded(value: float) -> float | str:
    """To five digits; rounding errors as their bound."""
    if not math.isfinite(value):
        return str(value)
    return 0.0 if abs(value) < LEAST else float(f"{value:.{DIGITS}g}")


def size(values: np.ndarray) -> list[float]:
    """Three numbers that tell arrays apart: largest, mean, and a sum of alternating weights."""
    v = np.nan_to_num(np.asarray(values, dtype=np.float64).ravel())
    if not v.size:
        return [0.0]
    return [float(np.abs(v).max()), float(v.mean()), float(v @ np.cos(np.arange(v.size)))]


# --- comparisons

MOVED: dict[str, tuple[Callable[[], tb.Mechanism], dict[str, Any]]] = {
    "fixed": (tb.fixed, {"until": 1.6}),
    "bob between": (
        lambda: hanging_bob(angle_stop(1.0, 0.5)),
        {"until": 2.0, "stop_law": "unilateral"},
    ),
    "loop": (four_bar, {"until": 1.0}),
}


def compared(name: str, *engines: str, diagnose: bool = True) -> Any:
    """Results of wrong engines on a mechanism."""
    build, options = MOVED[name]
    with tempfile.TemporaryDirectory() as folder, pytest.MonkeyPatch.context() as patch:
        wrong_engines.announce(Path(folder))
        patch.syspath_prepend(folder)
        found = tb.compare(
            [build()], list(engines), ["assisted"], isolate=False, diagnose=diagnose, **options
        )
    return json.loads(found.results.to_json())


# --- diagnosis


@cache
def _sampled(name: str) -> tuple[Any, tb.Trajectory, tb.Trajectory]:
    """A solution, its motion at some times, and what an engine makes of it."""
    build, options = MOVED[name]
    law = tb.StopLaw(options.get("stop_law", "release-once"))
    solution = solve(tb.Problem(build(), duration=options["until"], stop_law=law))
    right = solution.trajectory(np.linspace(0.0, options["until"], 60))
    return solution, right, wrong_engines.late(right)


def readings(name: str) -> list[Any]:
    """Every mistake of reading: how far each quantity goes from the right one."""
    solution, right, recorded = _sampled(name)
    found: list[Any] = []
    for reading in all_readings(solution, right, recorded, 1e-3):
        for wrong in reading.wrong:
            found.append([reading.name.replace(" ", "-"), *_apart(wrong, right)])
        if reading.text is not None:
            factors = [0.1 * (k + 1) for k in range(len(reading.wrong))]
            found.append(reading.text(factors))
    return found


def _apart(wrong: tb.Trajectory, right: tb.Trajectory) -> list[float]:
    parts = [wrong.q - right.q, wrong.u - right.u, wrong.kinetic_energy - right.kinetic_energy]
    parts.append(wrong.potential_energy - right.potential_energy)
    for name, motion in right.markers.items():
        other = wrong.markers[name]
        parts += [other.position - motion.position, other.velocity - motion.velocity]
    parts += [wrong.stop_torques[n] - v for n, v in right.stop_torques.items()]
    parts += [wrong.joint_reactions[n] - v for n, v in right.joint_reactions.items()]
    return size(np.concatenate([np.asarray(part).ravel() for part in parts]))


def suspects(name: str) -> list[Any]:
    """Every mechanism that is wrong in one place, and by how much."""
    mechanism = MOVED[name][0]()
    right = list(_numbers(json.loads(mechanism.to_json())))
    found: list[Any] = []
    for suspect in machine_suspects(mechanism):
        found.append(
            [suspect.name.replace(" ", "-"), suspect.scale, *_changed(suspect.wrong, right)]
        )
    for fault in systematic_faults(mechanism):
        factors = [3.0 + k for k in range(len(fault.components))]
        equations = fault.equations(factors)
        wrong = [] if equations is None else _changed(equations.mechanism, right)
        found.append([fault.name.replace(" ", "-"), *wrong])
        found.append(f"sizes {fault.text(factors)}")
    return found


def _changed(wrong: tb.Mechanism, right: list[float]) -> list[float]:
    """How many numbers a wrong mechanism has, and how far they are from the right ones."""
    numbers = list(_numbers(json.loads(wrong.to_json())))
    apart = [b - a for a, b in zip(right, numbers, strict=False)]
    return [len(numbers), *size(np.array(apart) * 1e3)]


def _numbers(value: Any) -> Iterator[float]:
    yield from (each for each in flat_exactly(value) if isinstance(each, float))


def flat_exactly(value: Any) -> Iterator[float]:
    """All numbers of a JSON value."""
    if isinstance(value, dict):
        value = list(value.values())
    if isinstance(value, list):
        for each in value:
            yield from flat_exactly(each)
    elif isinstance(value, int | float) and not isinstance(value, bool):
        yield float(value)


# --- files and conformance


def judged(spoil: str, name: str, suffix: str) -> Any:
    """The judgement of a file with a fault."""
    build, options = MOVED[name]
    law = options.get("stop_law", "release-once")
    motion = tb.engine("reference", timestep=5e-3).simulate(
        tb.Problem(build(), duration=options["until"], stop_law=tb.StopLaw(law))
    )
    wrong = wrong_engines.SPOILS[spoil](motion) if spoil else motion
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / f"file{suffix}"
        if suffix == ".nc":
            save(wrong, path)
        else:
            _write_csv(path, wrong)
        study = Study([build()], ["reference"], until=options["until"] - 0.1, stop_law=law)
        return json.loads(judge_file(path, study).to_json())


def _write_csv(path: Path, motion: tb.Trajectory) -> None:
    """Angles in degrees and places in millimetres, by their headings."""
    frame = motion.to_dataframe()
    columns = [f"q {name}" for name in motion.mechanism.coordinates]
    columns += [c for c in frame.columns if c.endswith((" x", " y")) and c[:5] not in ("joint",)]
    factors = [180 / math.pi if c.startswith("q ") else 1e3 for c in columns]
    heads = ",".join(f"{c} [{'deg' if c.startswith('q ') else 'mm'}]" for c in columns)
    chosen = frame[columns] * factors
    path.write_text(f"t [s],{heads}\n{chosen.to_csv(header=False)}")


def conformance(engine: str, *problems: str) -> list[Any]:
    """Every verdict of the suite on an engine, which is forgotten after it."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv(ANNOUNCED, "")
        suite = Suite(Target.of(engine), problems, isolate=False)
        return [json.loads(verdict.model_dump_json()) for verdict in suite.verdicts()]


# --- adapters

SHORT: dict[str, tuple[Callable[[], tb.Mechanism], float]] = {
    "fixed": (tb.fixed, 1.5),
    "rolling": (tb.rolling, 0.9),
    "hinged": (tb.hinged, 0.9),
    "floating-arm": (tb.floating_arm, 1.0),
    "stop and floor": (lambda: hanging_bob(angle_stop(1.0, 0.5), floor(1.9, 0.3)), 1.2),
    "tip on a wall": (lambda: slider_crank(stops=(angle_stop(1.5, 0.9, body="crank"),)), 0.6),
    "loop": (four_bar, 0.4),
    "redundant": (lambda: parallel_cranks(3), 0.4),
    "rods on a slot": (lambda: rods_on_a_slot(inertia=0.01, tip=(0.5, 0.2)), 0.4),
    "chain on a slot": (chain_on_a_slot, 0.4),
    "everything": (everything, 0.2),
}
"""Mechanisms and durations [s] for runs of a hundred steps or so."""
LAWS = {"stop and floor": "unilateral", "tip on a wall": "unilateral"}
BY_ROUNDING = {("exudyn", "default", "floating-arm")}
"""Motions that the rounding of NumPy's BLAS decides: by one kernel of OpenBLAS 932 steps, by
another one 942. The built model is the same."""


def runs_of(engine: str, preset: str) -> dict[str, Any]:
    """An engine's motion, forces and events of each mechanism, and its built model."""
    found: dict[str, Any] = {}
    for name, (build, duration) in SHORT.items():
        mechanism, law = build(), tb.StopLaw(LAWS.get(name, "release-once"))
        solver: Any = tb.engine(engine, preset, timestep=5e-3)
        try:
            moved = solver.simulate(tb.Problem(mechanism, duration=duration, stop_law=law))
            motion = [] if (engine, preset, name) in BY_ROUNDING else summary(moved)
            found[name] = [motion, inspected(solver, mechanism)]
        except tb.TrebucheckError as error:
            found[name] = type(error).__name__
    return found


def summary(moved: tb.Trajectory) -> list[Any]:
    """Sizes of all arrays of a trajectory, its last state and its events."""
    arrays = [moved.t, moved.q, moved.u, moved.kinetic_energy, moved.potential_energy]
    for motion in moved.markers.values():
        arrays += [motion.position, motion.velocity]
    for part in (moved.stop_torques, moved.joint_reactions, moved.joint_gaps):
        arrays += [part[name] for name in sorted(part)]
    impacts = [[time, dict(impulses)] for time, impulses in moved.impacts or ()]
    events = [dict(moved.release_times), impacts]
    return [len(moved.t), [size(array) for array in arrays], moved.q[-1].tolist(), events]


def inspected(solver: Any, mechanism: tb.Mechanism) -> list[Any]:
    """What an engine shows of the model that it has built."""
    if not hasattr(solver, "inspect"):
        return []
    shown = solver.inspect(mechanism, random_states(mechanism, n=5))
    found: list[Any] = [size(shown.start), size(shown.start_speeds), shown.total_mass]
    for dynamics in shown.dynamics:
        for field in fields(dynamics):
            value = getattr(dynamics, field.name)
            if isinstance(value, dict):
                found.append({key: size(np.asarray(each)) for key, each in value.items()})
            elif value is not None:
                found.append(size(np.asarray(value)))
    return found


# --- reference


def solutions() -> dict[str, Any]:
    """The reference's own motion of each mechanism."""
    found: dict[str, Any] = {}
    for name, (build, duration) in SHORT.items():
        law = tb.StopLaw(LAWS.get(name, "release-once"))
        solution = solve(tb.Problem(build(), duration=duration, stop_law=law))
        moved = solution.trajectory(np.linspace(0.0, duration, 40))
        undetermined = [sorted(solution.undetermined_joints), sorted(solution.undetermined_stops)]
        found[name] = [summary(moved), undetermined]
    return found


def redundant() -> dict[str, Any]:
    """Motions and forces in redundant coordinates."""
    found: dict[str, Any] = {}
    for name in ("fixed", "loop", "floating-arm", "rods on a slot"):
        build, duration = SHORT[name]
        other = solve_redundant(tb.Problem(build(), duration=min(duration, 1.3)))
        for part in (0.1, 0.6, 0.95):
            time = part * min(duration, 1.3)
            q, u = other.state(time)
            forces = {joint: list(force) for joint, force in other.joint_reactions(time).items()}
            found[f"{name} {part}"] = [q.tolist(), u.tolist(), forces]
        found[f"{name} releases"] = dict(other.release_times)
    return found


def thrown(name: str) -> Any:
    """A throw with drag and its best release."""
    build = {"rolling": tb.rolling, "catapult": tb.catapult}[name]
    return json.loads(perform(build(), {}, best=True).throw.model_dump_json())


def certificate() -> Any:
    """Figures of a pendulum that meets a stop."""
    found = certify(
        hanging_bob(angle_stop(1.0, 0.5)),
        duration=1.0,
        stop_law=tb.StopLaw.UNILATERAL,
        ladder=(1e-9, 1e-11),
    )
    # Those by Taylor series are made where heyoka is.
    of_scipy = [each for each in found.computations if "taylor" not in each.name]
    made = [[each.tolerance * 1e12, each.independent] for each in of_scipy]
    return [made, [[figure.value, figure.name, figure.at] for figure in found.figures]]


CASES: dict[str, Callable[[], Any]] = {
    "reference-motions": solutions,
    "reference-redundant": redundant,
    "reference-throw-rolling": partial(thrown, "rolling"),
    "reference-throw-catapult": partial(thrown, "catapult"),
    "reference-certificate": certificate,
    **{
        f"runs-{engine}-{preset}": partial(runs_of, engine, preset)
        for engine in ("mujoco", "pymunk", "exudyn")
        for preset in ("assisted", "default")
    },
    **{
        f"runs-{engine}-models": partial(recorded_engines.models, engine, inspected)
        for engine in ("mujoco", "pymunk", "exudyn", "reference")
    },
    **{
        f"runs-{engine}-events": partial(recorded_engines.motions, engine, summary)
        for engine in ("mujoco", "pymunk", "exudyn")
    },
    **{
        f"runs-{engine}-options": partial(recorded_engines.variants, engine, summary)
        for engine in ("mujoco", "pymunk", "exudyn")
    },
    **{
        f"runs-{engine}-studies": partial(recorded_engines.studied, engine)
        for engine in ("mujoco", "pymunk", "exudyn", "reference")
    },
    "compare-fixed": lambda: compared("fixed", "heavy", "torque-sign"),
    "compare-bouncing": lambda: compared("bob between", "earth-gravity", "releases-early"),
    "compare-loop": lambda: compared("loop", "late", "half-energy"),
    "readings-fixed": lambda: readings("fixed"),
    "readings-loop": lambda: readings("loop"),
    "suspects-fixed": lambda: suspects("fixed"),
    "suspects-loop": lambda: suspects("loop"),
    "suspects-bouncing": lambda: suspects("bob between"),
    "judge-csv": lambda: judged("half_energy", "loop", ".csv"),
    "judge-netcdf": lambda: judged("", "bob between", ".nc"),
    "judge-releases": lambda: judged("releases_early", "fixed", ".nc"),
    "conformance-degrees": lambda: conformance("wrong_engines:Wrong_degrees", "incline"),
    "conformance-full": lambda: conformance("dummy_engines:Full", "bead", "catapult"),
    **recorded_judging.CASES,
    **recorded_models.CASES,
    **recorded_reference.CASES,
}


def values(name: str) -> list[float | str]:
    """Values of a case of today."""
    return list(flat(CASES[name]()))


def recorded(name: str) -> list[float | str]:
    """Recorded values of a case."""
    return json.loads(FOLDER.joinpath(f"{name}.json").read_text())


if __name__ == "__main__":
    FOLDER.mkdir(exist_ok=True)
    for name in sys.argv[1:] or CASES:
        found = values(name)
        FOLDER.joinpath(f"{name}.json").write_text(json.dumps(found, separators=(",", ":")) + "\n")
        print(f"{name}: {len(found)} values")
