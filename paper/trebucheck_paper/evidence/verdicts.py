"""Claims as data and rules; the rules turn our number and the paper's into a verdict.

Each rule is a function that returns a :class:`Judgement`: the verdict, the rule in words, and,
where the claim does not simply hold, a sentence that says why, with the computed numbers in it.
Which sentence it is follows from facts that were computed as well (:class:`Cause`).
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field, replace
from fractions import Fraction
from typing import Any, TypeVar

from trebucheck.api.mechanics import ClosedInterval, TrebuchetParameters

from .claims import Claim, EngineValue, Printed, Quantity, Verdict, parse
from .proved import Enclosures
from .quantities import Formula, Readings, ThrowQuantity, Values
from .throws import EngineThrow, MachineThrow


@dataclass(frozen=True)
class Judgement:
    """A verdict with its grounds."""

    verdict: Verdict
    rule: str
    why: str = ""
    departure: float | None = None
    """Distance of ours from the claim, relative to the claim; 1 where a claimed fact is absent."""
    interval: ClosedInterval | None = None
    """Values for which the claim holds as printed; None: the rule is of another kind."""


@dataclass(frozen=True)
class Cause:
    """A possible reason why a claim does not hold, and whether it was found to apply."""

    applies: bool
    sentence: str


@dataclass(frozen=True)
class Grid:
    """Our value at the point of the paper's own sampling that is the best one.

    A printed number that was picked from a grid is our value there. That the values on either side
    of our own point enclose the printed number is no agreement: the grid has no point between them.
    """

    step: str
    """Step with unit, such as '0.005 s'."""
    point: float
    value: float


_LEAST = Fraction(1, 10**30)  # of what is positive: an exact zero is not

_TO_THE_DIGITS = (
    "|ours - printed| is at most half a unit of the last printed digit plus our uncertainty"
)
_ON_GRID = "; or our value at the point that the paper's own grid finds best comes as near"


def as_printed(
    ours: Quantity, printed: str, grid: Grid | None = None, causes: Iterable[Cause] = ()
) -> Judgement:
    """A printed number: holds to its digits, or within the paper's own grid, or not."""
    number = parse(printed)
    holding = ClosedInterval.rounding_to(number.digits)
    allowed = number.half + (ours.uncertainty or 0.0)
    error = abs(ours.value - number.value)
    departure = error / abs(number.value) if number.value else 1.0
    rule = _TO_THE_DIGITS + (_ON_GRID if grid else "")
    # A value that stands exactly on the border of rounding may lose an ulp on its way here.
    if error <= allowed * (1 + 1e-12):
        return Judgement(Verdict.HOLDS, rule, departure=departure, interval=holding)
    on_grid = (
        ""
        if grid is None
        else f", and {grid.value:.5g} at {grid.point:.5g}, the best on a grid of {grid.step}"
    )
    if grid and abs(grid.value - number.value) <= allowed * (1 + 1e-12):
        return Judgement(
            Verdict.WITHIN_GRID, rule, f"ours is {_format(ours)}{on_grid}", departure, holding
        )
    fact = f"ours is {_format(ours)}, {_format(error, ours.unit, 3)} away{on_grid}"
    return Judgement(Verdict.FAILS, rule, _why(fact, causes), departure, holding)


def by_reading(ours: Mapping[str, Quantity], printed: str) -> Judgement:
    """Printed number of several meanings: decided where each of them gives the same verdict.

    Args:
        ours: our value of each meaning, by what it is.
    """
    rule = f"under every reading of the text ({'; '.join(ours)}): {_TO_THE_DIGITS}"
    found = [as_printed(value, printed) for value in ours.values()]
    if len({each.verdict for each in found}) == 1:
        return replace(found[0], rule=rule)
    values = "; ".join(f"{_format(value)} is {name}" for name, value in ours.items())
    return Judgement(Verdict.OPEN, rule, f"the text does not say what is meant: {values}")


def positive(margin: Quantity, what: str, causes: Iterable[Cause] = ()) -> Judgement:
    """An order or a sign: the margin by which it holds is positive beyond its uncertainty.

    Args:
        what: the margin in words, for the rule and the sentence.
    """
    holding = ClosedInterval(_LEAST, None)
    rule = f"{what} is positive, by more than its uncertainty"
    if margin.value > (margin.uncertainty or 0.0):
        return Judgement(Verdict.HOLDS, rule, interval=holding)
    return Judgement(
        Verdict.FAILS, rule, _why(f"{what.rstrip(',')} is {_format(margin)}", causes), 1.0, holding
    )


def negative(margin: Quantity, what: str) -> Judgement:
    """A sign: minus the margin is positive beyond its uncertainty; see :func:`positive`."""
    other = Quantity(value=-margin.value, uncertainty=margin.uncertainty, unit=margin.unit)
    return replace(positive(other, what), interval=ClosedInterval(None, -_LEAST))


def vanishes(
    ours: Quantity, allowed: float, reason: str, causes: Iterable[Cause] = ()
) -> Judgement:
    """Difference that should vanish: at most a stated allowance and our uncertainty."""
    holding = ClosedInterval.around(0.0, allowed)
    rule = (
        f"|ours| is at most {allowed:.3g} {ours.unit}".rstrip()
        + f" ({reason}) plus our uncertainty"
    )
    if abs(ours.value) <= allowed + (ours.uncertainty or 0.0):
        return Judgement(Verdict.HOLDS, rule, interval=holding)
    return Judgement(Verdict.FAILS, rule, _why(f"ours is {_format(ours)}", causes), 1.0, holding)


def coincides(
    ours: Quantity, resolution: float, reason: str, causes: Iterable[Cause] = ()
) -> Judgement:
    """Coincidence in the paper: equal, or nearer than its own sampling can resolve.

    Args:
        ours: their distance.
        resolution: what the paper can tell apart, in the unit of ours.
        reason: where that comes from.
    """
    holding = ClosedInterval.around(0.0, 0.0)  # as it is printed; the grid is another matter
    rule = (
        f"the distance is nothing but our uncertainty; or at most {resolution:.3g} {ours.unit} "
        f"({reason})"
    )
    if abs(ours.value) <= (ours.uncertainty or 0.0):
        return Judgement(Verdict.HOLDS, rule, interval=holding)
    if abs(ours.value) <= resolution:
        told = _format(resolution, ours.unit, 3)
        return Judgement(
            Verdict.WITHIN_GRID,
            rule,
            f"they lie {_format(ours)} apart; up to {told} cannot be told",
            interval=holding,
        )
    return Judgement(
        Verdict.FAILS, rule, _why(f"they lie {_format(ours)} apart", causes), 1.0, holding
    )


def at_least(ours: Quantity, need: float, reason: str, causes: Iterable[Cause] = ()) -> Judgement:
    """A quality: ours comes up to a stated need, for a stated reason."""
    holding = ClosedInterval(Fraction(need), None)
    rule = f"ours is at least {need:g} {ours.unit}".rstrip() + f" ({reason})"
    if ours.value >= need:
        return Judgement(Verdict.HOLDS, rule, interval=holding)
    departure = (need - ours.value) / abs(need) if need else 1.0
    return Judgement(
        Verdict.FAILS, rule, _why(f"ours is {_format(ours)}", causes), departure, holding
    )


def at_most(ours: Quantity, most: float, reason: str, causes: Iterable[Cause] = ()) -> Judgement:
    """Smallness: ours and its uncertainty do not exceed a stated need, for a stated reason."""
    holding = ClosedInterval(None, Fraction(most))
    rule = f"ours is at most {most:g} {ours.unit}".rstrip() + f" ({reason})"
    if ours.value <= most + (ours.uncertainty or 0.0):
        return Judgement(Verdict.HOLDS, rule, interval=holding)
    return Judgement(Verdict.FAILS, rule, _why(f"ours is {_format(ours)}", causes), 1.0, holding)


def differs(ours: Quantity, printed: str, causes: Iterable[Cause] = ()) -> Judgement:
    """A difference that the text states, as it states it: more than digits and uncertainty hide.

    Args:
        ours: one of the two.
        printed: the other, with the digits it is known to.
        causes: what else is to be said of a claim that is true as it is written.
    """
    number = parse(printed)
    rule = f"ours and {number.digits} differ by more than its digits and our uncertainty"
    error = abs(ours.value - number.value)
    if error > number.half + (ours.uncertainty or 0.0):
        fact = f"true as it is written, by {_format(error, ours.unit, 3)}"
        notes = _why(fact, causes)
        return Judgement(Verdict.HOLDS, rule, "" if notes == fact else notes)
    return Judgement(Verdict.FAILS, rule, f"ours is {_format(ours)}", 1.0)


def occurs(occurred: bool, what: str, causes: Iterable[Cause] = ()) -> Judgement:
    """A fact: it was found in our computations, or it was not.

    Args:
        what: the fact in words, for the rule and the sentence.
    """
    rule = f"found in our computations: {what}"
    if occurred:
        return Judgement(Verdict.HOLDS, rule)
    return Judgement(Verdict.FAILS, rule, _why(f"not found: {what}", causes), 1.0)


def undecided(missing: str) -> Judgement:
    """Undecided: the data needed for a verdict is missing.

    Args:
        missing: a sentence that says what.
    """
    return Judgement(Verdict.OPEN, "a datum is needed that is not there", missing)


def _why(fact: str, causes: Iterable[Cause]) -> str:
    applying = [cause.sentence for cause in causes if cause.applies]
    return "; ".join([fact, *applying])


def _format(ours: Quantity | float, unit: str = "", digits: int = 6) -> str:
    value, unit = (ours.value, ours.unit) if isinstance(ours, Quantity) else (ours, unit)
    return f"{value:.{digits}g} {unit}".rstrip()


FIXED, ROLLING = "fixed", "rolling"
_Key = TypeVar("_Key")
Rule = Callable[[Quantity, str], Judgement]
"""Rule that judges our value against the printed text."""


@dataclass(frozen=True)
class Evidence:
    """Results that were computed."""

    parameters: TrebuchetParameters
    throws: Mapping[str, MachineThrow]
    """Throws by machine."""
    sections: Mapping[str, Any] = field(default_factory=dict[str, Any])
    """Results of the further studies, by name; one that failed is absent."""
    failures: Mapping[str, str] = field(default_factory=dict[str, str])
    """Why a study is absent, by name."""
    enclosures: Enclosures | None = None
    """Enclosures of the throws' quantities; None: none were made."""

    @property
    def ours(self) -> Values:
        """The reference's values."""
        return _flat({name: throw.values for name, throw in self.throws.items()})

    @property
    def uncertainties(self) -> Values:
        """Uncertainties of the reference's values."""
        return _flat({name: throw.uncertainties for name, throw in self.throws.items()})

    @property
    def engines(self) -> list[str]:
        """Engines, in the order they were run in."""
        return list(
            dict.fromkeys(each.engine for throw in self.throws.values() for each in throw.engines)
        )

    def of_engine(self, engine: str) -> dict[str, EngineThrow]:
        """An engine's throws by machine."""
        return {
            name: each
            for name, throw in self.throws.items()
            for each in throw.engines
            if each.engine == engine
        }


def _flat(values: Mapping[str, Readings]) -> Values:
    return {
        (machine, quantity): value
        for machine, own in values.items()
        for quantity, value in own.items()
    }


@dataclass(frozen=True)
class Row:
    """One claim of the paper: what is printed, what is compared with it, and by which rule."""

    name: str
    where: str
    printed: str | Printed
    quantity: str
    ours: Formula | Quantity | None
    """Computed from the throws, or known already; None where there is none."""
    judge: Rule | Judgement
    """A judgement where it does not follow from ours and the printed text alone."""
    machine: str = ""
    engines: tuple[EngineValue, ...] = ()
    """Values of the engines; those of a formula are computed from their throws."""
    fact: str = ""
    """Name of the row that states the same fact best; empty: it is a fact of its own."""

    def claim(self, evidence: Evidence) -> Claim:
        """Judge it; a quantity that is missing leaves it open."""
        if not isinstance(self.ours, Formula):
            return self.judged(self.ours, self.engines)
        try:
            value, width = spread(self.ours.value, evidence.ours, evidence.uncertainties)
        except KeyError as error:
            machine, quantity = error.args[0]
            missing = undecided(
                f"the reference's throw of the {machine!r} machine has no {quantity}"
            )
            return self.judged(None, (), missing)
        ours = Quantity(value=value, uncertainty=width, unit=self.ours.unit)
        judgement = self._judgement(ours)
        engines = tuple(_by_engine(self.ours, evidence, name) for name in evidence.engines)
        claim = self.judged(ours, engines, judgement)
        if evidence.enclosures is None:
            return claim
        known = evidence.enclosures.proof_of(self.ours, judgement.interval)
        return claim.model_copy(update={"proved": known})

    def _judgement(self, ours: Quantity | None) -> Judgement:
        if isinstance(self.judge, Judgement):
            return self.judge
        assert ours is not None, f"{self.name}: a rule needs a value"
        return self.judge(ours, str(self.printed))

    def judged(
        self,
        ours: Quantity | None,
        engines: tuple[EngineValue, ...] = (),
        judgement: Judgement | None = None,
    ) -> Claim:
        """The claim of our value."""
        result = judgement or self._judgement(ours)
        return Claim(
            name=self.name,
            where=self.where,
            printed=str(self.printed),
            quantity=self.quantity,
            machine=self.machine,
            fact=self.fact,
            ours=ours,
            engines=engines,
            rule=result.rule,
            verdict=result.verdict,
            why=result.why,
            departure=result.departure,
        )


class _Recorder(dict[_Key, float]):
    """Values that record which of them are read."""

    def __init__(self, values: Mapping[_Key, float]) -> None:
        super().__init__(values)
        self.used: dict[_Key, None] = {}

    def __getitem__(self, key: _Key) -> float:
        value = super().__getitem__(key)
        self.used[key] = None
        return value


def spread(
    of: Callable[[Mapping[_Key, float]], float],
    values: Mapping[_Key, float],
    widths: Mapping[_Key, float],
) -> tuple[float, float | None]:
    """Value of a function, and the sum of changes by each width; None if a width is unknown.

    A sum, not a root of squares: the errors of one run's quantities are correlated.

    Raises:
        KeyError: a value is missing.
    """
    recorder = _Recorder(values)
    value = of(recorder)
    if not recorder.used.keys() <= widths.keys():
        return value, None
    return value, sum(
        abs(of({**values, key: values[key] + widths[key]}) - value) for key in recorder.used
    )


def _by_engine(formula: Formula, evidence: Evidence, engine: str) -> EngineValue:
    throws = evidence.of_engine(engine)
    try:
        value = formula.value(_flat({name: each.values for name, each in throws.items()}))
    except KeyError as error:
        return EngineValue(engine=engine, value=None, note=_missing(throws, *error.args[0]))
    # The tolerance is what the engine's tolerances allow around *our* value.
    _, allowed = spread(
        formula.value,
        evidence.ours,
        _flat({name: each.tolerances for name, each in throws.items()}),
    )
    return EngineValue(engine=engine, value=value, tolerance=allowed)


def _missing(throws: Mapping[str, EngineThrow], machine: str, quantity: ThrowQuantity) -> str:
    throw = throws.get(machine)
    if throw is None:
        return f"it was not run on {machine!r}"
    return throw.note or throw.lacking.get(quantity.law) or f"it has no {quantity}"
