"""Causes of a failed model-equivalence check, from what differs in the built model."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from dataclasses import replace

import numpy as np

from ...engines.inspection import Dynamics, Inspectable, Inspection, State
from ...engines.protocol import Engine
from ...models.arrays import FloatArray
from ...models.mechanism import Mechanism
from ...reference.equations import Equations
from ...reference.integrator import one_thread
from ..equivalence.checks import (
    EXACT,
    Expected,
    check_model,
    expected,
    gap_errors,
    scaled_differences,
)
from ..equivalence.states import random_states
from ..runs.results import Cause, Diagnosis, Equality
from .hypotheses import Hypothesis, armatures, gross_faults, hypotheses, of_suspects
from .ranking import ranked
from .search import Found, better
from .signatures import fit, match
from .suspects import Kind, machine_suspects, wall_suspects

_TELLING = 0.05  # of a deviation: what accounts for less is no suspect
_ALIKE = 1e-6  # relative, or [rad]: of a value that was mistaken for another
_READ_OFF = (
    0.992  # weight of a cause that one quantity shows, against one that explains all of them
)
_NO_TORQUE = 0.97  # the same of a stop that carries none: it may be at another position
_CORRECTIONS = 6  # of a size, by Gauss and Newton
_PARTS = (1.0, 0.5, 0.25, 0.1, 0.01)  # of a correction that leads to a size that makes no sense
_FITS = 0.99999  # share from which on a size need not be corrected any more
_GAIN = 0.003  # in share: corrections that gain less are at an end
_HOPELESS = 0.2  # share to first order, below which a size is not corrected


def check_and_diagnose(engine: Engine, mechanism: Mechanism) -> tuple[Equality, Diagnosis | None]:
    """The model-equivalence check, and the suspected causes where it fails.

    Raises:
        TrebucheckError: the engine is not here, or cannot build the mechanism.
    """
    equality = check_model(engine, mechanism)
    return equality, None if equality.holds else diagnose_model(engine, mechanism, equality)


@one_thread()
def diagnose_model(engine: Engine, mechanism: Mechanism, broken: Equality) -> Diagnosis:
    """What may have been built wrong, the most likely first."""
    worst = max(
        broken.broken,
        key=lambda check: math.inf if check.value is None else check.value / check.tolerance,
    )
    causes: list[Cause] = []
    if isinstance(engine, Inspectable):
        states = random_states(mechanism)
        if broken.states:
            inspection = engine.inspect(mechanism, states)
            causes = [
                part
                for read in (_plain, _walls, _fitted)
                for part in read(mechanism, states, inspection)
            ]
        else:
            causes = list(_unknown_stops(engine, mechanism, states))
    listed, likeliest = ranked(causes)
    return Diagnosis(leads=worst.label, causes=listed, likeliest=likeliest)


def _unknown_stops(
    engine: Inspectable, mechanism: Mechanism, states: Sequence[State]
) -> Iterator[Cause]:
    """Stops that the model lacks: without them it can be inspected."""
    for stop in mechanism.stops:
        without = [state for state in states if stop.name not in state.closed]
        if len(without) < len(states):
            with suppress(
                Exception
            ):  # the engine may raise anything: then this stop is not the only cause
                engine.inspect(mechanism, without)
                yield Cause(name=f"{stop.name} missing", kind="law", explained=1.0)


def _plain(
    mechanism: Mechanism, states: Sequence[State], inspection: Inspection
) -> Iterator[Cause]:
    """Causes that single quantities show: a wrong start, a stop at a wrong position, a missing stop."""
    for i, (name, value, right) in enumerate(
        zip(mechanism.coordinates, inspection.start, mechanism.start, strict=True)
    ):
        if abs(value - right) > EXACT * max(1.0, abs(right)):
            mistake = _mistaken(float(value), right)
            amount = mistake or _difference(
                float(value) - right, "rad" if i < len(mechanism.angles) else "m"
            )
            yield Cause(
                name=f"start of {name}",
                kind="start",
                amount=amount,
                explained=1.0 if mistake else _READ_OFF,
            )
    for name, gap in gap_errors(expected(mechanism, states), inspection.dynamics).items():
        if abs(gap) > EXACT and mechanism.stop(name).effort == "torque":
            amount = f"{math.degrees(gap):+.3g} deg" if abs(gap) < math.pi else ""
            yield Cause(
                name=f"place of the {name}", kind="machine", amount=amount, explained=_READ_OFF
            )
    for stop in mechanism.stops:
        pairs = zip(inspection.dynamics, states, strict=True)
        held = [d.stop_torques.get(stop.name) for d, state in pairs if stop.name in state.closed]
        if held and not any(held):
            # A stop at another position carries no torque either: its position is then the more
            # likely cause.
            yield Cause(name=f"{stop.name} missing", kind="law", explained=_NO_TORQUE)


def _difference(value: float, unit: str) -> str:
    """As text, unless it is an angle of more than a turn, whose size says nothing."""
    return "" if unit == "rad" and abs(value) > 2 * math.pi else f"{value:+.3g} {unit}"


def _walls(
    mechanism: Mechanism, states: Sequence[State], inspection: Inspection
) -> Iterator[Cause]:
    """Walls at wrong positions, by the gaps alone: no other quantity may show a point that is off its wall."""
    right = expected(mechanism, states)
    deviation = _gaps(right, inspection.dynamics, inspection.dynamics)
    if np.abs(deviation).max(initial=0.0) <= EXACT:
        return

    def signature(equations: Equations) -> FloatArray:
        gaps = expected(equations.mechanism, states, equations).gaps
        faulty = [
            replace(dynamics, stop_gaps=wrong)
            for dynamics, wrong in zip(inspection.dynamics, gaps, strict=True)
        ]
        return _gaps(right, faulty, inspection.dynamics)[None]

    for suspect in wall_suspects(mechanism):
        found = _measured(of_suspects(mechanism, suspect.name, [suspect]), deviation, signature)
        if found is not None:
            yield found.cause.model_copy(update={"explained": _READ_OFF * found.explained})


def _mistaken(angle: float, right: float) -> str:
    """The common mistake that turns one angle into another; '' if there is none."""
    size = max(1.0, abs(right))
    degrees, radians = math.degrees(right), math.radians(right)
    readings = {"sign": -right, "degrees for radians": degrees, "radians for degrees": radians}
    return next(
        (what for what, value in readings.items() if abs(angle - value) <= _ALIKE * size), ""
    )


def _fitted(
    mechanism: Mechanism, states: Sequence[State], inspection: Inspection
) -> Iterator[Cause]:
    """Suspects whose mechanisms differ from the right one in the same way, start and stops included."""
    right = expected(mechanism, states)
    gaps = _gaps(right, inspection.dynamics, inspection.dynamics)
    start = inspection.start - np.array(mechanism.start)
    deviation = np.concatenate([scaled_differences(right, inspection.dynamics), start, gaps])
    if not np.isfinite(deviation).all() or not deviation.any():
        return

    def signatures(equations: Equations) -> FloatArray:
        return np.array(list(_signatures(mechanism, right, equations, states, inspection)))

    found: dict[str, Found] = {}
    for hypothesis in (*hypotheses(mechanism, closing=False), *armatures(mechanism)):
        result, group = _measured(hypothesis, deviation, signatures), hypothesis.group
        if result is not None:
            found[group] = better(found[group], result) if group in found else result
    yield from (each.cause for each in found.values())
    for name, kind, equations in _gross(mechanism):
        shares = [
            match(deviation, signature, fixed=True).explained for signature in signatures(equations)
        ]
        yield Cause(name=name, kind=kind, explained=max(shares, default=0.0))


def _gross(mechanism: Mechanism) -> Iterator[tuple[str, Kind, Equations]]:
    """Faults without a size."""
    for suspect in machine_suspects(mechanism):
        if suspect.scale == 0:
            yield suspect.name, suspect.kind, Equations(suspect.wrong)
    for name, equations in gross_faults(mechanism):
        yield name, "law", equations


def _measured(
    hypothesis: Hypothesis, deviation: FloatArray, signatures: Callable[[Equations], FloatArray]
) -> Found | None:
    """A hypothesis of the size that fits, with the share that it accounts for at that size; None if it does not fit.

    Args:
        hypothesis: with a size of one number or several.
        deviation: flat.
        signatures: of equations, as it may show in different engines, shape (n_ways, n).
    """
    zero = np.zeros(len(hypothesis.components))
    columns = _columns(hypothesis, zero, signatures)
    fits = (
        []
        if columns is None
        else [fit(deviation, columns[:, way]) for way in range(columns.shape[1])]
    )
    way = max(range(len(fits)), key=lambda k: fits[k][1], default=-1)
    if columns is None or way < 0 or fits[way][1] <= _TELLING:
        return None
    best, factors, step = None, zero, fits[way][0]
    for _ in range(_CORRECTIONS if fits[way][1] > _HOPELESS else 1):
        factors = _sensible(hypothesis, factors, step)
        equations = None if factors is None else hypothesis.equations(factors.tolist())
        if factors is None or equations is None:
            break
        signature = signatures(equations)[way]
        share = match(deviation, signature, fixed=True).explained
        gained = share - best.explained if best else 1.0
        if gained > 0:
            best = Found(hypothesis, factors, share)
        tangents = (
            None if share > _FITS or gained < _GAIN else _columns(hypothesis, factors, signatures)
        )
        if tangents is None:
            break
        step = fit(deviation - signature, tangents[:, way])[0]
    return best


def _columns(
    hypothesis: Hypothesis, factors: FloatArray, signatures: Callable[[Equations], FloatArray]
) -> FloatArray | None:
    """Change of the signatures with each component, shape (n_components, n_ways, n); None where there is none."""
    units = np.eye(len(factors))
    made = [hypothesis.make(each.tolist()) for each in (factors, *(factors + units))]
    if any(equations is None for equations in made):
        return None
    here, *there = [signatures(equations) for equations in made if equations is not None]
    return np.array([ahead - here for ahead in there])


def _sensible(hypothesis: Hypothesis, factors: FloatArray, step: FloatArray) -> FloatArray | None:
    """The factors after the step, or after so small a part of it that the size makes sense; None where none does."""
    for part in _PARTS:
        if hypothesis.equations((factors + part * step).tolist()) is not None:
            return factors + part * step
    return None


def _signatures(
    mechanism: Mechanism,
    right: Expected,
    equations: Equations,
    states: Sequence[State],
    inspection: Inspection,
) -> Iterator[FloatArray]:
    """Signatures of wrong equations, in an engine with absolute coordinates and in one that counts from its start.

    The latter's coordinates are off by the error of its start. And a stop at a wrong position need
    not have moved the start with it.
    """
    wrong = equations.mechanism
    if {stop.name for stop in wrong.stops} < {stop.name for stop in mechanism.stops}:
        return  # a missing stop: see _plain
    start = np.array(wrong.start) - np.array(mechanism.start)

    def shown(shift: FloatArray) -> tuple[FloatArray, FloatArray]:
        exposed = expected(
            wrong, [replace(state, q=state.q + shift) for state in states], equations
        )
        values = exposed.as_dynamics(inspection.dynamics)
        return scaled_differences(right, values), _gaps(right, values, inspection.dynamics)

    here = shown(0.0 * start)
    moved = shown(start) if start.any() else here
    for (differences, gaps), start_error in ((here, start), (moved, start), (here, 0.0 * start)):
        yield np.concatenate([differences, start_error, gaps])


def _gaps(right: Expected, dynamics: Sequence[Dynamics], like: Sequence[Dynamics]) -> FloatArray:
    """Errors of the stops' gaps [rad or m] where an engine exposes them; all states together count as one."""
    errors = [
        engine_values.stop_gaps[name] - reference_gaps[name]
        for engine_values, reference_gaps, exposed in zip(dynamics, right.gaps, like, strict=True)
        for name in exposed.stop_gaps
    ]
    return np.array(errors) / math.sqrt(len(right.gaps))
