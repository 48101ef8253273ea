"""Claims on a rolling machine designed as one: the end of Sec. VI."""

from __future__ import annotations

from ..design.results import CoincidingDesign, Design
from ..evidence import made
from ..results import Claim, EngineValue, Quantity
from ..verdicts import Cause, positive, vanishes

_NEED = 1e-6  # [s] the two instants are asked to coincide to


def claims(design: Design) -> list[Claim]:
    """All of them; none where no design was found."""
    if not design.designs:
        return []
    best = design.designs[0]
    gain = Quantity(value=best.throwing.range - design.paper_rolling.range, unit="m")
    shorter = Cause(
        gain.value < 0,
        f"the farthest coinciding machine with {_within(design)} throws {best.throwing.range:.5g} m, the paper's "
        f"rolling one {design.paper_rolling.range:.5g} m and its fixed one {design.paper_fixed.range:.5g} m",
    )
    return [
        made(
            "peak and best angle can coincide",
            "Secs. VI, VII",
            "same instant",
            f"largest kinetic energy less best release, of the design '{best.name}'",
            best.difference,
            vanishes(best.difference, _NEED, "a microsecond"),
            _differing(best, "largest_ratio_time", "best_release_time"),
            machine="rolling",
        ),
        made(
            "such a machine throws farther",
            "Secs. VI, VII",
            "> 0",
            f"range of the design '{best.name}' less that of the paper's rolling machine",
            gain,
            positive(gain, "the gain", [shorter]),
            _beyond(best.engines.get("best_range", ()), design.paper_rolling.range),
            machine="rolling",
        ),
        *_largest(design, best),
    ]


def _within(design: Design) -> str:
    """The bounds, which are ours, and whether they matter."""
    bounds = design.bounds
    spans = [
        f"{name} {low:g} to {high:g}" for name, (low, high) in (("r", bounds.r), ("h", bounds.h), ("l1", bounds.l1))
    ]
    active = design.designs[0].optimality.active
    return f"{', '.join(spans)} m ({'at ' + ', '.join(active) if active else 'at none of these bounds'})"


def _differing(design: CoincidingDesign, first: str, second: str) -> tuple[EngineValue, ...]:
    """Each engine's first figure less its second."""
    others = {each.engine: each for each in design.engines.get(second, ())}
    return tuple(_less(each, others.get(each.engine)) for each in design.engines.get(first, ()))


def _less(first: EngineValue, second: EngineValue | None) -> EngineValue:
    if second is None or first.value is None or second.value is None:
        note = first.note or (second.note if second else None) or "a figure is missing"
        return EngineValue(engine=first.engine, value=None, note=note)
    widths = (first.tolerance, second.tolerance)
    allowed = None if None in widths else sum(width for width in widths if width is not None)
    return EngineValue(engine=first.engine, value=first.value - second.value, tolerance=allowed)


def _beyond(values: tuple[EngineValue, ...], base: float) -> tuple[EngineValue, ...]:
    """Each engine's value less one of ours."""
    return tuple(
        each if each.value is None else each.model_copy(update={"value": each.value - base}) for each in values
    )


def _largest(design: Design, best: CoincidingDesign) -> list[Claim]:
    other = design.unconstrained
    if other is None:
        return []
    lost = Quantity(value=other.range - best.throwing.range, unit="m")
    p = other.parameters
    cause = Cause(
        lost.value > 0,
        f"with {_within(design)}, the machine of r = {p.r:.3g}, h = {p.h:.3g}, l1 = {p.l1:.3g} m throws "
        f"{other.range:.5g} m, its peak {abs(other.gap):.2g} s {'after' if other.gap > 0 else 'before'} the release",
    )
    return [
        made(
            "coinciding gives the largest range",
            "Secs. VI, VII",
            "largest",
            "largest range of any rolling machine within the bounds, less that of the best coinciding one",
            lost,
            vanishes(lost, 0.5e-3 * other.range, "a thousandth of the range, either way", [cause]),
            machine="rolling",
        ),
    ]
