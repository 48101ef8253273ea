"""Mechanisms as users give them: a name, a path, a mechanism or a problem, one or several."""

from __future__ import annotations

from collections.abc import Iterable
from os import PathLike
from pathlib import Path

from ..errors import InputError
from ..mechanism import Mechanism
from ..problem import Problem
from ..spec import Spec
from .benchmark import Benchmark
from .registry import benchmark, benchmarks, library_problem, parameters_type
from .registry import model as named_model

Model = str | PathLike[str] | Mechanism | Problem
"""Name of a machine, name or number of a problem of the library, path of a mechanism's .json file,
a mechanism, or a problem."""
Models = Model | Iterable[Model]

_LISTED = "a name, the path of a .json file, a Mechanism or a Problem"


def several(given: Models) -> tuple[str | Mechanism | Problem, ...]:
    """One or several models as a tuple; files are read, names stay names.

    Raises:
        InputError: something is no model, or a file cannot be read.
    """
    if isinstance(given, str | PathLike | Mechanism | Problem):
        return (_loaded(given),)
    if not isinstance(given, Iterable):  # pyright: ignore[reportUnnecessaryIsInstance] - of users
        raise InputError(f"{given!r} is no model; {_LISTED} is needed, or several of them.")
    return tuple(map(_loaded, given))


def models_of(given: Models, parameters: Spec | None = None) -> tuple[Mechanism | Problem, ...]:
    """One or several models as mechanisms, or as problems where the library's are named.

    Args:
        given: one or several.
        parameters: of those given by name; their defaults if left out.

    Raises:
        InputError: as :func:`several`, or nothing has such a name, or its parameters are of another
            class.
    """
    return tuple(
        (library_problem(each, parameters) or named_model(each, parameters))
        if isinstance(each, str)
        else each
        for each in several(given)
    )


def model_of(given: Model, parameters: Spec | None = None) -> Mechanism | Problem:
    """One model, as :func:`models_of` reads it.

    Raises:
        InputError: as :func:`models_of`, or several are given.
    """
    found = models_of(given, parameters)
    if len(found) != 1:
        raise InputError(f"{len(found)} models are given; one is needed: {_LISTED}.")
    return found[0]


def model(given: Model, parameters: Spec | None = None) -> Mechanism:
    """A mechanism by its name, from its file, or of a problem.

    Args:
        given: name of a machine, name or number of a problem, path of a mechanism's .json file, a
            mechanism, or a problem.
        parameters: of what is given by name; their defaults if left out.

    Raises:
        InputError: as :func:`model_of`.
    """
    found = model_of(given, parameters)
    return found.mechanism if isinstance(found, Problem) else found


def problem(name: str, parameters: Spec | None = None) -> Problem:
    """A problem of the library: a mechanism, a duration and a law of its stops.

    Args:
        name: or number.
        parameters: of the problem's own class; its defaults if left out.

    Raises:
        InputError: no problem has that name, or its parameters are of another class.
    """
    found = library_problem(benchmark(name).name, parameters)
    assert found is not None  # `benchmark` refuses what is none
    return found


def problems(tag: str | None = None) -> dict[str, Benchmark]:
    """The problems of the library by name: their source, figures and conditions.

    Args:
        tag: only those that have it, such as 'loop'; all if left out.

    Raises:
        InputError: no problem has that tag; the sentence lists the tags there are.
    """
    return {entry.name: entry for entry in benchmarks(tag)}


def named_parameters(given: Model, parameters: dict[str, float]) -> Spec | None:
    """Parameters of a named model, from numbers by name; None where there are none.

    Raises:
        InputError: a number is no parameter of the model, or the model has no name.
    """
    if not parameters:
        return None
    if not isinstance(given, str) or given.endswith(".json"):
        raise InputError(
            f"{', '.join(parameters)}: only a named model has parameters; this is a mechanism as "
            "it is."
        )
    return parameters_type(given)(**parameters)


def _loaded(given: Model) -> str | Mechanism | Problem:
    if isinstance(given, Mechanism | Problem):
        return given
    if not isinstance(given, str | PathLike):  # pyright: ignore[reportUnnecessaryIsInstance]
        raise InputError(f"{given!r} is no model; {_LISTED} is needed.")
    if isinstance(given, str) and not given.endswith(".json"):
        return given
    return Mechanism.load(Path(given))
