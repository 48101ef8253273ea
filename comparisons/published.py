"""Figures that sources give of the library's problems, beside what is proved of them."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from typing import Literal

from pydantic import Field

from ..models.errors import InputError, TrebucheckError
from ..models.library.benchmark import At, Benchmark, ImpactTime, KnownValue, Passage, Period, Sum
from ..models.spec import Real, Spec
from ..reference.proof.balls import Ball, precision
from ..reference.proof.events import UndecidedZeroError
from ..reference.proof.passages import passages
from ..reference.proof.printed import ClosedInterval, Standing
from ..reference.proof.proof import Enclosure, Proof
from .prove import prove
from .runs.results import ResultFile

FORMAT = "trebucheck-published-1"
_NOT_READ = "not proved: what an impact changes is not read from enclosures"


class PublishedFigure(Spec):
    """A source's figure and the enclosure of the same number."""

    problem: str
    figure: str
    unit: str
    basis: Literal["closed form", "quadrature", "published"]
    expected: str = Field(description="as printed; of a closed form or quadrature as computed")
    half: Real = Field(
        description="half a unit of the last printed place; of a closed form or quadrature what "
        "its computation in doubles is held to"
    )
    value: str | None = Field(description="proved; null: it is not")
    radius: str | None = None
    standing: Standing | None = Field(
        description="of the enclosure beside the expected value within `half`; null: not proved"
    )
    off: str | None = Field(
        default=None, description="proved distance from the expected value, at least"
    )
    why: str = Field(default="", description="why it is not proved")

    @property
    def verdict(self) -> str:
        """Where the proved number lies, or why there is none."""
        if self.standing is None:
            return self.why
        if self.standing is Standing.INSIDE:
            return f"inside, {self.more_digits} digits more"
        if self.standing is Standing.OUTSIDE:
            return f"outside, off by {self.off} {self.unit}"
        return "not decided: across the end of what is expected"

    @property
    def more_digits(self) -> int:
        """Digits that are proved beyond those that are expected."""
        if self.radius is None or not float(self.radius):
            return 0
        return max(0, math.floor(math.log10(self.half / float(self.radius))))


class PublishedFigures(ResultFile):
    """Sources' figures of all problems beside proofs."""

    format: Literal["trebucheck-published-1"] = FORMAT
    digits: int = Field(description="that the motions were enclosed with")
    figures: tuple[PublishedFigure, ...]


def published_figures(
    benchmarks: Iterable[Benchmark], digits: int = 20, timeout: float = 120.0
) -> Iterator[PublishedFigure]:
    """Hold the figures of benchmarks against proofs of their motions.

    Args:
        benchmarks: each with its published parameters.
        digits: of the motions.
        timeout: limit of processor time for each [s].
    """
    for benchmark in benchmarks:
        try:
            yield from figures_beside(benchmark, prove(benchmark.name, digits, timeout=timeout))
        except TrebucheckError as error:
            why = str(error).rstrip(".")
            for figure in _numbers(benchmark):
                yield _beside(benchmark, figure, None, why if _is_read(figure) else _NOT_READ)


def figures_beside(benchmark: Benchmark, proof: Proof) -> list[PublishedFigure]:
    """Hold the figures of a benchmark, with its published parameters, against a proof of it."""
    found: list[PublishedFigure] = []
    for figure in _numbers(benchmark):
        known, why = _enclosed(proof, figure) if _is_read(figure) else (None, _NOT_READ)
        found.append(_beside(benchmark, figure, known, why))
    return found


def _numbers(benchmark: Benchmark) -> list[KnownValue]:
    """Figures that are numbers of the motion; a difference along it is expected to be zero."""
    return [each for each in benchmark.parameters().figures() if each.value]


def _is_read(figure: KnownValue) -> bool:
    read = figure.read
    if isinstance(read, At | Passage | Period):
        return isinstance(read.quantity, Sum)
    return isinstance(read, ImpactTime)


def _enclosed(proof: Proof, figure: KnownValue) -> tuple[Enclosure | None, str]:
    """The proved number, and why there is none."""
    read = figure.read
    with precision(proof.bits):
        try:
            if isinstance(read, At):
                return Enclosure.of(_sum(proof, read)), ""
            if isinstance(read, ImpactTime):
                return proof.impacts[read.index][1], ""
            wanted = read.passages if isinstance(read, Period) else (read,)
            assert all(isinstance(each, Passage) for each in wanted)
            times = [_passage(proof, each) for each in wanted if isinstance(each, Passage)]
        except UndecidedZeroError as error:
            return None, f"not proved: whether {error.inequality} at a passage"
        except (IndexError, InputError):
            return None, "not proved: it does not come in the proved motion"
        return Enclosure.of(times[-1] - times[0] if len(times) > 1 else times[0]), ""


def _sum(proof: Proof, read: At) -> Ball:
    assert isinstance(read.quantity, Sum)
    q, u = proof.state(read.t)
    values = u if read.quantity.of_rates else q
    names = proof.problem.mechanism.coordinates
    return sum(f * values[names.index(name)] for name, f in read.quantity.factors.items())


def _passage(proof: Proof, read: Passage) -> Ball:
    assert isinstance(read.quantity, Sum)
    names = proof.problem.mechanism.coordinates
    factors = [read.quantity.factors.get(name, 0.0) for name in names]
    return passages(proof.motion, factors, read.level, read.count)[-1]


def _beside(
    benchmark: Benchmark, figure: KnownValue, known: Enclosure | None, why: str
) -> PublishedFigure:
    expected = figure.printed or repr(figure.value)
    interval = ClosedInterval.around(figure.value, figure.tolerance)
    if figure.printed:
        interval = ClosedInterval.rounding_to(expected)
    assert interval.low is not None
    assert interval.high is not None
    standing = None if known is None else interval.standing(known)
    off = None
    if known is not None and standing is Standing.OUTSIDE:
        off = f"{float(interval.distance(known)):.3g}"
    return PublishedFigure(
        problem=benchmark.name,
        figure=figure.name,
        unit=figure.unit,
        basis=figure.basis,
        expected=expected,
        half=float((interval.high - interval.low) / 2),
        value=None if known is None else str(known.value),
        radius=None if known is None else str(known.radius),
        standing=standing,
        off=off,
        why=why,
    )
