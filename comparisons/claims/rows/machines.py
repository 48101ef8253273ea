"""Claims on which machine beats which: Secs. I and VI.

Who wins may depend on the sling, which is the paper's own for one machine only. So each comparison is made twice, with
the paper's sling and with each machine's fastest, and holds where both say the same.
"""

from __future__ import annotations

from ..evidence import made
from ..machines.results import MachineEfficiency, Machines
from ..results import Claim, EngineValue, Quantity, Verdict
from ..verdicts import Judgement


def claims(machines: Machines) -> list[Claim]:
    """All of them."""
    of = {machine.name: machine for machine in machines.machines}
    return [
        *(_beats(of[name], of["catapult"], "Sec. I", "more efficient than a catapult") for name in ("hinged", "fixed")),
        _beats(of["rolling"], of["fixed"], "Sec. VI", "wheels make it more efficient"),
        _beats(of["floating-arm"], of["fixed"], "Sec. VI", "floating arm beats the fixed machine"),
        _beats(of["floating-arm"], of["rolling"], "Sec. VI", "floating arm beats the rolling machine"),
    ]


def _beats(better: MachineEfficiency, worse: MachineEfficiency, where: str, name: str) -> Claim:
    built = better.table_one.efficiency / worse.table_one.efficiency
    ours = Quantity(value=built, unit="")
    return made(
        f"{name} ({better.name})" if worse.name == "catapult" else name,
        where,
        "> 1",
        f"efficiency of {better.name} over that of {worse.name}, with the paper's sling",
        ours,
        _judged(better, worse),
        _by_engine(better, worse),
    )


def _judged(better: MachineEfficiency, worse: MachineEfficiency) -> Judgement:
    rule = "the ratio of efficiencies is above 1 both with the paper's sling and with each machine's fastest one"
    ratios = [better.table_one.efficiency / worse.table_one.efficiency, _best(better) / _best(worse)]
    if all(ratio > 1 for ratio in ratios):
        return Judgement(Verdict.HOLDS, rule)
    fact = (
        f"{better.name} over {worse.name} is {ratios[0]:.3g} with the paper's sling and {ratios[1]:.3g} with the "
        f"fastest ({_best(better):.3g} to {_best(worse):.3g})"
    )
    if any(ratio > 1 for ratio in ratios):
        return Judgement(Verdict.OPEN, rule, f"it depends on the sling, which the paper does not say: {fact}")
    return Judgement(Verdict.FAILS, rule, fact, 1 - max(ratios))


def _best(machine: MachineEfficiency) -> float:
    return (machine.fastest_sling or machine.table_one).efficiency


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
