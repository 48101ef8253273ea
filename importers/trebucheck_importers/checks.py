"""An importer on one model, quantity by quantity."""

from __future__ import annotations

import math
import tempfile
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any, Literal

import numpy as np
from trebucheck.api.mechanics import FloatArray, InputError, SimulationError

from . import tolerances
from .expected import Expected, Motion
from .process import ImporterProcess
from .results import Check, FileResult, ModelResult, Quantity, VariantResult, Verdict

_FAR = 1e6  # a limit beyond this is none
_LONGEST_TEXT = 4000


@dataclass(frozen=True)
class Loaded:
    """A model loaded by an importer, asked and answering in the order of the file's joints."""

    process: ImporterProcess
    offers: frozenset[str]
    order: list[int]
    """Index of each joint of the file in the importer's order."""
    lacks: frozenset[str]
    precision: Literal["float64", "float32"]

    def vector(self, name: str, *states: FloatArray, more: Sequence[object] = ()) -> Any:
        """Result of a method for states that are sent in the importer's order."""
        back = np.argsort(self.order)
        return self.process.call(name, *(state[back] for state in states), *more)

    def ordered(self, values: Any, dimensions: int) -> FloatArray:
        """An answer of that many dimensions in the order of the file, along its last one.

        Raises:
            SimulationError: it has another shape.
        """
        array = np.asarray(values, dtype=np.float64)
        if array.ndim != dimensions or array.shape[-1] != len(self.order):
            raise SimulationError(
                f"its answer has the shape {array.shape}; {len(self.order)} joints are needed."
            )
        return array[..., self.order]


def check_model(
    process: ImporterProcess, expected: Expected, timestep: float
) -> tuple[ModelResult, Mapping[str, Any]]:
    """Quantities of a model, and what the importer says of itself.

    Where it refuses or misreads the model's file it is given the variants of it, until one is
    right.

    Raises:
        InputError: the importer cannot be started.
    """
    facts: dict[str, Any] = {}
    own = _check_file(process, expected, timestep, facts)
    tried: list[VariantResult] = []
    for name, variant in expected.of_variants() if own.fault else ():
        found = _check_file(process, variant, timestep, facts)
        tried.append(VariantResult(variant=name, checks=found.checks, printed=found.printed))
        if found.fault is None:
            break
    return ModelResult(
        model=expected.name,
        feature=expected.feature,
        checks=own.checks,
        printed=own.printed,
        variants=tuple(tried),
    ), facts


def _check_file(
    process: ImporterProcess, expected: Expected, timestep: float, facts: dict[str, Any]
) -> FileResult:
    process.printed.clear()
    checks = tuple(_checks(process, expected, timestep, facts))
    printed = "\n".join(dict.fromkeys("".join(process.printed).splitlines()))
    return FileResult(checks=checks, printed=printed[:_LONGEST_TEXT])


def _checks(
    process: ImporterProcess, expected: Expected, timestep: float, facts: dict[str, Any]
) -> Iterator[Check]:
    with tempfile.TemporaryDirectory() as folder:
        path = expected.path or Path(folder) / f"{expected.name}.xml"
        if expected.path is None:
            path.write_text(expected.xml)
        try:
            facts |= process.call("load", str(path))
        except SimulationError as error:
            yield Check(quantity="loads", verdict=Verdict.FAILED, text=str(error))
            return
        yield Check(quantity="loads", verdict=Verdict.RIGHT)
        joints = list(map(str, facts.get("joints", ())))
        if sorted(joints) != sorted(expected.joints):
            text = f"expected {', '.join(expected.joints)}; found {', '.join(joints) or 'none'}"
            yield Check(quantity="joints", verdict=Verdict.WRONG, text=text)
            return
        yield Check(quantity="joints", verdict=Verdict.RIGHT)
        order = [joints.index(name) for name in expected.joints]
        yield from _of_loaded(_loaded(process, facts, order), expected, timestep)


def _loaded(process: ImporterProcess, facts: Mapping[str, Any], order: list[int]) -> Loaded:
    precision = facts.get("precision", "float64")
    if precision not in tolerances.ROUNDING:
        raise InputError(
            f"the importer's precision {str(precision)[:60]!r} must be 'float64' or 'float32'."
        )
    offers, lacks = frozenset(facts["offers"]), frozenset(map(str, facts.get("lacks", ())))
    return Loaded(process, offers, order, lacks, precision)


def _of_loaded(loaded: Loaded, expected: Expected, timestep: float) -> Iterator[Check]:
    checks: tuple[tuple[Quantity, str, Callable[[Loaded, Expected], Check]], ...] = (
        ("total mass", "total_mass", _total_mass),
        ("mass matrix", "mass_matrix", _mass_matrix),
        ("accelerations", "acceleration", _accelerations),
        ("ranges", "limits", _ranges),
        ("start", "start", _start),
        ("free motion", "simulate", partial(_free_motion, timestep=timestep)),
    )
    unasked = {
        *(["total mass"] if expected.total_mass is None else []),
        *([] if expected.limits else ["ranges"]),
        *(["start"] if expected.start is None else []),
    }
    for quantity, method, check in checks:
        if quantity in unasked:
            continue
        missing = loaded.lacks & (
            {*expected.needs} & {"loops"} if method in ("acceleration", "simulate") else set()
        )
        if method not in loaded.offers or missing:
            yield Check(
                quantity=quantity,
                verdict=Verdict.NOT_OFFERED,
                text=f"no {', '.join(missing) or method}",
            )
            continue
        yield _tried(quantity, partial(check, loaded, expected))
    if expected.has_events:
        yield from _with_events(loaded, expected, timestep)


def _tried(quantity: Quantity, run: Callable[[], Check]) -> Check:
    """A check, or the importer's failure to answer."""
    try:
        return run()
    except SimulationError as error:
        none = str(error).startswith("NotImplementedError")
        return Check(
            quantity=quantity,
            verdict=Verdict.NOT_OFFERED if none else Verdict.FAILED,
            text=str(error),
        )
    except (
        TypeError,
        ValueError,
        KeyError,
    ) as error:  # an answer that is no number, or of another shape
        return Check(
            quantity=quantity, verdict=Verdict.FAILED, text=f"its answer cannot be read: {error}"
        )


def _compared(
    quantity: Quantity,
    expected: FloatArray,
    found: FloatArray,
    allowed: FloatArray,
    where: Sequence[str],
) -> Check:
    """The element that is farthest beyond what is allowed, all flat, with a name for each."""
    wanted, got, limit = (
        np.broadcast_to(each, expected.shape).ravel() for each in (expected, found, allowed)
    )
    if not np.isfinite(got).all():
        return Check(quantity=quantity, verdict=Verdict.WRONG, text="it is not finite")
    worst = int(np.argmax(abs(got - wanted) / limit))
    error = float(abs(got - wanted)[worst])
    return Check(
        quantity=quantity,
        verdict=Verdict.RIGHT if error <= limit[worst] else Verdict.WRONG,
        error=error,
        tolerance=float(limit[worst]),
        text=f"{where[worst]}: expected {wanted[worst]:.9g}, found {got[worst]:.9g}",
    )


def _total_mass(loaded: Loaded, expected: Expected) -> Check:
    assert expected.total_mass is not None
    found = np.array([float(loaded.process.call("total_mass"))])
    wanted = np.array([expected.total_mass])
    return _compared(
        "total mass",
        wanted,
        found,
        tolerances.ROUNDING[loaded.precision] * wanted,
        ["all bodies [kg]"],
    )


def _states(expected: Expected, *rows: str) -> list[str]:
    at = [
        f"q = {np.round(q, 6).tolist()}, u = {np.round(u, 6).tolist()}" for q, u in expected.states
    ]
    return [f"{row} at {state}" for state in at for row in rows]


def _mass_matrix(loaded: Loaded, expected: Expected) -> Check:
    found = [
        loaded.ordered(loaded.vector("mass_matrix", q), 2)[loaded.order] for q, _ in expected.states
    ]
    diagonal = np.sqrt(np.diagonal(expected.mass_matrices, axis1=1, axis2=2))
    allowed = tolerances.ROUNDING[loaded.precision] * diagonal[:, :, None] * diagonal[:, None, :]
    names = [f"({one}, {other})" for one in expected.joints for other in expected.joints]
    return _compared(
        "mass matrix", expected.mass_matrices, np.array(found), allowed, _states(expected, *names)
    )


def _accelerations(loaded: Loaded, expected: Expected) -> Check:
    found = np.array(
        [loaded.ordered(loaded.vector("acceleration", q, u), 1) for q, u in expected.states]
    )
    relative = tolerances.ROUNDING[loaded.precision] + (
        tolerances.SOFTNESS if "loops" in expected.needs else 0.0
    )
    allowed = relative * np.maximum(1.0, abs(expected.accelerations).max(axis=1, keepdims=True))
    rows = _states(expected, *expected.joints)
    check = _compared("accelerations", expected.accelerations, found, allowed, rows)
    rounded = tolerances.ROUNDINGS * float(np.finfo(loaded.precision).eps) * expected.rounding
    loose = _compared("accelerations", expected.accelerations, found, allowed + rounded, rows)
    if check.verdict == Verdict.WRONG and loose.verdict == Verdict.RIGHT:
        why = f"{loose.text}; positions in {loaded.precision} leave a loop open by so much"
        return loose.model_copy(update={"verdict": Verdict.UNDECIDED, "text": why})
    return check


def _ranges(loaded: Loaded, expected: Expected) -> Check:
    answer = loaded.process.call("limits")
    wanted = np.array([np.clip(ends, -_FAR, _FAR) for ends in expected.limits.values()])
    found = np.array(
        [
            np.clip(answer.get(joint, (-math.inf, math.inf)), -_FAR, _FAR)
            for joint in expected.limits
        ]
    )
    names = [f"{end} end of {joint}" for joint in expected.limits for end in ("lower", "upper")]
    allowed = tolerances.ROUNDING[loaded.precision] * np.maximum(1.0, abs(wanted))
    return _compared("ranges", wanted, found, allowed, names)


def _start(loaded: Loaded, expected: Expected) -> Check:
    assert expected.start is not None
    found = np.array([loaded.ordered(values, 1) for values in loaded.process.call("start")])
    wanted = np.array(expected.start)[: len(found)]
    allowed = tolerances.ROUNDING[loaded.precision] * np.maximum(1.0, abs(wanted))
    names = [f"{what} of {joint}" for what in ("position", "speed") for joint in expected.joints]
    return _compared("start", wanted, found, allowed, names)


@dataclass(frozen=True)
class _Run:
    positions: FloatArray
    steps: int
    """Steps in each interval of the samples."""
    step: float
    """[s]"""
    forces: FloatArray | None


_Judge = Callable[[_Run, _Run], Check]


def _decided(loaded: Loaded, motion: Motion, timestep: float, judge: _Judge) -> tuple[Check, _Run]:
    """Verdict on the finer of two runs, and that run; steps are halved while it is undecided.

    Raises:
        SimulationError: there are not even two runs.
    """
    steps = math.ceil(motion.interval / timestep * (1 - 1e-9))
    coarse, fine = _run(loaded, motion, steps), _run(loaded, motion, 2 * steps)
    check = judge(coarse, fine)
    for _ in range(tolerances.REFINEMENTS):
        if check.verdict != Verdict.UNDECIDED:
            break
        try:
            coarse, fine = fine, _run(loaded, motion, 2 * fine.steps)
        except SimulationError:  # it takes too long
            break
        check = judge(coarse, fine)
    return check, fine


def _run(loaded: Loaded, motion: Motion, steps: int) -> _Run:
    count = len(motion.positions) - 1
    answer = loaded.vector(
        "simulate", motion.positions[0], motion.speeds[0], more=(motion.interval, count, steps)
    )
    read = answer if isinstance(answer, dict) else {"q": answer}
    positions, forces = loaded.ordered(read["q"], 2), read.get("limit_force")
    if positions.shape != motion.positions.shape:
        raise SimulationError(
            f"its motion has {len(positions)} samples; {count + 1} are needed, the start among "
            "them."
        )
    return _Run(
        positions,
        steps,
        motion.interval / steps,
        None if forces is None else loaded.ordered(forces, 2),
    )


def _judged(
    coarse: _Run,
    fine: _Run,
    *,
    quantity: Quantity,
    expected: Expected,
    motion: Motion,
    precision: str,
) -> Check:
    """The finer of two runs beside the certified motion."""
    if not np.isfinite(fine.positions).all():
        return Check(quantity=quantity, verdict=Verdict.WRONG, text="it is not finite")
    more = tolerances.of_impact(expected, fine.step) + tolerances.of_rebound(expected)
    more = more if expected.pressing and motion is expected.whole else 0.0
    steps = len(motion.positions) * fine.steps
    allowed = more + tolerances.of_motion(
        expected, motion, coarse.positions, fine.positions, steps, precision
    )
    moved = float(abs(motion.positions - motion.positions[0]).max())
    times = np.arange(len(motion.positions)) * motion.interval
    names = [
        f"{joint} after {t:.4g} s, step {fine.step:.3g} s"
        for t in times
        for joint in expected.joints
    ]
    check = _compared(quantity, motion.positions, fine.positions, allowed[:, None], names)
    if check.verdict == Verdict.RIGHT and allowed[-1] > max(
        tolerances.TELLS_NOTHING * moved, 2 * more
    ):
        return check.model_copy(
            update={"verdict": Verdict.UNDECIDED, "tolerance": float(allowed[-1])}
        )
    return check


def _free_motion(loaded: Loaded, expected: Expected, timestep: float) -> Check:
    facts: dict[str, Any] = {
        "expected": expected,
        "motion": expected.free,
        "precision": loaded.precision,
    }
    return _decided(
        loaded, expected.free, timestep, partial(_judged, quantity="free motion", **facts)
    )[0]


def _with_events(loaded: Loaded, expected: Expected, timestep: float) -> Iterator[Check]:
    quantities: tuple[Quantity, ...] = ("limits kept", "motion with events", "force at rest")
    lacking = loaded.lacks & {*expected.needs}
    if "simulate" not in loaded.offers or lacking:
        for quantity in quantities if expected.limits else quantities[1:]:
            text = f"no {', '.join(sorted(lacking)) or 'simulate'}"
            yield Check(quantity=quantity, verdict=Verdict.NOT_OFFERED, text=text)
        return
    facts: dict[str, Any] = {
        "expected": expected,
        "motion": expected.whole,
        "precision": loaded.precision,
    }
    judge = partial(_judged, quantity="motion with events", **facts)
    try:
        check, run = _decided(loaded, expected.whole, timestep, judge)
    except SimulationError as error:
        yield Check(quantity="motion with events", verdict=Verdict.FAILED, text=str(error))
        return
    if expected.limits:
        yield _kept(expected, run)
    yield check
    if expected.pressing:
        yield _force_at_rest(expected, run)


def _kept(expected: Expected, run: _Run) -> Check:
    low, high = np.array(
        [expected.limits.get(joint, (-math.inf, math.inf)) for joint in expected.joints]
    ).T
    inside = np.clip(run.positions, low, high)
    allowed = np.full(inside.shape, tolerances.of_impact(expected, run.step))
    times = np.arange(len(inside)) * expected.whole.interval
    names = [
        f"{joint} after {t:.4g} s, step {run.step:.3g} s"
        for t in times
        for joint in expected.joints
    ]
    return _compared("limits kept", inside, run.positions, allowed, names)


def _force_at_rest(expected: Expected, run: _Run) -> Check:
    if run.forces is None:
        return Check(quantity="force at rest", verdict=Verdict.NOT_OFFERED, text="no limit_force")
    wanted = expected.resting_force
    allowed = np.full(wanted.shape, tolerances.REST_FORCE * float(abs(wanted).max()))
    return _compared(
        "force at rest",
        wanted,
        run.forces[-1],
        allowed,
        [f"{joint} at the end" for joint in expected.joints],
    )
