"""Motions from starts that are known to some bits: how far apart they are, proved from both sides.

A start of so many bits is a box: every value within its 2^-bits part. All motions from it are
enclosed at once; the radius of that enclosure bounds how far any is from one of them. Two motions
from corners of the box, enclosed one by one, show how far apart motions from it certainly come.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass
from fractions import Fraction

import numpy as np

from ...models.arrays import FloatArray
from ...models.errors import SimulationError
from ...models.kinematics import initial_state
from ...models.problem import Problem
from .balls import Ball, arb, exact, precision, rounded
from .motion import Limits, Phase, ProvedMotion, State
from .sets import BITS
from .steps import Step

# Remainders in parts of the start's radius. They are that small for shorter steps, over which
# derivatives change less: 40 bits lose a double pendulum's third digit at 1.79 s, 60 at 1.97 s.
_FINER = 60
_SPARE = 40  # bits of computation beside those of remainders
_BITS_PER_ORDER = 6  # of a remainder; steps are then 2^-6 of the radius of convergence
_LEAST_ORDER = 14
_OF_POINTS = 160  # bits of motions from one point, which lose them as they grow
_ORDER_PER_BIT = 1.1 * math.log10(2)  # of their polynomials
_TIMES = Fraction(1, 64)  # [s] between which motions from two points are compared

Progress = Callable[[float], None]


@dataclass(frozen=True)
class StartSpread:
    """Bounds of how far motions from a box of starts are from one of them."""

    times: FloatArray
    """[s] of the ends of steps, at which each bound's validity ends; rounded down, shape (n,)."""
    radii: FloatArray
    """Largest of all coordinates over the step, in parts of their sizes; shape (n,)."""
    ended: str
    """Why it ends there; empty: it has come to its end, or is wider than was asked for."""


class _WideError(Exception):
    """Motions are farther apart than is asked for."""


def box(problem: Problem, bits: int) -> State:
    """The least box of starts whose values are the problem's to so many bits."""
    q, u = initial_state(problem.mechanism)
    q_box, u_box = ([arb(float(x), abs(float(x)) * 2.0**-bits) for x in part] for part in (q, u))
    return q_box, u_box


def corner(problem: Problem, bits: int, signs: Sequence[float]) -> State:
    """A corner of that box; the signs are of coordinates, then of speeds."""
    state: list[Ball] = []
    for x, sign in zip(np.concatenate(initial_state(problem.mechanism)), signs, strict=True):
        state.append(arb(float(x)) * (1 + math.copysign(1.0, sign) * arb(2) ** -bits))
    n_q = len(state) // 2
    return state[:n_q], state[n_q:]


def spread(
    problem: Problem,
    bits: int,
    until: Fraction | None,
    sizes: FloatArray,
    widest: float,
    limits: Limits,
    progress: Progress | None = None,
) -> StartSpread:
    """Enclose all motions from starts that are known to so many bits.

    Args:
        problem: whose start it is.
        bits: of each value of the start.
        until: end [s]; None: the launch, at most the problem's duration.
        sizes: of the coordinates, in parts of which the motions are apart [rad or m], (n_q,).
        widest: in parts of them; no more is enclosed once the motions may be farther apart.
        limits: of steps and time.
        progress: called with the time that is proved so far [s].
    """
    kept, n_q, ended = bits + _FINER, len(sizes), ""

    def watch(t: float) -> None:
        steps = motion.phases[-1].steps
        if steps and max(map(float, steps[-1].tube.apart[:n_q] / sizes)) > widest:
            raise _WideError
        if progress is not None:
            progress(t)

    order = max(_LEAST_ORDER, math.ceil(kept / _BITS_PER_ORDER))
    with precision(kept + _SPARE):
        motion = ProvedMotion(problem, order, kept, limits, watch, box(problem, bits))
        try:
            motion.run(until)
        except _WideError:
            pass
        except SimulationError as error:
            ended = str(error)
        launch, last = motion.launch, arb.pos_inf() if until is None else rounded(until)
        if until is None and launch is not None:
            last = launch.time
        bounds = _bounds(motion.phases, last.lower(), sizes)
    times, radii = (np.array([bound[i] for bound in bounds]) for i in (0, 1))
    return StartSpread(times, radii, ended)


def _bounds(phases: Sequence[Phase], last: Ball, sizes: FloatArray) -> list[tuple[float, float]]:
    """Ends of all steps [s], and bounds over each in parts of sizes.

    A phase begins at a time that differs from motion to motion, by the radius of its ball. So far
    is one motion's coordinate from another's by their speed times that; twice that near the
    beginning, where some are yet before the event.

    Args:
        phases: whose last step may go beyond the end.
        last: end of the motion [s].
        sizes: of the coordinates.
    """
    bounds, n_q = list[tuple[float, float]](), len(sizes)
    with precision(BITS):
        for k, phase in enumerate(phases):
            fastest = [arb(0)] * n_q
            over = phases[k + 1].start.lower() if k + 1 < len(phases) else last
            for step in phase.steps:
                speeds = [x.abs_upper() for x in step.tube.box[n_q:]]
                fastest = [a.max(b) for a, b in zip(fastest, speeds, strict=True)]
                end = (phase.start + exact(step.end)).lower().min(over)
                worst = 0.0
                for i, own in enumerate(_radii(step, n_q)):
                    bound = own + 2 * fastest[i] * phase.start.rad()
                    worst = max(worst, math.nextafter(float(bound.upper()), math.inf) / sizes[i])
                bounds.append((math.nextafter(float(end), -math.inf), worst))
    return bounds


def _radii(step: Step, n_q: int) -> list[Ball]:
    """Bounds of how far coordinates are from the polynomials' middles anywhere in a step."""
    length, bounds = exact(step.length), list[Ball]()
    for model, apart in zip(step.motion[:n_q], step.tube.apart, strict=False):
        total, power = apart, arb(1)
        for c in model.coefficients:
            total, power = total + c.rad() * power, power * length
        bounds.append((total + model.remainder.abs_upper() * power).upper())
    return bounds


@dataclass(frozen=True)
class Parting:
    """Distances that motions from two starts have at least."""

    times: FloatArray
    """[s], exact, shape (n,)."""
    distances: FloatArray
    """Largest of all coordinates, in parts of their sizes, rounded down; shape (n,)."""


def parting(
    problem: Problem,
    bits: int,
    signs: Sequence[float],
    until: Fraction,
    sizes: FloatArray,
    limits: Limits,
    progress: Progress | None = None,
) -> Parting:
    """Enclose the motions from two opposite corners of a box of starts, and their distance.

    Args:
        problem, bits, sizes, limits, progress: as of :func:`spread`.
        signs: of the corner, of coordinates and speeds.
        until: end [s].

    Returns:
        Distances as far as both are enclosed.
    """
    kept = bits + _OF_POINTS
    order, motions = math.ceil(_ORDER_PER_BIT * kept), list[ProvedMotion]()
    with precision(kept + _SPARE):
        for side in (1.0, -1.0):
            start = corner(problem, bits, [side * sign for sign in signs])
            motions.append(ProvedMotion(problem, order, kept, limits, progress, start))
            with suppress(SimulationError):
                motions[-1].run(until)
        times, distances = list[float](), list[float]()
        for k in range(1, math.floor(until / _TIMES) + 1):
            states = [_at(motion, k * _TIMES) for motion in motions]
            if any(state is None for state in states):
                continue  # within the radius of an event's time, or beyond the enclosure
            (a, _), (b, _) = (state for state in states if state is not None)
            least = 0.0
            for x, y, size in zip(a, b, sizes, strict=True):
                least = max(least, math.nextafter(float((x - y).abs_lower()), 0.0) / size)
            times.append(float(k * _TIMES))
            distances.append(least)
    return Parting(np.array(times), np.array(distances))


def _at(motion: ProvedMotion, t: Fraction) -> State | None:
    """The state at a time [s]; None: within the radius of an event's time, or not enclosed."""
    ball, phases = exact(t), motion.phases
    for k, phase in enumerate(phases):
        begun = k == 0 or ball > phase.start
        if begun and (k + 1 == len(phases) or ball < phases[k + 1].start):
            with suppress(ValueError):
                return phase.at(ball)
    return None
