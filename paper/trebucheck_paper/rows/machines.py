"""Claims on other machines: which beats which (Secs. I and VI), and one designed (Sec. VI, end).

Who wins may depend on lengths that the paper gives for its own machines only. So each comparison is
made with the paper's sling, with each machine's fastest one, and with each kind's most efficient
machine within the same bounds; it holds where all say so. It fails where not even the most
efficient of the favoured kind beats the other as the paper built it; between the two it depends on
lengths, and cannot be told.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from functools import partial

from ..design.efficiency import MachineEfficiency, Machines
from ..design.first_forward_swing import CoincidingDesign, Design
from ..evidence.claims import EngineValue, Quantity, Verdict
from ..evidence.verdicts import (
    ROLLING,
    Cause,
    Judgement,
    Row,
    at_least,
    positive,
    undecided,
    vanishes,
)

_MUCH = 2.0  # 'much more' is taken as twice
_ALL = 0.99  # 'the full energy' is taken as 99 %
_COINCIDING = 1e-6  # [s] allowed difference of the two instants of a design
_LARGEST = "coinciding gives the largest range"


def efficiency_rows(machines: Machines) -> Iterator[Row]:
    """Rows on which machine beats which."""
    rolling, fixed, floating, catapult = map(
        machines.named, ("rolling", "fixed", "floating-arm", "catapult")
    )
    for name in ("hinged", "fixed"):
        claim = f"much more efficient than a catapult ({name})"
        fact = "much more efficient than a catapult (fixed)"
        yield _beats(
            machines.named(name), catapult, "Sec. I", claim, machines, need=_MUCH, fact=fact
        )
    yield _beats(rolling, fixed, "Sec. VI", "wheels make it more efficient", machines)
    for other in (fixed, rolling):
        claim, fact = (
            f"floating arm beats the {other.name} machine",
            "floating arm beats the rolling machine",
        )
        yield _beats(floating, other, "Sec. VI", claim, machines, fact=fact)
    yield _full_energy(floating, machines)


def _beats(
    better: MachineEfficiency,
    worse: MachineEfficiency,
    where: str,
    name: str,
    machines: Machines,
    *,
    need: float = 1.0,
    fact: str = "",
) -> Row:
    return Row(
        name,
        where,
        "much" if need > 1 else "> 1",
        f"efficiency of {better.name} over that of {worse.name}, with the paper's sling",
        Quantity(value=better.table_one.efficiency / worse.table_one.efficiency, unit=""),
        _judged(better, worse, machines, need),
        engines=_combined(better.engines, worse.engines, _ratio),
        fact=fact,
    )


def _judged(
    better: MachineEfficiency, worse: MachineEfficiency, machines: Machines, need: float
) -> Judgement:
    rule = (
        f"the ratio of efficiencies is above {need:g} with the paper's sling, with each machine's "
        f"fastest one and with the most efficient of each kind, {_within(machines, better)}; it "
        "fails where not even the most efficient of the favoured kind beats the other as built"
    )
    ratios, facts = _ratios(better, worse)
    if all(ratio > need for ratio in ratios):
        return Judgement(Verdict.HOLDS, rule)
    if better.most_efficient is None:
        return Judgement(
            Verdict.OPEN, rule, f"other lengths were not looked at, which needs heyoka: {facts}"
        )
    at_best = better.most_efficient.efficiency / worse.table_one.efficiency
    last = (
        f"the most efficient {_format_name(better)} against the {_format_name(worse)} machine as "
        f"built, {at_best:.3g}"
    )
    if at_best > need or any(ratio > need for ratio in ratios):
        why = (
            f"it depends on lengths that the paper does not give: {facts}; {last} "
            f"({_within(machines, better)})"
        )
        return Judgement(Verdict.OPEN, rule, why)
    return Judgement(
        Verdict.FAILS, rule, f"{facts}; {last} ({_within(machines, better)})", need - at_best
    )


def _ratios(better: MachineEfficiency, worse: MachineEfficiency) -> tuple[list[float], str]:
    """Ratios of the comparisons that were made, and their description."""
    pairs = {
        "with the paper's sling": (better.table_one, worse.table_one),
        "with the fastest": (
            better.fastest_sling or better.table_one,
            worse.fastest_sling or worse.table_one,
        ),
    }
    if better.most_efficient and worse.most_efficient:
        pairs["with the most efficient of each kind"] = (
            better.most_efficient,
            worse.most_efficient,
        )
    ratios = {name: one.efficiency / other.efficiency for name, (one, other) in pairs.items()}
    parts = [
        f"{ratios[name]:.3g} {name} ({a.efficiency:.3g} to {b.efficiency:.3g})"
        for name, (a, b) in pairs.items()
    ]
    return list(
        ratios.values()
    ), f"{_format_name(better)} over {_format_name(worse)} is {', '.join(parts)}"


def _format_name(machine: MachineEfficiency) -> str:
    return machine.name.replace("-", " ")


def _within(machines: Machines, machine: MachineEfficiency) -> str:
    bounds = dict(machines.bounds)
    start = bounds.pop("theta0", None)
    parts = [f"{name} {low:g} to {high:g} m" for name, (low, high) in bounds.items()]
    best = machine.most_efficient
    if start is not None and best is not None and start[0] <= best.theta0 <= start[1]:
        parts.append(
            f"arm's start {math.degrees(start[0]):.0f} to {math.degrees(start[1]):.0f} deg"
        )
    return f"within {', '.join(parts)}, with the paper's masses and length of the arm"


def _full_energy(machine: MachineEfficiency, machines: Machines) -> Row:
    """Claim that all of the counterweight's energy goes to the projectile."""
    best = machine.most_efficient
    row = partial(
        Row,
        "floating arm passes on the full energy",
        "Sec. VI",
        "all",
        f"its efficiency, at best {_within(machines, machine)}",
        machine=machine.name,
    )
    if best is None:
        return row(
            ours=None, judge=undecided("other lengths were not looked at, which needs heyoka")
        )
    rest = Cause(
        best.efficiency < _ALL,
        f"the arm and the counterweight keep the rest, {_within(machines, machine)}",
    )
    reason = "'the full energy' asks for all but a hundredth"
    ours = Quantity(value=best.efficiency, unit="")
    return row(ours=ours, judge=at_least(ours, _ALL, reason, [rest]))


def _combined(
    first: tuple[EngineValue, ...],
    second: tuple[EngineValue, ...],
    combine: Callable[[EngineValue, EngineValue], EngineValue],
) -> tuple[EngineValue, ...]:
    """Values of the engines that have both."""
    others = {value.engine: value for value in second}
    return tuple(combine(value, others[value.engine]) for value in first if value.engine in others)


def _ratio(above: EngineValue, below: EngineValue) -> EngineValue:
    if above.value is None or below.value is None:
        return EngineValue(engine=above.engine, value=None, note=above.note or below.note)
    value = above.value / below.value
    known = above.tolerance is not None and below.tolerance is not None
    relative = (above.tolerance or 0.0) / above.value + (below.tolerance or 0.0) / below.value
    return EngineValue(
        engine=above.engine, value=value, tolerance=value * relative if known else None
    )


def design_rows(design: Design) -> Iterator[Row]:
    """Throw with its tolerances and its values where the arm stop acts; failed ones unchanged."""
    if not design.designs:
        return
    best, paper, where = design.designs[0], design.paper_rolling, "Secs. VI, VII"
    yield Row(
        "peak and best angle can coincide",
        where,
        "same instant",
        f"largest kinetic energy less best release, of the design '{best.name}'",
        best.difference,
        lambda q, _: vanishes(q, _COINCIDING, "a microsecond"),
        ROLLING,
        _combined(
            best.engines.get("largest_ratio_time", ()),
            best.engines.get("best_release_time", ()),
            _difference,
        ),
    )
    gain, size = best.throwing.range - paper.range, paper.range / best.throwing.range
    shorter = Cause(
        gain < 0,
        f"{_bounds(design)}, the farthest coinciding machine throws {best.throwing.range:.5g} m, "
        f"the paper's rolling one {paper.range:.5g} m and its fixed one "
        f"{design.paper_fixed.range:.5g} m; with all lengths {size:.3g} times as large, which is "
        "another machine, the coinciding one would throw as far as the paper's",
    )
    yield Row(
        "such a machine throws farther",
        where,
        "> 0",
        f"range of the farthest coinciding machine, {_bounds(design)}, less that of the paper's "
        "rolling machine",
        Quantity(value=gain, unit="m"),
        lambda q, _: positive(q, "the gain within the bounds that are named", [shorter]),
        ROLLING,
        tuple(
            each
            if each.value is None
            else each.model_copy(update={"value": each.value - paper.range})
            for each in best.engines.get("best_range", ())
        ),
        fact=_LARGEST,
    )
    yield from _largest_range(design, best)


def _bounds(design: Design) -> str:
    """Bounds of the verdict on all designs (ours; none are printed), and which are active."""
    bounds, p = design.bounds, design.paper_rolling.parameters
    spans = [
        f"{name} {low:g} to {high:g} m"
        for name, (low, high) in (("r", bounds.r), ("h", bounds.h), ("l1", bounds.l1))
    ]
    active = design.designs[0].optimality.active
    stands = f"the best coinciding one stands on {', '.join(active) or 'none of these bounds'}"
    return (
        f"with {', '.join(spans)} ({stands}), l1 + l2 = {p.l1 + p.l2:g} m, and the paper's masses "
        "and start angles"
    )


def _difference(first: EngineValue, second: EngineValue) -> EngineValue:
    if first.value is None or second.value is None:
        return EngineValue(
            engine=first.engine, value=None, note=first.note or second.note or "a value is missing"
        )
    widths = (first.tolerance, second.tolerance)
    allowed = None if None in widths else sum(width for width in widths if width is not None)
    return EngineValue(engine=first.engine, value=first.value - second.value, tolerance=allowed)


def _largest_range(design: Design, best: CoincidingDesign) -> Iterator[Row]:
    other = design.unconstrained
    if other is None:
        return
    lost, p = other.range - best.throwing.range, other.parameters
    cause = Cause(
        lost > 0,
        f"{_bounds(design)}, the machine of r = {p.r:.3g}, h = {p.h:.3g}, l1 = {p.l1:.3g} m throws "
        f"{other.range:.5g} m, its peak {abs(other.gap):.2g} s "
        f"{'after' if other.gap > 0 else 'before'} the release; that is "
        f"{other.range / best.throwing.range:.3g} times as far as the best coinciding one, at any "
        "size of both",
    )
    yield Row(
        _LARGEST,
        "Secs. VI, VII",
        "largest",
        f"largest range of any rolling machine, {_bounds(design)}, less that of the best "
        "coinciding one",
        Quantity(value=lost, unit="m"),
        lambda q, _: vanishes(
            q,
            0.5e-3 * other.range,
            "a thousandth of the range, within the bounds that are named",
            [cause],
        ),
        ROLLING,
    )
