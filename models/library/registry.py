"""Machines and problems by name, and models as users give them: a name, a path or an object."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from difflib import get_close_matches
from os import PathLike
from pathlib import Path
from typing import Any, TypeGuard, cast

import numpy as np
from numpy.typing import ArrayLike

from ..errors import InputError
from ..mechanism import Mechanism
from ..problem import Problem
from ..spec import Spec
from ..stacked import Stack, build_one, columns_of, stack_of
from .benchmark import Benchmark
from .contacts import CONTACTS
from .linkages import LINKAGES
from .pendulums import PENDULUMS
from .single_elements import SINGLE_ELEMENTS
from .trebuchet import (
    CatapultParameters,
    FloatingArmParameters,
    HingedParameters,
    TrebuchetParameters,
    catapult,
    fixed,
    floating_arm,
    hinged,
    parameters_of,
    rolling,
    whipper_numbers,
)

Model = str | PathLike[str] | Mechanism | Problem
"""Name of a machine or of a problem of the library, path of a mechanism's .json file, a mechanism,
or a problem."""
Models = Model | Iterable[Model]
Start = float | Sequence[float] | Mapping[str, float]
"""Values of all coordinates in their order, or of some by name."""

_LISTED = "a name, the path of a file, a Mechanism or a Problem"


@dataclass(frozen=True)
class _Machine:
    build: Callable[[Any], Mechanism]
    parameters: type[Spec]
    text: str


_MACHINES = {
    "fixed": _Machine(
        fixed,
        TrebuchetParameters,
        "whipper trebuchet, fulcrum pinned to the ground (paper, Sec. II)",
    ),
    "rolling": _Machine(
        rolling,
        TrebuchetParameters,
        "whipper trebuchet, fulcrum rolling along x on massless wheels (paper, Sec. VI)",
    ),
    "catapult": _Machine(
        catapult,
        CatapultParameters,
        "one rigid body: counterweight and projectile on one arm (paper, Sec. I)",
    ),
    "hinged": _Machine(
        hinged,
        HingedParameters,
        "hinged counterweight, classical orientation, sling from a trough (Denny, paper Ref. 1)",
    ),
    "floating-arm": _Machine(
        floating_arm,
        FloatingArmParameters,
        "counterweight in a vertical track, arm's wheel on a level one (paper, Sec. VI)",
    ),
}

_PROBLEMS = (*PENDULUMS, *LINKAGES, *CONTACTS, *SINGLE_ELEMENTS)
_BENCHMARKS = {
    p.name: Benchmark(p.number, p.name, p.tags, p.text, p.source, p, p.stop_law)
    for p in sorted(_PROBLEMS, key=lambda p: p.number)
}


def models() -> dict[str, str]:
    """Names and one-line descriptions of the machines, without the problems of the library."""
    return {name: machine.text for name, machine in _MACHINES.items()}


def parameters_type(name: str) -> type[Spec]:
    """The class of the parameters of a named machine or problem.

    Raises:
        InputError: nothing has that name; the sentence lists the names there are.
    """
    return _entry(name).parameters


def _entry(name: str, parameters: Spec | None = None) -> _Machine | Benchmark:
    """The machine or problem of a name, once its parameters are of the right class."""
    entry = _MACHINES.get(name) or find_benchmark(name)
    if entry is None:
        known = f"{', '.join(_MACHINES)}, and the problems that `trebucheck problems` lists"
        raise _unknown("model", name, (*_MACHINES, *_BENCHMARKS), known)
    if parameters is not None and not isinstance(parameters, entry.parameters):
        raise InputError(
            f"model {name!r} is built from {entry.parameters.__name__}, "
            f"not from {type(parameters).__name__}."
        )
    return entry


def _unknown(what: str, name: str, names: Iterable[str], known: str) -> InputError:
    close = get_close_matches(name, list(names), n=1)
    hint = f" (did you mean {close[0]!r}?)" if close else ""
    return InputError(f"there is no {what} {name!r}{hint}; there are: {known}.")


# --- Models as users give them


def several(given: Models) -> tuple[str | Mechanism | Problem, ...]:
    """One or several models as a tuple; files are read, names stay names.

    Raises:
        InputError: something is no model, or a file cannot be read.
    """
    if isinstance(given, str | PathLike | Mechanism | Problem):
        given = (given,)
    elif not isinstance(given, Iterable):  # pyright: ignore[reportUnnecessaryIsInstance] - of users
        raise InputError(f"{given!r} is no model; {_LISTED} is needed, or several of them.")
    read: list[str | Mechanism | Problem] = []
    for model in given:
        if isinstance(model, Mechanism | Problem):
            read.append(model)
        elif not isinstance(model, str | PathLike):  # pyright: ignore[reportUnnecessaryIsInstance]
            raise InputError(f"{model!r} is no model; {_LISTED} is needed.")
        elif isinstance(model, str) and not is_file(model):
            read.append(model)
        else:
            read.append(read_file(Path(model)))
    return tuple(read)


_READERS: dict[str, Callable[[Path], Mechanism]] = {".json": Mechanism.load}


def read_files_by(suffix: str, reader: Callable[[Path], Mechanism]) -> None:
    """Have files whose names end in `suffix`, such as ".xml", read by a function."""
    _READERS[suffix] = reader


def is_file(name: str) -> bool:
    """Tell whether a model's name is that of a file, by its ending."""
    return Path(name).suffix.lower() in _READERS


def read_file(path: Path) -> Mechanism:
    """The mechanism of a file.

    Raises:
        InputError: it cannot be read, or its name has another ending.
    """
    reader = _READERS.get(path.suffix.lower())
    if reader is None:
        known = ", ".join(_READERS)
        raise InputError(f"{path} is no model's file by its ending; read are {known}.")
    return reader(path)


def model_of(given: Model, parameters: Spec | None = None) -> Mechanism | Problem:
    """One model as a mechanism, or as a problem where one of the library is named.

    Args:
        given: a name, a path, a mechanism or a problem.
        parameters: of what is given by name; the defaults if left out.

    Raises:
        InputError: as :func:`several`, or nothing has such a name, or its parameters are of another
            class, or several are given.
    """
    models = several(given)
    if len(models) != 1:
        raise InputError(f"{len(models)} models are given; one is needed: {_LISTED}.")
    (model,) = models
    if not isinstance(model, str):
        return model
    entry, values = _entry(model, parameters), cast("Any", parameters)
    return entry.problem(values) if isinstance(entry, Benchmark) else entry.build(values)


def model(
    given: Model,
    parameters: Spec | None = None,
    *,
    start: Start | None = None,
    start_speeds: Start | None = None,
    **values: float,
) -> Mechanism:
    """A mechanism by its name, from its file, or of a problem.

        >>> from trebucheck.models.library.registry import model
        >>> model("double-pendulum", length=0.5, start={"a1": 1.2}).start
        (1.2, -0.5)

    Args:
        given: name of a machine or of a problem, path of a mechanism's .json file, a mechanism, or
            a problem.
        parameters: of what is given by name; their defaults if left out.
        start: coordinates at t = 0 [rad or m], all in their order or some by name; a number is the
            parameter of that name, or the one coordinate. Those of the model if left out.
        start_speeds: their speeds [rad/s or m/s], likewise.
        values: parameters by name, over those of `parameters`.

    Raises:
        InputError: as :func:`model_of`, or a name or a value is not valid.
    """
    is_parameter = _is_named(given) and "start" in _fields(given)
    if is_parameter and start is not None and not isinstance(start, Iterable):
        values, start = {**values, "start": start}, None
    made = model_of(given, _with_values(given, parameters, values))
    mechanism = made.mechanism if isinstance(made, Problem) else made
    at_rest = (0.0,) * len(mechanism.coordinates)
    changed: dict[str, Any] = {}
    if start is not None:
        changed["start"] = _of_coordinates("start", start, mechanism, mechanism.start)
    if start_speeds is not None:
        before = mechanism.start_speeds or at_rest
        changed["start_speeds"] = _of_coordinates("start_speeds", start_speeds, mechanism, before)
    return Mechanism(**{**mechanism.model_dump(), **changed}) if changed else mechanism


def _with_values(given: Model, parameters: Spec | None, values: dict[str, float]) -> Spec | None:
    """Parameters with some of them changed by name."""
    if parameters is not None and values:
        _refuse_other_fields(given, values)
        return type(parameters)(**{**parameters.model_dump(), **values})
    return named_parameters(given, values) or parameters


def _of_coordinates(
    what: str, given: Start, mechanism: Mechanism, before: tuple[float, ...]
) -> tuple[object, ...]:
    """Values of all coordinates in their order; those of the mechanism where none is given."""
    names = mechanism.coordinates
    if isinstance(given, Mapping):
        for name in given:
            if name not in names:
                raise _unknown("coordinate", str(name), names, ", ".join(names))
        return tuple(given.get(name, value) for name, value in zip(names, before, strict=True))
    values = tuple(given) if isinstance(given, Iterable) else (given,)
    if len(values) != len(names):
        raise InputError(
            f"{what} has {len(values)} values; {mechanism.name!r} needs {len(names)}: "
            f"{', '.join(names)}."
        )
    return values


def library_problem(name: str, parameters: Spec | None = None) -> Problem | None:
    """The run that a problem of the library asks for; None for a machine.

    Raises:
        InputError: as :func:`model`.
    """
    entry = _entry(name, parameters)
    return entry.problem(cast("Any", parameters)) if isinstance(entry, Benchmark) else None


def problem(name: str, parameters: Spec | None = None) -> Problem:
    """A problem of the library: a mechanism, a duration and a law of its stops.

    Args:
        name: of the problem, or the number by which the library sorts it.
        parameters: of the problem's own class; its defaults if left out.

    Raises:
        InputError: no problem has that name, or its parameters are of another class.
    """
    made = library_problem(benchmark(name).name, parameters)
    assert made is not None  # `benchmark` refuses what is none
    return made


def named_parameters(given: Model, parameters: dict[str, float]) -> Spec | None:
    """Parameters of a named model, from numbers by name; None where there are none.

    Raises:
        InputError: a number is no parameter of the model, or the model has no name.
    """
    if not parameters:
        return None
    _refuse_other_fields(given, parameters)
    return parameters_type(str(given))(**parameters)


def _refuse_other_fields(given: Model, values: Iterable[str]) -> None:
    """Raises InputError for a name that is no parameter of a model, or a model without a name."""
    if not _is_named(given):
        raise InputError(
            f"{', '.join(values)}: only a named model has parameters; this is a mechanism as it is."
        )
    fields = _fields(given)
    for name in values:
        if name not in fields:
            close = get_close_matches(name, [*fields, *_START], n=1)
            hint = f" (did you mean {close[0]!r}?)" if close else ""
            known = ", ".join(fields)
            raise InputError(f"model {given!r} has no parameter {name!r}{hint}; it has: {known}.")


_START = ("start", "start_speeds")  # keywords for any model


def _is_named(given: Model) -> TypeGuard[str]:
    """Tell whether a model is given by its name."""
    return isinstance(given, str) and not is_file(given)


def _fields(name: str) -> tuple[str, ...]:
    """Names of the parameters of a machine or problem."""
    return tuple(parameters_type(name).model_fields)


def varied(given: Model, values: Mapping[str, ArrayLike]) -> Sequence[Mechanism]:
    """Machines that differ from a model in arrays of its parameters, or of its numbers.

    The fixed and the rolling machine, and any mechanism in its numbers, are made and checked in
    arrays; machines of other parameters one by one.

    Args:
        given: as :func:`model`.
        values: parameters of a named machine, such as "l1", or numbers of the mechanism by the path
            of their field, such as "bodies.arm.mass" or "start.1"; each a sequence of n numbers, or
            one number for all machines.

    Raises:
        InputError: as :func:`model`; a name is none of a parameter or number, values are no arrays
            of one length, or a machine cannot be built: the sentence says which one, and why.
    """
    machine, columns = model(given), columns_of(values)
    example: Spec | None = parameters_of(machine)
    build = _MACHINES[machine.name].build if example is not None else None
    if build is None and isinstance(given, str) and given in _MACHINES:
        example, build = _MACHINES[given].parameters(), _MACHINES[given].build
    if example is None or build is None or not columns.keys() & type(example).model_fields.keys():
        machines = stack_of(machine, columns)
        machines.refuse()
        return machines
    unknown = [name for name in columns if name not in type(example).model_fields]
    if unknown:
        raise InputError(
            f"{unknown[0]!r} is no parameter of {machine.name!r}; there are: "
            f"{', '.join(type(example).model_fields)}."
        )
    base, n = dict(example), len(next(iter(columns.values())))

    def one(row: dict[str, float]) -> Mechanism:
        return build(type(example)(**(base | row)))

    if isinstance(example, TrebuchetParameters):
        with np.errstate(over="ignore", invalid="ignore"):
            numbers = whipper_numbers(base | columns)
        arrays = {name: np.broadcast_to(number, (n,)) for name, number in numbers.items()}
        machines = Stack(machine, columns, one, arrays)
        machines.refuse()
        return machines
    return [build_one(one, columns, i) for i in range(n)]


# --- Problems of the library


def problems(tag: str | None = None) -> dict[str, Benchmark]:
    """The problems of the library by name: their source, figures and conditions.

    Args:
        tag: only those that have it, such as 'loop'; all if left out.

    Raises:
        InputError: no problem has that tag; the sentence lists the tags there are.
    """
    chosen = {name: entry for name, entry in _BENCHMARKS.items() if tag in (None, *entry.tags)}
    if not chosen:
        tags = {tag for entry in _BENCHMARKS.values() for tag in entry.tags}
        raise InputError(f"no problem has the tag {tag!r}; there are: {', '.join(sorted(tags))}.")
    return chosen


def benchmarks(tag: str | None = None) -> tuple[Benchmark, ...]:
    """The problems of the library, in the order of their numbers; as :func:`problems`."""
    return tuple(problems(tag).values())


def find_benchmark(name: str) -> Benchmark | None:
    """The problem of that name or number; None if there is none."""
    for entry in _BENCHMARKS.values():
        if name in (entry.name, entry.number):
            return entry
    return None


def benchmark(name: str) -> Benchmark:
    """The problem of that name or number.

    Raises:
        InputError: there is none; the sentence lists those there are.
    """
    entry = find_benchmark(name)
    if entry is None:
        known = ", ".join(_BENCHMARKS)
        raise _unknown("problem", name, _BENCHMARKS, known)
    return entry
