"""Benchmark problems by name or number."""

from __future__ import annotations

from difflib import get_close_matches

from ..errors import InputError
from .benchmark import Benchmark
from .contacts import CONTACTS
from .elements import ELEMENTS
from .free_bodies import FREE_BODIES
from .linkages import LINKAGES
from .oscillators import OSCILLATORS
from .pendulums import PENDULUMS
from .squeezer import SQUEEZER

_BENCHMARKS = {
    entry.name: entry
    for entry in sorted(
        (*PENDULUMS, *LINKAGES, *CONTACTS, *OSCILLATORS, *ELEMENTS, *FREE_BODIES, SQUEEZER),
        key=lambda entry: entry.number,
    )
}


def benchmarks(tag: str | None = None) -> tuple[Benchmark, ...]:
    """The library in the order of the numbers, or those of its problems that have a tag.

    Raises:
        InputError: no problem has that tag; the sentence lists the tags there are.
    """
    entries = tuple(_BENCHMARKS.values())
    chosen = tuple(entry for entry in entries if tag is None or tag in entry.tags)
    if not chosen:
        tags = sorted({tag for entry in entries for tag in entry.tags})
        raise InputError(f"no problem has the tag {tag!r}; there are: {', '.join(tags)}.")
    return chosen


def find_benchmark(name: str) -> Benchmark | None:
    """The problem of that name or number; None if there is none."""
    return next(
        (entry for entry in _BENCHMARKS.values() if name in (entry.name, entry.number)), None
    )


def benchmark(name: str) -> Benchmark:
    """The problem of that name or number.

    Raises:
        InputError: there is none; the sentence lists those there are.
    """
    found = find_benchmark(name)
    if found is None:
        close = get_close_matches(name, _BENCHMARKS, n=1)
        hint = f" (did you mean {close[0]!r}?)" if close else ""
        known = ", ".join(f"{entry.number} {entry.name}" for entry in _BENCHMARKS.values())
        raise InputError(f"there is no problem {name!r}{hint}; there are: {known}.")
    return found
