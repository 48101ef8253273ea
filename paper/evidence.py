"""What the claims are judged by: the figures of both machines by name, and what the other studies found."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

from ..models.machines.parameters import TrebuchetParameters
from .results import Claim, EngineValue, Quantity
from .throws.throws import EngineThrow, MachineThrow
from .verdicts import Judgement, not_told

Values = Mapping[str, float]
"""Figures by 'machine: figure', such as 'fixed: launch_speed'."""


@dataclass(frozen=True)
class Evidence:
    """Everything that was computed."""

    parameters: TrebuchetParameters
    throws: Mapping[str, MachineThrow]
    """By machine."""
    sections: Mapping[str, object] = field(default_factory=dict[str, object])
    """What the other studies found, by name; one that failed is absent."""
    failures: Mapping[str, str] = field(default_factory=dict[str, str])
    """Why a study is absent, by name."""

    @property
    def ours(self) -> dict[str, float]:
        """The reference's figures."""
        return _flat({name: throw.figures for name, throw in self.throws.items()})

    @property
    def uncertainties(self) -> dict[str, float]:
        """Of the reference's figures."""
        return _flat({name: throw.uncertainties for name, throw in self.throws.items()})

    @property
    def engines(self) -> list[str]:
        """Engines, in the order they were run in."""
        return list(dict.fromkeys(each.engine for throw in self.throws.values() for each in throw.engines))

    def of_engine(self, engine: str) -> dict[str, EngineThrow]:
        """An engine's throws by machine."""
        return {name: each for name, throw in self.throws.items() for each in throw.engines if each.engine == engine}


def _flat(figures: Mapping[str, Mapping[str, float]]) -> dict[str, float]:
    return {f"{machine}: {name}": value for machine, own in figures.items() for name, value in own.items()}


@dataclass(frozen=True)
class Row:
    """One claim about figures of the throws, before it is judged."""

    name: str
    where: str
    printed: str
    quantity: str
    unit: str
    of: Callable[[Values], float]
    """Of figures in SI units, to the row's unit."""
    judge: Callable[[Quantity], Judgement]
    machine: str = ""

    def claim(self, evidence: Evidence) -> Claim:
        """Judge it; a figure that is missing leaves it open."""
        try:
            value, width = spread(self.of, evidence.ours, evidence.uncertainties)
        except KeyError as error:
            return self._made(None, not_told(f"the reference has no figure {error.args[0]!r}"), ())
        ours = Quantity(value=value, uncertainty=width, unit=self.unit)
        engines = tuple(_by_engine(self.of, evidence, name) for name in evidence.engines)
        return self._made(ours, self.judge(ours), engines)

    def _made(self, ours: Quantity | None, judgement: Judgement, engines: tuple[EngineValue, ...]) -> Claim:
        return made(self.name, self.where, self.printed, self.quantity, ours, judgement, engines, self.machine)


def made(
    name: str,
    where: str,
    printed: str,
    quantity: str,
    ours: Quantity | None,
    judgement: Judgement,
    engines: tuple[EngineValue, ...] = (),
    machine: str = "",
) -> Claim:
    """A claim with its judgement."""
    return Claim(
        name=name,
        where=where,
        printed=printed,
        quantity=quantity,
        machine=machine,
        ours=ours,
        engines=engines,
        rule=judgement.rule,
        verdict=judgement.verdict,
        why=judgement.why,
        departure=judgement.departure,
    )


class _Noting(dict[str, float]):
    """Figures that note which of them are read."""

    def __init__(self, values: Values) -> None:
        super().__init__(values)
        self.used: set[str] = set()

    def __getitem__(self, key: str) -> float:
        self.used.add(key)
        return super().__getitem__(key)


def spread(of: Callable[[Values], float], values: Values, widths: Values) -> tuple[float, float | None]:
    """A function's value, and the sum of what each figure's width changes in it; None where a width is not known.

    A sum, not a root of squares: the errors of one run's figures hang together.

    Raises:
        KeyError: a figure is missing.
    """
    noting = _Noting(values)
    value = of(noting)
    if not noting.used <= widths.keys():
        return value, None
    moved = [abs(of({**values, name: values[name] + widths[name]}) - value) for name in noting.used]
    return value, sum(moved)


def _by_engine(of: Callable[[Values], float], evidence: Evidence, engine: str) -> EngineValue:
    throws = evidence.of_engine(engine)
    try:
        value, _ = spread(of, _flat({name: each.figures for name, each in throws.items()}), {})
    except KeyError as error:
        return EngineValue(engine=engine, value=None, note=_missing(throws, str(error.args[0])))
    # The tolerance is what the bars allow around *our* value.
    _, allowed = spread(of, evidence.ours, _flat({name: each.allowed for name, each in throws.items()}))
    return EngineValue(engine=engine, value=value, tolerance=allowed)


def _missing(throws: Mapping[str, EngineThrow], key: str) -> str:
    machine, _, figure = key.partition(": ")
    throw = throws.get(machine)
    if throw is None:
        return f"it was not run on {machine!r}"
    if throw.note:
        return throw.note
    return next((why for start, why in throw.lacking.items() if figure.startswith(start)), f"it has no {figure!r}")
