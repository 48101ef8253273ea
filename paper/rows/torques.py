"""Claims on the constraint torques and the order of events: Secs. III, VI and VII, Figs. 2 and 3, Eq. (1)."""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial

from ...models.machines.trebuchet import HANGER_REST, SLING_REST
from ...models.problem import StopLaw
from ..evidence.quantities import (
    ARM_DELAY,
    BEND,
    FIRST_BLOW,
    LAUNCH_SPEED,
    LAUNCH_TIME,
    RANGE,
    Formula,
    climb,
    line,
    parabola,
    release_time,
    slope_change,
    start_torque,
    steepening,
)
from ..evidence.results import Quantity
from ..evidence.verdicts import FIXED, ROLLING, Cause, Evidence, Row, at_least, positive, vanishes

_SIGNIFICANT = 0.1
_ROUNDING = 64 * 2.2e-16 * 10  # of angles up to ten radians
_roughly = partial(at_least, need=0.99, reason="'roughly' asks that the curve accounts for 99 % of the variance")


def rows(evidence: Evidence) -> Iterator[Row]:
    """All of them."""
    for name, where in ((FIXED, "Sec. III"), (ROLLING, "Sec. VI")):
        yield _order(name, where)
    for name, where, printed in ((FIXED, "Eqs. (1), (6), (7)", "λ with G1"), (ROLLING, "Sec. VI", "G2 kept")):
        yield _pairing(evidence, name, where, printed)
    yield from _shapes()
    for name in (FIXED, ROLLING):
        yield from _signs(name)
    for name in evidence.throws:
        yield _rigid(name)
    for name in evidence.throws:
        yield from _third_constraint(name)


def _later(name: str, first: str, second: str) -> Formula:
    return release_time(second).of(name) - release_time(first).of(name)


def _order(name: str, where: str) -> Row:
    return Row(
        f"hanger released first, {name}",
        where,
        "λ, then γ",
        "sling's release less hanger's",
        _later(name, HANGER_REST, SLING_REST),
        lambda q, _: positive(q, "the time from the hanger's release to the sling's"),
        name,
    )


def _pairing(evidence: Evidence, name: str, where: str, printed: str) -> Row:
    """By Eq. (1) lambda is the multiplier of G1, by Eq. (6) that of the sling's angle: then it is the sling's."""
    first, second = (evidence.throws[name].values[release_time(stop)] for stop in (HANGER_REST, SLING_REST))
    swapped = Cause(
        first < second,
        f"the hanger's multiplier, which Eqs. (1) and (7) call γ, is zero first, at {first:.4g} s; with the symbols "
        "the other way round, as in Figs. 2 and 3, all agrees",
    )
    return Row(
        f"which multiplier vanishes first, {name}",
        where,
        printed,
        "release of G2 (hanger) less that of G1 (sling)",
        _later(name, SLING_REST, HANGER_REST),
        lambda q, _: positive(q, "the time from the release of G1 (λ's by Eq. (1)) to that of G2", [swapped]),
        name,
    )


def _shapes() -> Iterator[Row]:
    for symbol, stop, body, figure, sense, printed in (
        ("λ", HANGER_REST, "hanger", "Fig. 2", "falls", "decreasing"),
        ("γ", SLING_REST, "sling", "Fig. 3", "rises", "increasing"),
    ):
        yield Row(
            f"{symbol} like a parabola",
            f"Sec. III, {figure}",
            "quadratic",
            "R² of a parabola through the torque while both rests push",
            parabola(stop).of(FIXED),
            lambda q, _: _roughly(q),
            FIXED,
        )
        yield Row(
            f"{symbol} only {sense}",
            f"Sec. III, {figure}",
            printed,
            f"largest growth of the {body}'s torque before the first release, of its start",
            climb(stop).of(FIXED),
            lambda q, _: vanishes(q, 0.0, "a torque that fades does not grow"),
            FIXED,
        )
    yield Row(
        "γ nearly linear after λ is gone",
        "Sec. III, Fig. 3",
        "linear",
        "R² of a line through the sling's torque between the releases",
        line(SLING_REST).of(FIXED),
        lambda q, _: _roughly(q),
        FIXED,
    )
    yield Row(
        "constraints depend on each other",
        "Secs. III, VII",
        "> 0",
        "change of the slope of γ where λ is gone, of its slope before",
        slope_change(SLING_REST).of(FIXED),
        lambda q, _: at_least(q, _SIGNIFICANT, "'significantly' asks for a tenth"),
        FIXED,
    )
    yield Row(
        "projectile freed sooner by the counterweight's swing",
        "Sec. III, Fig. 3",
        "> 1",
        "slope of γ once λ is gone, over its slope before",
        steepening(SLING_REST).of(FIXED),
        lambda q, _: at_least(q, 1 + _SIGNIFICANT, "quicker by a tenth"),
        FIXED,
    )


def _signs(name: str) -> Iterator[Row]:
    # Stops' torques here push their gaps open; in the paper's L = T - U + lambda G the hanger's multiplier, of
    # theta - alpha, has the same sign, and the sling's, of theta - phi, the opposite one.
    yield Row(
        f"λ at the start, {name}",
        "Sec. III, Fig. 2",
        "> 0",
        "hanger's multiplier at the start, in the paper's sign",
        start_torque(HANGER_REST).of(name),
        lambda q, _: positive(q, "the multiplier"),
        name,
    )
    yield Row(
        f"γ at the start, {name}",
        "Sec. III, Fig. 3",
        "< 0",
        "sling's multiplier at the start, in the paper's sign",
        start_torque(SLING_REST).of(name).times(-1),
        lambda q, _: positive(negated(q), "minus the multiplier"),
        name,
    )


def negated(q: Quantity) -> Quantity:
    """Minus a quantity."""
    return Quantity(value=-q.value, uncertainty=q.uncertainty, unit=q.unit)


def _rigid(name: str) -> Row:
    return Row(
        f"one rigid mass at first, {name}",
        "Sec. III",
        "rigid",
        "largest bend at the two rests before the first release",
        BEND.of(name),
        lambda q, _: vanishes(q, _ROUNDING, "rounding of angles"),
        name,
    )


def _third_constraint(name: str) -> Iterator[Row]:
    acting = StopLaw.UNILATERAL
    yield Row(
        f"launched before the arm is upright, {name}",
        "Sec. III",
        "> 0",
        "arm at 3π/2 less launch",
        ARM_DELAY.of(name),
        lambda q, _: positive(q, "the time from the launch to the arm's arrival"),
        name,
    )
    yield Row(
        f"arm stop acts after the launch, {name}",
        "Sec. III",
        "> 0",
        "first blow on a stop that acts, less launch",
        FIRST_BLOW.of(name) - LAUNCH_TIME.under(acting).of(name),
        lambda q, _: positive(q, "the time from the launch to the blow"),
        name,
    )
    for what, quantity, compared in (("launch", LAUNCH_SPEED, "launch speed"), ("range", RANGE, "range at 45 deg")):
        yield Row(
            f"third constraint leaves the {what} alone, {name}",
            "Sec. III",
            "0",
            f"{compared} with an arm stop that acts, less that without",
            quantity.under(acting).of(name) - quantity.of(name),
            lambda q, _: vanishes(q, 0.0, "the same launch"),
            name,
        )
