"""Steps of an integrator that fit a deviation: what a fixed step of a known rule leaves out.

A rule of order p is off by d(y) h^(p + 1) after a step of h. To first order that is a rate d(y) h^p
that is added to the motion and grows along it as a small fault does (:func:`.fit.response`), so
that the fit's factor tells the step. With that step the rule is then carried out on the reference's
equations, in its coordinates and under the stops that it has closed; only what such a motion
explains is reported. Rules of one order differ little in what they do: the best of them is named.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import cache

import numpy as np
from scipy.interpolate import CubicHermiteSpline

from ...models.arrays import FloatArray
from ...models.errors import TrebucheckError
from ...models.kinematics import initial_state
from ...reference.solution import Segment
from ..runs.results import RankedCause
from .case import Case, factor_of, fit, share_of
from .fit import WINDOWS, first_part, response

_PARTS = {1: 0.02, 2: 0.05, 4: 0.5}  # of the reference's step: where a rule's error is measured
_WORTH = 0.5  # share to first order, below which a rule is not carried out
_ALIKE = 0.98  # of the best share to first order: of a rule that is carried out as well
_MOST_STEPS = 20_000  # that are carried out: a finer step's error is far below any tolerance
_PASSES, _SETTLED = 60, 1e-13  # of an implicit rule's equations, and when they are solved
_FITS = 0.99999  # share from which on no other rule is tried
_CORRECTIONS = 3  # of a step
_COARSE = 500  # samples, up to which the interval between them is tried as a step of each rule
_WHOLE = 0.15  # by which a fitted step may miss a whole part of the interval between samples

_Rate = Callable[[FloatArray, FloatArray], FloatArray]
_State = tuple[FloatArray, FloatArray]
_Step = Callable[[_Rate, float, FloatArray, FloatArray], _State]
"""Coordinates and speeds after a step of accelerations, of one state or of many, (..., n_q)."""


@dataclass(frozen=True)
class IntegrationRule:
    """A rule of steps of one length."""

    name: str
    order: int
    step: _Step


def _explicit_euler(f: _Rate, h: float, q: FloatArray, u: FloatArray) -> _State:
    return q + h * u, u + h * f(q, u)


def _semi_implicit_euler(f: _Rate, h: float, q: FloatArray, u: FloatArray) -> _State:
    u = u + h * f(q, u)
    return q + h * u, u


def _places_first(f: _Rate, h: float, q: FloatArray, u: FloatArray) -> _State:
    q = q + h * u
    return q, u + h * f(q, u)


def _implicit_euler(f: _Rate, h: float, q: FloatArray, u: FloatArray) -> _State:
    return _solved(lambda q1, u1: (q + h * u1, u + h * f(q1, u1)), q, u)


def _midpoint(f: _Rate, h: float, q: FloatArray, u: FloatArray) -> _State:
    v = u + 0.5 * h * f(q, u)
    return q + h * v, u + h * f(q + 0.5 * h * u, v)


def _heun(f: _Rate, h: float, q: FloatArray, u: FloatArray) -> _State:
    a = f(q, u)
    v = u + h * a
    return q + 0.5 * h * (u + v), u + 0.5 * h * (a + f(q + h * u, v))


def _leapfrog(f: _Rate, h: float, q: FloatArray, u: FloatArray) -> _State:
    a = f(q, u)
    q = q + h * (u + 0.5 * h * a)
    return q, u + 0.5 * h * (a + f(q, u + h * a))


def _leapfrog_of_old_speeds(f: _Rate, h: float, q: FloatArray, u: FloatArray) -> _State:
    a = f(q, u)
    q = q + h * (u + 0.5 * h * a)
    return q, u + 0.5 * h * (a + f(q, u))


def _kick_drift_kick(f: _Rate, h: float, q: FloatArray, u: FloatArray) -> _State:
    v = u + 0.5 * h * f(q, u)
    q = q + h * v
    return q, v + 0.5 * h * f(q, v)


def _drift_kick_drift(f: _Rate, h: float, q: FloatArray, u: FloatArray) -> _State:
    q = q + 0.5 * h * u
    u = u + h * f(q, u)
    return q + 0.5 * h * u, u


def _trapezoidal_rule(f: _Rate, h: float, q: FloatArray, u: FloatArray) -> _State:
    a = f(q, u)
    return _solved(lambda q1, u1: (q + 0.5 * h * (u + u1), u + 0.5 * h * (a + f(q1, u1))), q, u)


def _implicit_midpoint(f: _Rate, h: float, q: FloatArray, u: FloatArray) -> _State:
    return _solved(
        lambda q1, u1: (q + 0.5 * h * (u + u1), u + h * f(0.5 * (q + q1), 0.5 * (u + u1))), q, u
    )


def _runge_kutta(f: _Rate, h: float, q: FloatArray, u: FloatArray) -> _State:
    a1 = f(q, u)
    u2, a2 = u + 0.5 * h * a1, f(q + 0.5 * h * u, u + 0.5 * h * a1)
    u3, a3 = u + 0.5 * h * a2, f(q + 0.5 * h * u2, u + 0.5 * h * a2)
    u4, a4 = u + h * a3, f(q + h * u3, u + h * a3)
    return q + h / 6 * (u + 2 * u2 + 2 * u3 + u4), u + h / 6 * (a1 + 2 * a2 + 2 * a3 + a4)


def _solved(
    after: Callable[[FloatArray, FloatArray], _State], q: FloatArray, u: FloatArray
) -> _State:
    """The state that an implicit rule maps onto itself, by repetition."""
    for _ in range(_PASSES):
        q1, u1 = after(q, u)
        settled = max(float(np.abs(q1 - q).max()), float(np.abs(u1 - u).max()))
        q, u = q1, u1
        if not settled > _SETTLED * (1.0 + float(np.abs(u).max())):
            break
    return q, u


RULES = (
    IntegrationRule("explicit Euler", 1, _explicit_euler),
    IntegrationRule("semi-implicit Euler", 1, _semi_implicit_euler),
    IntegrationRule("semi-implicit Euler, coordinates first", 1, _places_first),
    IntegrationRule("implicit Euler", 1, _implicit_euler),
    # Of second order where no force depends on speeds
    IntegrationRule("leapfrog with forces of old speeds", 1, _leapfrog_of_old_speeds),
    IntegrationRule("leapfrog, kick-drift-kick", 1, _kick_drift_kick),
    IntegrationRule("leapfrog, drift-kick-drift", 1, _drift_kick_drift),
    IntegrationRule("explicit midpoint rule", 2, _midpoint),
    IntegrationRule("Heun's rule", 2, _heun),
    IntegrationRule("leapfrog", 2, _leapfrog),
    IntegrationRule("trapezoidal rule", 2, _trapezoidal_rule),
    IntegrationRule("implicit midpoint rule", 2, _implicit_midpoint),
    IntegrationRule("Runge and Kutta's rule", 4, _runge_kutta),
)
"""Rules that engines and programs of one's own follow."""


def integrator_causes(case: Case) -> Iterator[RankedCause]:
    """The best rule of each order, with the step that fits the deviation best."""
    if case.has_impacts or case.solution.singular_passages:
        return  # between whose instants a step of a rule is none of the motion
    unit = _reference_step(case)
    signatures = _signatures(case, unit)
    for order in sorted({rule.order for rule in RULES}):
        chosen = {rule: signatures[rule] for rule in RULES if rule.order == order}
        best = max(_carried_out(case, chosen, unit), key=lambda found: found[0], default=None)
        if best is not None:
            share, rule, h = best
            yield RankedCause(
                name="time step of an integrator",
                kind="settings",
                amount=f"{rule.name}, order {order}, {h:.4g} s",
                explained=share,
            )


def _reference_step(case: Case) -> float:
    """Median step of the reference's own integrator [s]."""
    steps = [np.diff(segment.interpolant.ts) for segment in case.solution.segments]
    return float(np.median(np.concatenate(steps)))


def _signatures(case: Case, unit: float) -> dict[IntegrationRule, FloatArray]:
    """Signatures to first order, of the step for which a rule's error is measured."""

    def forcing(segment: Segment, times: FloatArray, y: FloatArray) -> FloatArray:
        n = y.shape[1] // 2

        def rate(q: FloatArray, u: FloatArray) -> FloatArray:
            return case.solution.equations.solve(q, u, segment.closed)[0]

        added = np.empty((len(times), 2 * n, len(RULES)))
        for k, rule in enumerate(RULES):
            h = unit * _PARTS[rule.order]
            # Within the segment: beyond its end the interpolant is another motion.
            t = np.clip(times, segment.start, max(segment.start, segment.end - h))
            before, after = (np.asarray(segment.interpolant(each)).T for each in (t, t + h))
            q, u = rule.step(rate, h, before[:, :n], before[:, n:])
            added[:, :, k] = (np.concatenate([q, u], axis=1) - after) / h
        return added

    n = case.motion.q.shape[1]
    changes = response(case.solution, np.zeros((2 * n, len(RULES))), forcing, case.t)
    signatures: dict[IntegrationRule, FloatArray] = {}
    for rule, change in zip(RULES, changes, strict=True):
        q, u = case.motion.q + change[:, :n], case.motion.u + change[:, n:]
        signatures[rule] = _seen(case, q, u)
    return signatures


def _seen(case: Case, q: FloatArray, u: FloatArray) -> FloatArray:
    """Signature of a motion through these states."""
    solution = case.solution
    return case.signature(solution.reading(case.t, solution.motion_of(case.t, q, u)))


def _carried_out(
    case: Case, signatures: dict[IntegrationRule, FloatArray], unit: float
) -> Iterator[tuple[float, IntegrationRule, float]]:
    """Share, rule and step [s] of what fits some part of the motion, carried out on all of it."""

    @cache
    def share(rule: IntegrationRule, h: float) -> tuple[float, float]:
        """Share of the deviation, and the factor that the signature fits it with."""
        states = _motion(case, rule, h)
        if states is None:
            return 0.0, 1.0
        signature = _seen(case, *states)
        return share_of(case.deviation, signature), factor_of(case.deviation, signature)

    for part in WINDOWS:
        n = first_part(case, part)
        fits: list[tuple[float, IntegrationRule, float]] = []
        for rule, signature in signatures.items():
            (factor,), explained = fit(case.deviation[:n], signature[None, :n])
            if explained >= _WORTH and factor > 0:
                h = unit * _PARTS[rule.order] * float(factor) ** (1 / rule.order)
                fits.append((explained, rule, h))
        if not fits:
            continue
        worth = _ALIKE * max(explained for explained, _, _ in fits)
        for rule, first in [(rule, h) for explained, rule, h in fits if explained >= worth]:
            h = first
            for _ in range(_CORRECTIONS):
                h = _whole_part(case.step, h)
                explained, factor = share(rule, h)
                yield explained, rule, h
                if explained > _FITS:
                    return
                if not 0.1 < factor < 10.0:
                    break
                h *= factor ** (1 / rule.order)
    if len(case.t) <= _COARSE:
        # Of long steps the first order says little; most files have a line a step.
        for rule in signatures:
            yield share(rule, case.step)[0], rule, case.step


def _whole_part(interval: float, h: float) -> float:
    """A step, or the interval between samples over the whole number that is near to it."""
    parts = max(1, round(interval / h))
    whole = interval / parts
    return whole if abs(whole - h) <= _WHOLE * h else h


def _motion(case: Case, rule: IntegrationRule, h: float) -> _State | None:
    """States of a motion by a rule and step [s], at the case's times; None where there are none."""
    end = float(case.t[-1])
    count = int(np.ceil(end / h * (1 - 1e-12)))
    if count > _MOST_STEPS:
        return None
    segments = iter(case.solution.segments)
    segment = next(segments)
    q, u = initial_state(case.mechanism)
    states = [np.concatenate([q, u, case.solution.equations.solve(q, u, segment.closed)[0]])]

    def rate(q: FloatArray, u: FloatArray) -> FloatArray:
        return case.solution.equations.solve(q, u, segment.closed)[0]

    try:
        with np.errstate(all="ignore"):
            for k in range(count):
                while segment.end <= k * h and segment is not case.solution.segments[-1]:
                    segment = next(segments)
                q, u = rule.step(rate, h, q, u)
                states.append(np.concatenate([q, u, rate(q, u)]))
    except (TrebucheckError, np.linalg.LinAlgError, ValueError):
        return None
    y = np.array(states)
    if not np.isfinite(y).all():
        return None
    n, t = len(q), h * np.arange(count + 1)
    both = CubicHermiteSpline(t, y[:, : 2 * n], y[:, n:])(case.t)
    return both[:, :n], both[:, n:]
