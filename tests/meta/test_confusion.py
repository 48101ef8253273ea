"""Faults against the causes that a diagnosis names.

The whole table is printed by `python tests/confusion.py`.
"""

from __future__ import annotations

from functools import cache

import pytest
import trebucheck as tb
from confusion import Bench, Entry, Seed, diagnosed, scaled, seeds
from trebucheck.models.library.registry import benchmark

NAMED = (
    "gravity tilted 0.05 deg",
    "a pin aside, aslant",
    "a spring on a pin",
    "time times 1.001",
    "kinetic energy 0.1 % low",
    "a run cut at 90 %",
    "a marker aside",
    "single precision",
)
UNKNOWN = ("drag on the projectile", "a third body", "noise on everything")


@cache
def _bench() -> Bench:
    return Bench.of(tb.fixed())


@cache
def _chain() -> Bench:
    return Bench.of(benchmark("hanging-chain").problem().mechanism)


def _seed(bench: Bench, name: str) -> Seed:
    return next(seed for seed in seeds(bench.mechanism) if seed.name == name)


@cache
def _entry(name: str) -> Entry:
    return diagnosed(_bench(), _seed(_bench(), name))


@pytest.mark.parametrize("name", NAMED)
def test_a_fault_that_is_suspected_is_named_as_likeliest(name: str) -> None:
    entry = _entry(name)
    assert entry.verdict == "named", entry.diagnosis


@pytest.mark.parametrize("name", UNKNOWN)
def test_a_fault_that_is_no_suspect_is_called_unknown(name: str) -> None:
    entry = diagnosed(_bench(), _seed(_bench(), name))
    assert entry.diagnosis.named == (), entry.diagnosis


def test_a_size_in_the_shape_of_the_mechanism_does_not_matter() -> None:
    """A model of a hundredth: the same cause, and the same share of it."""
    small = Bench.of(scaled(tb.fixed(), 0.01))
    full, model = (
        _entry("a pin aside, aslant"),
        diagnosed(small, _seed(small, "a pin aside, aslant")),
    )
    assert model.diagnosis.causes[0].name == full.diagnosis.causes[0].name
    assert model.diagnosis.causes[0].explained == pytest.approx(
        full.diagnosis.causes[0].explained, abs=1e-3
    )
    assert model.verdict == "named"


@pytest.mark.parametrize(
    "name", ["mass of the link 3 +0.2 %", "a quarter of gravity", "gravity tilted 3 deg"]
)
def test_an_energy_that_is_much_the_larger_does_not_hide_the_motion(name: str) -> None:
    """A chain that hangs nearly at rest: such faults were called a scale of an energy.

    Tilted, the chain swings.
    """
    bench = _chain()
    entry = diagnosed(bench, _seed(bench, name))
    assert entry.verdict == "named", entry.diagnosis
    assert not entry.diagnosis.motion_agrees


def test_sizes_are_those_that_were_seeded() -> None:
    """And not those of a linear fit: a large fault is measured by solving with it."""
    gravity, energy = (
        diagnosed(_bench(), _seed(_bench(), name)).diagnosis.causes[0]
        for name in ("a quarter of gravity", "half the kinetic energy")
    )
    assert gravity.amount.startswith("-75") and energy.amount == "times 0.5"


def test_the_table_is_large_enough() -> None:
    every = list(seeds(tb.fixed()))
    assert len(every) >= 40 and sum(not seed.causes for seed in every) >= 10
