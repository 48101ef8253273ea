"""Claims on which machine beats which: Secs. I and VI.

Who wins may depend on lengths that the paper gives for its own machines only. So each comparison is made with the
paper's sling, with each machine's fastest one, and with each kind's most efficient machine within the same bounds; it
holds where all say so. It fails where not even the most efficient of the favoured kind beats the other as the paper
built it; between the two it depends on lengths, and cannot be told.
"""

from __future__ import annotations

import math

from ..evidence import made
from ..machines.results import MachineEfficiency, Machines
from ..results import Claim, EngineValue, Quantity, Verdict
from ..verdicts import Cause, Judgement, at_least, not_told

_MUCH = 2.0  # 'much more' asks for twice
_ALL = 0.99  # 'the full energy' asks for all but a hundredth


def claims(machines: Machines) -> list[Claim]:
    """All of them."""
    of = {machine.name: machine for machine in machines.machines}
    rolling, fixed, floating = of["rolling"], of["fixed"], of["floating-arm"]
    much = [_beats(of[name], of["catapult"], "Sec. I", "much more efficient than a catapult", machines, _MUCH)
            for name in ("hinged", "fixed")]  # fmt: skip
    return [
        *much,
        _beats(rolling, fixed, "Sec. VI", "wheels make it more efficient", machines),
        _beats(floating, fixed, "Sec. VI", "floating arm beats the fixed machine", machines),
        _beats(floating, rolling, "Sec. VI", "floating arm beats the rolling machine", machines),
        _all_of_it(floating, machines),
    ]


def _beats(
    better: MachineEfficiency,
    worse: MachineEfficiency,
    where: str,
    name: str,
    machines: Machines,
    need: float = 1.0,
) -> Claim:
    built = better.table_one.efficiency / worse.table_one.efficiency
    return made(
        f"{name} ({better.name})" if worse.name == "catapult" else name,
        where,
        "much" if need > 1 else "> 1",
        f"efficiency of {better.name} over that of {worse.name}, with the paper's sling",
        Quantity(value=built, unit=""),
        _judged(better, worse, machines, need),
        _by_engine(better, worse),
    )


def _judged(better: MachineEfficiency, worse: MachineEfficiency, machines: Machines, need: float) -> Judgement:
    rule = (
        f"the ratio of efficiencies is above {need:g} with the paper's sling, with each machine's fastest one and with "
        "the most efficient of each kind within the same bounds; it fails where not even the most efficient of the "
        "favoured kind beats the other as built"
    )
    ratios, facts = _ratios(better, worse)
    if all(ratio > need for ratio in ratios):
        return Judgement(Verdict.HOLDS, rule)
    if better.most_efficient is None:
        return Judgement(Verdict.OPEN, rule, f"other lengths were not looked at, which needs heyoka: {facts}")
    at_best = better.most_efficient.efficiency / worse.table_one.efficiency
    last = f"the most efficient {_said(better)} against the {_said(worse)} machine as built, {at_best:.3g}"
    if at_best > need or any(ratio > need for ratio in ratios):
        why = f"it depends on lengths that the paper does not give: {facts}; {last} ({_within(machines, better)})"
        return Judgement(Verdict.OPEN, rule, why)
    return Judgement(Verdict.FAILS, rule, f"{facts}; {last} ({_within(machines, better)})", need - at_best)


def _ratios(better: MachineEfficiency, worse: MachineEfficiency) -> tuple[list[float], str]:
    """Of the comparisons that were made, and what they are."""
    pairs = {
        "with the paper's sling": (better.table_one, worse.table_one),
        "with the fastest": (better.fastest_sling or better.table_one, worse.fastest_sling or worse.table_one),
    }
    if better.most_efficient and worse.most_efficient:
        pairs["with the most efficient of each kind"] = (better.most_efficient, worse.most_efficient)
    ratios = {name: one.efficiency / other.efficiency for name, (one, other) in pairs.items()}
    said = [f"{ratios[name]:.3g} {name} ({a.efficiency:.3g} to {b.efficiency:.3g})" for name, (a, b) in pairs.items()]
    return list(ratios.values()), f"{_said(better)} over {_said(worse)} is {', '.join(said)}"


def _said(machine: MachineEfficiency) -> str:
    return machine.name.replace("-", " ")


def _within(machines: Machines, machine: MachineEfficiency) -> str:
    bounds = dict(machines.bounds)
    start = bounds.pop("theta0", None)
    said = [f"{name} {low:g} to {high:g} m" for name, (low, high) in bounds.items()]
    best = machine.most_efficient
    if start is not None and best is not None and start[0] <= best.theta0 <= start[1]:
        said.append(f"arm's start {math.degrees(start[0]):.0f} to {math.degrees(start[1]):.0f} deg")
    return f"within {', '.join(said)}"


def _all_of_it(machine: MachineEfficiency, machines: Machines) -> Claim:
    """That the whole of the counterweight's energy goes to the projectile."""
    name, quantity = "floating arm passes on the full energy", "its efficiency, at best within the bounds"
    best = machine.most_efficient
    if best is None:
        missing = not_told("other lengths were not looked at, which needs heyoka")
        return made(name, "Sec. VI", "all", quantity, None, missing, machine=machine.name)
    ours = Quantity(value=best.efficiency, unit="")
    rest = Cause(best.efficiency < _ALL, f"the arm and the counterweight keep the rest, {_within(machines, machine)}")
    judgement = at_least(ours, _ALL, "'the full energy' asks for all but a hundredth", [rest])
    return made(name, "Sec. VI", "all", quantity, ours, judgement, machine=machine.name)


def _by_engine(better: MachineEfficiency, worse: MachineEfficiency) -> tuple[EngineValue, ...]:
    others = {value.engine: value for value in worse.engines}
    return tuple(_ratio(value, others[value.engine]) for value in better.engines if value.engine in others)


def _ratio(above: EngineValue, below: EngineValue) -> EngineValue:
    if above.value is None or below.value is None:
        return EngineValue(engine=above.engine, value=None, note=above.note or below.note)
    value = above.value / below.value
    known = above.tolerance is not None and below.tolerance is not None
    relative = (above.tolerance or 0.0) / above.value + (below.tolerance or 0.0) / below.value
    return EngineValue(engine=above.engine, value=value, tolerance=value * relative if known else None)
