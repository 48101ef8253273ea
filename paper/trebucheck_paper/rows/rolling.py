"""Claims on the rolling against the fixed machine, and on the computation's error (VI, VII)."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from fractions import Fraction

from trebucheck.api.mechanics import ClosedInterval

from ..evidence import quantities as of
from ..evidence.claims import (
    ENERGY_ERROR,
    ENERGY_GAIN,
    ENERGY_SHARE,
    JOULE_SHARE,
    RATIOS,
    SPEED_GAIN,
    SWING,
    TIME_STEP,
    WAY,
    Quantity,
)
from ..evidence.quantities import Formula, ThrowQuantity
from ..evidence.verdicts import (
    FIXED,
    ROLLING,
    Cause,
    Evidence,
    Judgement,
    Row,
    as_printed,
    at_least,
    by_reading,
    coincides,
    negative,
    positive,
    spread,
    undecided,
    vanishes,
)
from .throw import UNRESOLVED, unresolved_range


def rows(evidence: Evidence) -> Iterator[Row]:
    """Rows of this section."""
    yield from _ratios()
    yield from _why_better()
    yield from _paths(evidence)
    yield from _peaks(evidence)
    for name in evidence.throws:
        yield _error(name)
    yield Row(
        "1 J in percent",
        "Sec. VII",
        JOULE_SHARE,
        "1 J as a share of the total energy",
        Formula("%", lambda values: 100 / abs(values[FIXED, of.TOTAL_ENERGY])),
        as_printed,
    )


def _gain(quantity: ThrowQuantity) -> Formula:
    return quantity.of(ROLLING) - quantity.of(FIXED)


def _loss(quantity: ThrowQuantity) -> Formula:
    return quantity.of(FIXED) - quantity.of(ROLLING)


def _ratios() -> Iterator[Row]:
    for name in (FIXED, ROLLING):
        yield Row(
            f"R, {name}",
            "Sec. VI, Fig. 7",
            RATIOS[name],
            "projectile's kinetic over the total energy at 45 deg",
            of.ENERGY_RATIO.of(name),
            as_printed,
            name,
        )
    yield Row(
        "kinetic energy, rolling to fixed",
        "Sec. VI",
        ENERGY_GAIN,
        "ratio of the projectiles' kinetic energies at 45 deg",
        of.ENERGY_RATIO.of(ROLLING) / of.ENERGY_RATIO.of(FIXED),
        as_printed,
        fact=f"R, {ROLLING}",  # with R of both, the ratio and the difference follow
    )
    yield Row(
        "speed, rolling less fixed",
        "Sec. VI",
        SPEED_GAIN,
        "difference of the launch speeds",
        _gain(of.LAUNCH_SPEED),
        as_printed,
        fact=f"R, {ROLLING}",
    )
    yield Row(
        "same total energy",
        "Sec. VI",
        "equal",
        "total energy at the start, rolling less fixed",
        _gain(of.TOTAL_ENERGY),
        lambda q, _: vanishes(q, 0.0, "the same start, at rest"),
    )
    yield Row(
        "R beyond 1 is physical",
        "Sec. VI",
        "U < 0",
        "potential energy at the launch",
        of.POTENTIAL_ENERGY.of(FIXED),
        lambda q, _: negative(q, "minus the potential energy"),
        FIXED,
    )


def _why_better() -> Iterator[Row]:
    yield Row(
        "wheels increase the range",
        "Secs. I, VI",
        "> 0",
        "longest range, rolling less fixed",
        _gain(of.BEST_RANGE),
        lambda q, _: positive(q, "the gain"),
        fact="wheels make it more efficient",
    )
    yield Row(
        "less energy left in the counterweight",
        "Sec. VI",
        "> 0",
        "counterweight's kinetic energy at the launch, fixed less rolling",
        _loss(of.COUNTERWEIGHT_ENERGY),
        lambda q, _: positive(q, "what the rolling machine wastes less"),
    )
    yield Row(
        "machine moves forward at the launch",
        "Sec. VI",
        "> 0",
        "speed of the pivot at the launch",
        of.PIVOT_SPEED.of(ROLLING),
        lambda q, _: positive(q, "the speed, forwards,"),
        ROLLING,
    )


def _paths(evidence: Evidence) -> Iterator[Row]:
    yield Row(
        "counterweight swings out further",
        "Sec. VI, Fig. 6",
        SWING,
        "rightmost x of the counterweight, fixed less rolling",
        _loss(of.RIGHTMOST),
        as_printed,
    )
    yield _additional_way(evidence)
    yield Row(
        "counterweight falls straighter on wheels",
        "Sec. VI, Fig. 6",
        "> 0",
        "how far it swings out per metre it has fallen by the launch, fixed less rolling",
        _loss(of.SLANT),
        lambda q, _: positive(q, "the difference"),
    )


def _additional_way(evidence: Evidence) -> Row:
    """Additional way in the initial swing, whose end is unstated: launch, or return."""
    travelled, widths = _loss(of.SIDEWAYS), evidence.uncertainties
    value, width = spread(travelled.value, evidence.ours, widths)
    up_to_launch = Quantity(value=value, uncertainty=width, unit="m")
    return Row(
        "counterweight's additional way",
        "Sec. VI",
        WAY,
        "twice how much further it swings out",
        _loss(of.RIGHTMOST).times(2),
        lambda q, text: by_reading(
            {"there and back": q, "what it has travelled by the launch": up_to_launch}, text
        ),
    )


def _peaks(evidence: Evidence) -> Iterator[Row]:
    fixed, half = evidence.throws[FIXED], RATIOS[FIXED].half
    later = fixed.values[of.FASTEST_TIME] - fixed.launch_time
    cause = Cause(later > 0, f"R peaks {later:.3g} s after 45 deg")
    yield Row(
        "R at 45 deg is the largest, fixed",
        "Secs. VI, VII, Fig. 7a",
        "same instant",
        "largest R less R at 45 deg",
        of.LARGEST_RATIO.of(FIXED) - of.ENERGY_RATIO.of(FIXED),
        lambda q, _: coincides(q, half, "half a unit of the last digit R is printed to", [cause]),
        FIXED,
        fact="peak speed at the best angle",
    )
    yield Row(
        "R peaks after 45 deg, rolling",
        "Sec. VI, Fig. 7b",
        "> 0",
        "largest R less R at 45 deg, beyond what the print can tell",
        of.LARGEST_RATIO.of(ROLLING) - of.ENERGY_RATIO.of(ROLLING),
        lambda q, _: _beyond(q, half),
        ROLLING,
    )
    yield Row(
        "fastest after 45 deg, rolling",
        "Sec. VI, Fig. 7b",
        "> 0",
        "time of the largest speed less that of 45 deg",
        of.FASTEST_TIME.of(ROLLING) - of.LAUNCH_TIME.of(ROLLING),
        lambda q, _: at_least(
            q, TIME_STEP, "more than the step that passes as the same instant for the fixed one"
        ),
        ROLLING,
        fact="R peaks after 45 deg, rolling",
    )
    yield Row(
        "45 deg is not the rolling machine's best",
        "Sec. VI",
        "> 0",
        "longest range less that at 45 deg",
        of.RANGE_GAIN.of(ROLLING),
        lambda q, _: at_least(q, unresolved_range(evidence.throws[ROLLING]), UNRESOLVED),
        ROLLING,
    )


def _beyond(q: Quantity, half: float) -> Judgement:
    """An excess over half a unit of the last digit that R is printed to."""
    excess = Quantity(value=q.value - half, uncertainty=q.uncertainty, unit=q.unit)
    judged = positive(excess, "the excess over half a unit of the last digit of R")
    return replace(judged, interval=ClosedInterval(Fraction(half), None))


def _error(name: str) -> Row:
    """Claim on the paper's own computation, which no other computation can judge."""
    return Row(
        f"energy's deviation, {name}",
        "Sec. VII",
        f"{ENERGY_ERROR}, {ENERGY_SHARE}",
        "largest change of the total energy up to the launch, in our computation, which is not the "
        "paper's",
        of.ENERGY_DRIFT.of(name),
        undecided(
            "the paper speaks of the error of its own computation, of which neither energies nor "
            "program are published; that ours is smaller says nothing of it"
        ),
        name,
        fact=f"energy's deviation, {FIXED}",
    )
