"""Claims on the throw: constraint torques, events (Secs. III, VI, VII), fixed release (Sec. IV)."""

from __future__ import annotations

import math
from collections.abc import Iterator
from functools import partial

import numpy as np
from trebucheck.api.mechanics import (
    HANGER_REST,
    PROJECTILE,
    SLING_REST,
    FloatArray,
    StopLaw,
    Trajectory,
)

from ..evidence import quantities as of
from ..evidence.claims import (
    BEST_ANGLE,
    CAPTION_STEP,
    LAUNCH_SPEED,
    RELEASE_TIME,
    SLING_ANGLE,
    SLING_RADIANS,
    TIME_STEP,
)
from ..evidence.throws import MachineThrow
from ..evidence.verdicts import (
    FIXED,
    ROLLING,
    Cause,
    Evidence,
    Grid,
    Row,
    as_printed,
    at_least,
    coincides,
    negative,
    positive,
    vanishes,
)

_SIGNIFICANT = 1.1  # 'significantly', 'more quickly': by a tenth
_ROUNDING = 64 * 2.2e-16 * 10  # of angles up to ten radians
_DEGREE = 180 / math.pi


# [deg] the paper finds the right angle between two angles that it rounds to a degree each.
_ACROSS = 1.0
_roughly = partial(
    at_least, need=0.99, reason="'roughly' asks that the curve accounts for 99 % of the variance"
)


def rows(evidence: Evidence) -> Iterator[Row]:
    """Rows of this section."""
    for name, where in ((FIXED, "Sec. III"), (ROLLING, "Sec. VI")):
        yield _order(name, where)
    for name, where, printed in (
        (FIXED, "Eqs. (1), (6), (7)", "λ with G1"),
        (ROLLING, "Sec. VI", "G2 kept"),
    ):
        yield _pairing(evidence, name, where, printed)
    yield from _shapes()
    for name in (FIXED, ROLLING):
        yield from _signs(name)
    for name in evidence.throws:
        yield _rigid(name)
    for name in evidence.throws:
        yield from _third_constraint(name)
    throw = evidence.throws[FIXED]
    yield from _best_release()
    yield from _grids(throw)
    yield from _angles(evidence, throw)
    yield from _peak(throw)


def _later(name: str, first: str, second: str) -> of.Formula:
    return of.release_time(second).of(name) - of.release_time(first).of(name)


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
    """Pairing of lambda: the multiplier of G1 by Eq. (1), the sling's by Eq. (6)."""
    first, second = (
        evidence.throws[name].values[of.release_time(stop)] for stop in (HANGER_REST, SLING_REST)
    )
    swapped = Cause(
        first < second,
        f"the hanger's multiplier, which Eqs. (1) and (7) call γ, is zero first, at {first:.4g} s; "
        "with the symbols the other way round, as in Figs. 2 and 3, all agrees",
    )
    return Row(
        f"which multiplier vanishes first, {name}",
        where,
        printed,
        "release of G2 (hanger) less that of G1 (sling)",
        _later(name, SLING_REST, HANGER_REST),
        lambda q, _: positive(
            q, "the time from the release of G1 (λ's by Eq. (1)) to that of G2", [swapped]
        ),
        name,
        fact=f"which multiplier vanishes first, {FIXED}",
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
            of.parabola(stop).of(FIXED),
            lambda q, _: _roughly(q),
            FIXED,
        )
        yield Row(
            f"{symbol} only {sense}",
            f"Sec. III, {figure}",
            printed,
            f"largest growth of the {body}'s torque before the first release, of its start",
            of.climb(stop).of(FIXED),
            lambda q, _: vanishes(q, 0.0, "a torque that fades does not grow"),
            FIXED,
        )
    yield Row(
        "γ nearly linear after λ is gone",
        "Sec. III, Fig. 3",
        "linear",
        "R² of a line through the sling's torque between the releases",
        of.line(SLING_REST).of(FIXED),
        lambda q, _: _roughly(q),
        FIXED,
    )
    for claim, where, printed, reason in (
        (
            "constraints depend on each other",
            "Secs. III, VII",
            "significantly",
            "'significantly' asks for a tenth",
        ),
        (
            "projectile freed sooner by the counterweight's swing",
            "Sec. III, Fig. 3",
            "> 1",
            "quicker by a tenth",
        ),
    ):
        yield Row(
            claim,
            where,
            printed,
            "slope of γ just after λ is gone, over its slope just before",
            of.steepening(SLING_REST).of(FIXED),
            lambda q, _, reason=reason: at_least(q, _SIGNIFICANT, reason),
            FIXED,
            fact="constraints depend on each other",
        )


def _signs(name: str) -> Iterator[Row]:
    # Stops' torques here push their gaps open; in the paper's L = T - U + lambda G the hanger's
    # multiplier, of theta - alpha, has the same sign, and the sling's, of theta - phi, the opposite
    # one. Figs. 2 and 3 are of the fixed machine; of the rolling one the paper only says that both
    # constraints act.
    fact, figures = f"constraints at first, {name}", ("Sec. III, Fig. 2", "Sec. III, Fig. 3")
    hanger, sling = figures if name == FIXED else ("Sec. VI", "Sec. VI")
    yield Row(
        f"λ at the start, {name}",
        hanger,
        "> 0",
        "hanger's multiplier at the start, in the paper's sign",
        of.start_torque(HANGER_REST).of(name),
        lambda q, _: positive(q, "the multiplier"),
        name,
        fact=fact,
    )
    yield Row(
        f"γ at the start, {name}",
        sling,
        "< 0",
        "sling's multiplier at the start, in the paper's sign",
        of.start_torque(SLING_REST).of(name).times(-1),
        lambda q, _: negative(q, "minus the multiplier"),
        name,
        fact=fact,
    )


def _rigid(name: str) -> Row:
    return Row(
        f"one rigid mass at first, {name}",
        "Sec. III" if name == FIXED else "Sec. VI",
        "rigid",
        "largest bend at the two rests before the first release",
        of.BEND.of(name),
        lambda q, _: vanishes(q, _ROUNDING, "rounding of angles"),
        name,
        fact=f"one rigid mass at first, {FIXED}",
    )


def _third_constraint(name: str) -> Iterator[Row]:
    # The paper says it once; that the stop acts only then, and changes no launch, is the same fact.
    acting, fact = StopLaw.UNILATERAL, f"launched before the arm is upright, {FIXED}"
    yield Row(
        f"launched before the arm is upright, {name}",
        "Sec. III",
        "> 0",
        "arm at 3π/2 less launch",
        of.ARM_DELAY.of(name),
        lambda q, _: positive(q, "the time from the launch to the arm's arrival"),
        name,
        fact=fact,
    )
    yield Row(
        f"arm stop acts after the launch, {name}",
        "Sec. III",
        "> 0",
        "first blow on a stop that acts, less launch",
        of.FIRST_BLOW.of(name) - of.LAUNCH_TIME.under(acting).of(name),
        lambda q, _: positive(q, "the time from the launch to the blow"),
        name,
        fact=fact,
    )
    speed, distance = (
        ("launch", of.LAUNCH_SPEED, "launch speed"),
        ("range", of.RANGE, "range at 45 deg"),
    )
    for what, quantity, compared in (speed, distance):
        yield Row(
            f"third constraint leaves the {what} alone, {name}",
            "Sec. III",
            "0",
            f"{compared} with an arm stop that acts, less that without",
            quantity.under(acting).of(name) - quantity.of(name),
            lambda q, _: vanishes(q, 0.0, "the same launch"),
            name,
            fact=fact,
        )


def _best_release() -> Iterator[Row]:
    yield Row(
        "time of the best release",
        "Sec. IV",
        RELEASE_TIME,
        "release time of the longest range, no drag",
        of.BEST_TIME.of(FIXED),
        as_printed,
        FIXED,
    )
    quantity = "phi at the release of the longest range"
    phi = of.BEST_PHI.of(FIXED)
    yield Row(
        "sling's angle at the best release",
        "Sec. IV",
        SLING_ANGLE,
        quantity,
        phi.times(_DEGREE, "deg"),
        as_printed,
        FIXED,
    )
    fact = "sling's angle at the best release"
    yield Row(
        "sling's angle in radians",
        "Sec. IV",
        SLING_RADIANS,
        quantity,
        phi,
        as_printed,
        FIXED,
        fact=fact,
    )


def _grids(throw: MachineThrow) -> Iterator[Row]:
    fine = throw.values[of.grid_release(TIME_STEP)]
    off = abs(math.remainder(fine, CAPTION_STEP)) > 1e-9  # a multiple of the step, but for rounding
    sentence = (
        f"{fine:g} s, the best of the multiples of {TIME_STEP:g} s, is no multiple of "
        f"{CAPTION_STEP:g} s"
    )
    caption = [Cause(off, f"text and caption cannot both be right: {sentence}")]
    for source, where, step, causes, fact in (
        ("text", "Sec. IV", TIME_STEP, [], "time of the best release"),
        ("caption", "Fig. 4, caption", CAPTION_STEP, caption, ""),
    ):
        yield Row(
            f"grid of release times, {source}",
            where,
            f"{RELEASE_TIME} on {step:g} s",
            f"best release among the multiples of {step:g} s",
            of.grid_release(step).of(FIXED),
            partial(as_printed, causes=causes),
            FIXED,
            fact=fact,
        )
    yield Row(
        "launch speed at l1 = 10",
        "Sec. V",
        LAUNCH_SPEED,
        "speed when the velocity is at 45 deg",
        of.LAUNCH_SPEED.of(FIXED),
        as_printed,
        FIXED,
    )


def _angles(evidence: Evidence, throw: MachineThrow) -> Iterator[Row]:
    best = throw.values[of.BEST_TIME]
    later = throw.values[of.FASTEST_TIME] - throw.launch_time
    gaining = Cause(
        later > 0,
        f"the projectile still gains speed for {later:.3g} s after the velocity is at 45 deg",
    )
    across = math.remainder(-(throw.values[of.BEST_PHI] * _DEGREE + 90.0), 360.0)
    added = Cause(
        True,
        f"the paper adds 90° to the sling's angle, which gives {across:.4g} deg, not the "
        "velocity's",
    )
    yield Row(
        "best angle of release",
        "Secs. IV, VII",
        BEST_ANGLE,
        "angle of the velocity at the release of the longest range",
        of.BEST_ANGLE.of(FIXED).times(_DEGREE, "deg"),
        partial(as_printed, grid=_on_grid(throw), causes=[added, gaining]),
        FIXED,
    )
    yield Row(
        "another best angle needs a higher speed",
        "Sec. IV",
        "> 0",
        "speed at the best angle, less that at 45 deg",
        of.BEST_SPEED.of(FIXED) - of.LAUNCH_SPEED.of(FIXED),
        lambda q, _: positive(q, "the higher speed that another best angle would need"),
        FIXED,
    )
    moving = _pin_speed(evidence.parameters.l1, throw, best)
    yield Row(
        "velocity across the sling",
        "Sec. IV",
        "90°",
        "angle from sling to velocity at the best release, less a right angle",
        of.TO_SLING.of(FIXED).times(_DEGREE, "deg").plus(-90.0),
        lambda q, _: vanishes(q, _ACROSS, "half a degree each of 585° and of 45°", [moving]),
        FIXED,
    )


def _pin_speed(l1: float, throw: MachineThrow, time: float) -> Cause:
    speed = l1 * abs(float(throw.at(np.array([time])).u[0][0]))
    at_printed = float(_to_sling(throw.at(np.array([RELEASE_TIME.value])))[0]) - 90.0
    return Cause(
        speed > 0,
        f"the sling's pin still moves with {speed:.3g} m/s; at the printed {RELEASE_TIME} ours is "
        f"{at_printed:.3g} deg",
    )


def velocity_angles(trajectory: Trajectory) -> FloatArray:
    """Angle of the projectile's velocity above the horizontal at every sample [deg], shape (n,)."""
    vx, vy = trajectory.marker(PROJECTILE).velocity.T
    return np.degrees(np.arctan2(vy, vx))


def _to_sling(trajectory: Trajectory) -> FloatArray:
    vx, vy = trajectory.marker(PROJECTILE).velocity.T
    turn = np.arctan2(vy, vx) + trajectory.q[:, 1]
    return np.degrees(np.abs(np.angle(np.exp(1j * turn))))


def _peak(throw: MachineThrow) -> Iterator[Row]:
    yield Row(
        "peak speed at the best angle",
        "Sec. IV",
        "same instant",
        "time of the largest speed less that of the best release",
        of.FASTEST_DELAY.of(FIXED),
        lambda q, _: coincides(
            q, TIME_STEP, "two times, each known to half a step of the paper's release times"
        ),
        FIXED,
    )
    yield Row(
        "45 deg gives the largest range",
        "Sec. VI",
        "same range",
        "longest range less that at 45 deg",
        of.RANGE_GAIN.of(FIXED),
        lambda q, _: coincides(q, unresolved_range(throw), UNRESOLVED),
        FIXED,
        fact="best angle of release",
    )


UNRESOLVED = (
    f"what the range loses within half a step of the paper's {TIME_STEP:g} s about the best release"
)


def unresolved_range(throw: MachineThrow) -> float:
    """Range [m] that the paper's grid of release times may miss: it finds a time to half a step."""
    times = throw.values[of.BEST_TIME] + TIME_STEP / 2 * np.array([-1.0, 1.0])
    return throw.values[of.BEST_RANGE] - float(of.vacuum_ranges(throw.at(times)).min())


def _on_grid(throw: MachineThrow) -> Grid:
    """Angle of the velocity [deg] at the best release of the paper's grid."""
    time = throw.values[of.grid_release(TIME_STEP)]
    return Grid(f"{TIME_STEP:g} s", time, float(velocity_angles(throw.at(np.array([time])))[0]))
