"""Machines and problems of the library by name."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from difflib import get_close_matches
from typing import Any, cast

from ..errors import InputError
from ..mechanism import Mechanism
from ..problem import Problem
from ..spec import Spec
from .benchmark import Benchmark, BenchmarkParameters
from .contacts import CONTACTS
from .linkages import LINKAGES
from .pendulums import PENDULUMS
from .single_elements import SINGLE_ELEMENTS
from .squeezer import SqueezerParameters
from .trebuchet import (
    CatapultParameters,
    FloatingArmParameters,
    HingedParameters,
    TrebuchetParameters,
    catapult,
    fixed,
    floating_arm,
    hinged,
    rolling,
)


@dataclass(frozen=True)
class _Model:
    build: Callable[[Any], Mechanism]
    parameters: type[Spec]
    text: str


_MODELS = {
    "fixed": _Model(
        fixed,
        TrebuchetParameters,
        "whipper trebuchet, fulcrum pinned to the ground (paper, Sec. II)",
    ),
    "rolling": _Model(
        rolling,
        TrebuchetParameters,
        "whipper trebuchet, fulcrum rolling along x on massless wheels (paper, Sec. VI)",
    ),
    "catapult": _Model(
        catapult,
        CatapultParameters,
        "one rigid body: counterweight and projectile on one arm (paper, Sec. I)",
    ),
    "hinged": _Model(
        hinged,
        HingedParameters,
        "hinged counterweight, classical orientation, sling from a trough (Denny, paper Ref. 1)",
    ),
    "floating-arm": _Model(
        floating_arm,
        FloatingArmParameters,
        "counterweight in a vertical track, arm's wheel on a level one (paper, Sec. VI)",
    ),
}


def models() -> dict[str, str]:
    """Names and one-line descriptions of the machines, without the problems of the library."""
    return {name: entry.text for name, entry in _MODELS.items()}


def parameters_type(name: str) -> type[Spec]:
    """The class of the parameters of a named machine or problem.

    Raises:
        InputError: nothing has that name; the sentence lists the names there are.
    """
    return _entry(name).parameters


def model(name: str, parameters: Spec | None = None) -> Mechanism:
    """A named machine, or the mechanism of a problem of the library.

    Args:
        name: of a machine; name or number of a problem.
        parameters: of the class that :func:`parameters_type` says; its defaults where left out.

    Raises:
        InputError: nothing has that name, or its parameters are of another class.
    """
    return _entry(name, parameters).build(parameters)


def library_problem(name: str, parameters: Spec | None = None) -> Problem | None:
    """The run that a problem of the library asks for; None for a machine.

    Raises:
        InputError: as :func:`model`.
    """
    _entry(name, parameters)
    problem_entry = find_benchmark(name)
    if problem_entry is None:
        return None
    return problem_entry.problem(cast("BenchmarkParameters | None", parameters))


def _entry(name: str, parameters: Spec | None = None) -> _Model:
    entry = _MODELS.get(name) or _of_library(name)
    if entry is None:
        close = get_close_matches(name, (*_MODELS, *(known.name for known in benchmarks())), n=1)
        hint = f" (did you mean {close[0]!r}?)" if close else ""
        known = f"{', '.join(_MODELS)}, and the problems that `trebucheck problems` lists"
        raise InputError(f"there is no model {name!r}{hint}; there are: {known}.")
    if parameters is not None and not isinstance(parameters, entry.parameters):
        raise InputError(
            f"model {name!r} is built from {entry.parameters.__name__}, "
            f"not from {type(parameters).__name__}."
        )
    return entry


def _of_library(name: str) -> _Model | None:
    problem_entry = find_benchmark(name)
    if problem_entry is None:
        return None
    return _Model(
        lambda given: problem_entry.problem(given).mechanism,
        problem_entry.parameters,
        problem_entry.text,
    )


_PROBLEMS = (*PENDULUMS, *LINKAGES, *CONTACTS, *SINGLE_ELEMENTS, SqueezerParameters)
_BENCHMARKS = {
    p.name: Benchmark(p.number, p.name, p.tags, p.text, p.source, p, p.stop_law)
    for p in sorted(_PROBLEMS, key=lambda p: p.number)
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
    problem_entry = find_benchmark(name)
    if problem_entry is None:
        close = get_close_matches(name, _BENCHMARKS, n=1)
        hint = f" (did you mean {close[0]!r}?)" if close else ""
        known = ", ".join(f"{entry.number} {entry.name}" for entry in _BENCHMARKS.values())
        raise InputError(f"there is no problem {name!r}{hint}; there are: {known}.")
    return problem_entry
