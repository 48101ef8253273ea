"""Causes of a failed model-equivalence check, from what differs in the built model."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Sequence
from contextlib import suppress
from dataclasses import replace

import numpy as np

from ...engines.inspection import Dynamics, Inspectable, Inspection, State
from ...engines.protocol import Engine
from ...models.arrays import FloatArray
from ...models.mechanism import Mechanism
from ...reference.equations import Equations
from ...reference.perturbed import WithJoint, WithoutCentrifugal
from ..equivalence.checks import EXACT, Expected, check_model, expected, gap_errors, random_states, scaled_differences
from ..runs.results import Cause, Diagnosis, Equality
from .ranking import ranked
from .signatures import Match, match
from .suspects import machine_suspects, wall_suspects

_SMALL = 1e-6  # of an added term, in its unit
_TELLING = 0.05  # of a deviation: what accounts for less is no suspect
_ALIKE = 1e-6  # relative, or [rad]: of a value that was mistaken for another
_READ_OFF = 0.9  # weight of a cause that one quantity shows, against one that explains all of them


def check_and_diagnose(engine: Engine, mechanism: Mechanism) -> tuple[Equality, Diagnosis | None]:
    """The model-equivalence check, and the suspected causes where it fails.

    Raises:
        TrebucheckError: the engine is not here, or cannot build the mechanism.
    """
    equality = check_model(engine, mechanism)
    return equality, None if equality.holds else diagnose_model(engine, mechanism, equality)


def diagnose_model(engine: Engine, mechanism: Mechanism, broken: Equality) -> Diagnosis:
    """What may have been built wrong, the most likely first."""
    worst = max(broken.broken, key=lambda check: math.inf if check.value is None else check.value / check.tolerance)
    causes: list[Cause] = []
    if isinstance(engine, Inspectable):
        states = random_states(mechanism)
        if broken.states:
            inspection = engine.inspect(mechanism, states)
            causes = [part for read in (_plain, _walls, _fitted) for part in read(mechanism, states, inspection)]
            causes = _once(causes)
        else:
            causes = list(_unknown_stops(engine, mechanism, states))
    listed, likeliest = ranked(causes)
    return Diagnosis(leads=worst.label, causes=listed, likeliest=likeliest)


def _once(causes: Sequence[Cause]) -> list[Cause]:
    """Each name once, with the cause that explains most."""
    best: dict[str, Cause] = {}
    for cause in causes:
        if cause.name not in best or cause.explained > best[cause.name].explained:
            best[cause.name] = cause
    return list(best.values())


def _unknown_stops(engine: Inspectable, mechanism: Mechanism, states: Sequence[State]) -> Iterator[Cause]:
    """Stops that the model lacks: without them it can be inspected."""
    for stop in mechanism.stops:
        without = [state for state in states if stop.name not in state.closed]
        if len(without) < len(states):
            with suppress(Exception):  # the engine may raise anything: then this stop is not the only cause
                engine.inspect(mechanism, without)
                yield Cause(name=f"{stop.name} missing", kind="law", explained=1.0)


def _plain(mechanism: Mechanism, states: Sequence[State], inspection: Inspection) -> Iterator[Cause]:
    """Causes that single quantities show: a wrong start, a stop at a wrong position, a missing stop."""
    for i, (name, value, right) in enumerate(
        zip(mechanism.coordinates, inspection.start, mechanism.start, strict=True)
    ):
        if abs(value - right) > EXACT * max(1.0, abs(right)):
            mistake = _mistaken(float(value), right)
            amount = mistake or f"{value - right:+.3g} {'rad' if i < len(mechanism.bodies) else 'm'}"
            yield Cause(name=f"start of {name}", kind="start", amount=amount, explained=1.0 if mistake else _READ_OFF)
    for name, gap in gap_errors(expected(mechanism, states), inspection.dynamics).items():
        if abs(gap) > EXACT and mechanism.stop(name).effort == "torque":
            amount = f"{math.degrees(gap):+.3g} deg"
            yield Cause(name=f"place of the {name}", kind="machine", amount=amount, explained=_READ_OFF)
    for stop in mechanism.stops:
        pairs = zip(inspection.dynamics, states, strict=True)
        held = [d.stop_torques.get(stop.name) for d, state in pairs if stop.name in state.closed]
        if held and not any(held):
            # A stop at another position carries no torque either: its position is then the more likely cause.
            yield Cause(name=f"{stop.name} missing", kind="law", explained=_READ_OFF / 2)


def _walls(mechanism: Mechanism, states: Sequence[State], inspection: Inspection) -> Iterator[Cause]:
    """Walls at wrong positions, by the gaps alone: no other quantity may show a point that is off its wall."""
    right = expected(mechanism, states)
    deviation = _gaps(right, inspection.dynamics, inspection.dynamics)
    if np.abs(deviation).max(initial=0.0) <= EXACT:
        return
    for suspect in wall_suspects(mechanism):
        gaps = expected(suspect.wrong, states).gaps
        faulty = [replace(dynamics, stop_gaps=wrong) for dynamics, wrong in zip(inspection.dynamics, gaps, strict=True)]
        matched = match(deviation, _gaps(right, faulty, inspection.dynamics))
        if matched.explained > _TELLING:
            yield suspect.cause(matched.factor, _READ_OFF * matched.explained)


def _mistaken(angle: float, right: float) -> str:
    """The common mistake that turns one angle into another; '' if there is none."""
    size = max(1.0, abs(right))
    degrees, radians = math.degrees(right), math.radians(right)
    readings = {"sign": -right, "degrees for radians": degrees, "radians for degrees": radians}
    return next((what for what, value in readings.items() if abs(angle - value) <= _ALIKE * size), "")


def _fitted(mechanism: Mechanism, states: Sequence[State], inspection: Inspection) -> Iterator[Cause]:
    """Suspects whose mechanisms differ from the right one in the same way, start and stops included."""
    right = expected(mechanism, states)
    gaps = _gaps(right, inspection.dynamics, inspection.dynamics)
    start = inspection.start - np.array(mechanism.start)
    deviation = np.concatenate([scaled_differences(right, inspection.dynamics), start, gaps])
    if not np.isfinite(deviation).all() or not deviation.any():
        return
    for suspect in machine_suspects(mechanism):
        matched = _best(
            match(deviation, signature, fixed=suspect.scale == 0)
            for signature in _signatures(mechanism, right, suspect.wrong, states, inspection)
        )
        if matched.explained > _TELLING:
            yield suspect.cause(matched.factor, matched.explained)
    nothing = np.zeros(len(start) + len(gaps))
    for name, unit, equations in _other_laws(mechanism):
        wrong = expected(mechanism, states, equations).as_dynamics(inspection.dynamics)
        matched = match(deviation, np.concatenate([scaled_differences(right, wrong), nothing]), fixed=not unit)
        if matched.explained > _TELLING:
            amount = f"{matched.factor * _SMALL:.3g} {unit}" if unit else ""
            yield Cause(name=name, kind="law", amount=amount, explained=matched.explained)


def _best(matches: Iterable[Match]) -> Match:
    return max(matches, key=lambda candidate: candidate.explained, default=Match(0.0, 0.0))


def _other_laws(mechanism: Mechanism) -> Iterator[tuple[str, str, Equations]]:
    """Equations with another term in them, or one less; name, unit of the term ('': not a matter of degree)."""
    yield "velocity-dependent forces dropped", "", WithoutCentrifugal(mechanism)
    for joint in mechanism.joints:
        yield f"damping of the {joint.name}", "N m s/rad", WithJoint(mechanism, joint.name, damping=_SMALL)
        yield f"armature of the {joint.name}", "kg m^2", WithJoint(mechanism, joint.name, armature=_SMALL)


def _signatures(
    mechanism: Mechanism,
    right: Expected,
    wrong: Mechanism,
    states: Sequence[State],
    inspection: Inspection,
) -> Iterator[FloatArray]:
    """Signatures of a wrong mechanism, in an engine with absolute coordinates and in one that counts from its start.

    The latter's coordinates are off by the error of its start. And a stop at a wrong position need not have moved the
    start with it.
    """
    if {stop.name for stop in wrong.stops} < {stop.name for stop in mechanism.stops}:
        return  # a missing stop: see _plain
    start = np.array(wrong.start) - np.array(mechanism.start)
    none = np.zeros_like(start)
    for shift, start_error in ((none, start), (start, start), (none, none)) if start.any() else ((none, none),):
        faulty = expected(wrong, [replace(state, q=state.q + shift) for state in states])
        exposed = faulty.as_dynamics(inspection.dynamics)
        exposed = [replace(dynamics, stop_gaps=gaps) for dynamics, gaps in zip(exposed, faulty.gaps, strict=True)]
        yield np.concatenate(
            [scaled_differences(right, exposed), start_error, _gaps(right, exposed, inspection.dynamics)]
        )


def _gaps(right: Expected, dynamics: Sequence[Dynamics], like: Sequence[Dynamics]) -> FloatArray:
    """Errors of the stops' gaps [rad or m] where an engine exposes them; all states together count as one."""
    errors = [
        engine_values.stop_gaps[name] - reference_gaps[name]
        for engine_values, reference_gaps, exposed in zip(dynamics, right.gaps, like, strict=True)
        for name in exposed.stop_gaps
    ]
    return np.array(errors) / math.sqrt(len(right.gaps))
