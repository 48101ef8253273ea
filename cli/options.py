"""Options that several commands share: flags, defaults, completion, and how texts are read."""

from __future__ import annotations

import inspect
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from ..models.errors import InputError

if TYPE_CHECKING:
    from ..models.library.trebuchet import TrebuchetParameters
    from ..models.mechanism import Mechanism
    from ..models.problem import Problem
    from ..models.spec import Spec

MACHINES = (
    "fixed, rolling, catapult, hinged, floating-arm, a problem (`trebucheck problems`), "
    "or a .json file"
)


# -------------------------------------------------------------------- completion in shells


def _completion(names: Callable[[], Iterable[str]] | None) -> Callable[[str], list[str]] | None:
    """Completion of the last name of a comma list, without those that stand before it."""
    if names is None:
        return None

    def completed(incomplete: str) -> list[str]:
        before, comma, last = incomplete.rpartition(",")
        given = before.split(",")
        return [
            f"{before}{comma}{name}"
            for name in names()
            if name.startswith(last) and name not in given
        ]

    return completed


def problem_names() -> list[str]:
    """Names of the problems of the library."""
    from ..models.library.registry import benchmarks

    return [problem.name for problem in benchmarks(None)]


def machine_names() -> list[str]:
    """Names of machines and problems."""
    from ..models.library.registry import models

    return [*models(), *problem_names()]


def engine_names() -> tuple[str, ...]:
    """Names of engines, plug-ins among them."""
    from ..engines.registry import engine_names

    return engine_names()


def preset_names() -> list[str]:
    """Names of the presets of all engines."""
    from ..engines.registry import engine_class

    presets = [preset for name in engine_names() for preset in engine_class(name).presets()]
    return list(dict.fromkeys(presets))


def _assigned_options() -> list[str]:
    from ..engines.registry import option_names

    return [f"{name}.{option}=" for name in engine_names() for option in option_names(name) or ()]


# ------------------------------------------------------------------------------ declarations


@dataclass(frozen=True)
class Declared:
    """An option as a command takes it: its annotated type, and its default."""

    annotation: Any
    default: Any


def option(
    flags: str,
    help: str,
    kind: Any = str | None,
    default: Any = None,
    names: Callable[[], Iterable[str]] | None = None,
    **info: Any,
) -> Declared:
    """Declare an option.

    Args:
        flags: separated by blanks; empty: made from the name.
        help: what the help says of it.
        kind: its type.
        default: its value where it is not given; `...`: it must be given.
        names: what shells complete it with.
        info: further arguments of `typer.Option`.
    """
    found = typer.Option(*flags.split(), help=help, autocompletion=_completion(names), **info)
    return Declared(Annotated[kind, found], default)


def argument(
    help: str,
    kind: Any = str,
    default: Any = inspect.Parameter.empty,
    names: Callable[[], Iterable[str]] | None = None,
    **info: Any,
) -> Declared:
    """Declare an argument; without a default it must be given. See :func:`option`."""
    found = typer.Argument(help=help, autocompletion=_completion(names), **info)
    return Declared(Annotated[kind, found], default)


def folder(default: str | None, text: str) -> Declared:
    """Declare the option --out; `text` is its help."""
    kind: Any = Path | None if default is None else Path
    return Declared(Annotated[kind, out(text)], None if default is None else Path(default))


def out(text: str) -> Any:
    """Make the option --out of a command; `text` is its help."""

    def path(value: str | Path) -> Path:
        if not str(value).strip():
            raise typer.BadParameter("it is empty; a name is needed (the folder one is in is '.').")
        return Path(value)

    return typer.Option("--out", parser=path, metavar="PATH", help=text)


# For commands of other distributions, which are annotated functions.
Engines = Annotated[
    str | None,
    typer.Option(
        "--engines",
        "--engine",
        autocompletion=_completion(engine_names),
        help="Engines, comma-separated; all by default.",
    ),
]
Quiet = Annotated[
    bool, typer.Option("--quiet", "-q", help="Print only the verdict in a line, and the files.")
]
Json = Annotated[bool, typer.Option("--json", help="Print the results as JSON, and nothing else.")]

# The options that several commands share, by the names that their values have in a call.
OPTIONS = {
    "models": option(
        "--models --model",
        f"Machines, comma-separated: {MACHINES}.",
        str,
        "fixed,rolling",
        names=machine_names,
    ),
    "model": option("--model --models", f"Machine: {MACHINES}.", str, "fixed", names=machine_names),
    "engines": Declared(Engines, None),
    "preset": option(
        "--preset --presets",
        "tuned, stock, or both: tuned,stock.",
        str,
        "tuned,stock",
        names=preset_names,
    ),
    "timestep": option(
        "--timestep", "Step of every engine (s); else the preset's own.", float | None
    ),
    "duration": option(
        "--duration",
        "Compared or simulated time (s); the problem's, else to the launch, by default.",
        float | None,
    ),
    "until": option(
        "--until",
        "End of the compared motion: launch, launch:MARKER, release:STOP, or a time (s); "
        "else the problem's own, or the launch.",
    ),
    "set": option(
        "--set",
        "A parameter of the machine, SI units; repeatable.",
        list[str] | None,
        metavar="NAME=VALUE",
    ),
    "beam": option(
        "--beam", "Keep l1 + l2 at this length (m): l2 follows from l1 (paper: 14).", float | None
    ),
    "tolerance": option(
        "--tolerance",
        "What is asked for, e.g. position=1e-3, energy=0.1%, release:STOP=1e-6, "
        "default=1%; repeatable.",
        list[str] | None,
        metavar="QUANTITY=VALUE",
    ),
    "tolerances": option(
        "--tolerances",
        'The same from a JSON file: {"tolerances": {"position": 1e-3}}.',
        Path | None,
    ),
    "option": option(
        "--option",
        "A numerical option, of every engine that has it, or of ENGINE; lists as 1,2,3; "
        "repeatable. `trebucheck engines ENGINE` lists them.",
        list[str] | None,
        metavar="[ENGINE.]NAME=VALUE",
        names=_assigned_options,
    ),
    "stop_law": option(
        "--stop-law", "release-once or unilateral; by default the problem's own, else release-once."
    ),
    "resume": option("--resume", "Take finished runs from the folder again.", bool, False),
    "jobs": option(
        "--jobs -j",
        "Processes at once. With more than one, wall times include what runs cost each other.",
        int,
        1,
    ),
    "diagnose": option(
        "--diagnose/--no-diagnose",
        "Look for the causes of exceeded tolerances; without it, compare takes less time.",
        bool,
        True,
    ),
    "timeout": option("--timeout", "Longest wait for one run (s).", float, 600.0),
    "quiet": Declared(Quiet, False),
    "json": Declared(Json, False),
}


# --------------------------------------------------------------------------- texts to values


def positive(value: float, option: str) -> float:
    """A number that must be greater than zero.

    Raises:
        InputError: it is not.
    """
    if not value > 0:
        raise InputError(f"{option} {value!r} must be positive.")
    return value


def names(text: str, what: str) -> list[str]:
    """Split a comma list.

    Raises:
        InputError: the list is empty.
    """
    names = [part.strip() for part in text.split(",") if part.strip()]
    if not names:
        raise InputError(f"{what} is empty; at least one name is needed.")
    return names


def assignments(texts: list[str] | None, option: str) -> dict[str, str]:
    """NAME=VALUE texts as a mapping.

    Raises:
        InputError: a text has no '=', or a name stands twice.
    """
    values: dict[str, str] = {}
    for text in texts or []:
        name, separator, value = text.partition("=")
        if not separator or not name.strip() or not value.strip():
            raise InputError(f"{option} {text!r} must have the form NAME=VALUE.")
        if name.strip() in values:
            raise InputError(f"{option} names {name.strip()!r} twice.")
        values[name.strip()] = value.strip()
    return values


@dataclass(frozen=True)
class Chosen:
    """Values of --set and --beam, before it is known of which machine."""

    numbers: dict[str, float]
    beam: float | None

    def __bool__(self) -> bool:
        return bool(self.numbers) or self.beam is not None

    def of(self, name: str) -> Spec | None:
        """Parameters of a named machine; None where nothing was chosen.

        Raises:
            InputError: the machine, or one of the names, is unknown, or a value is not valid.
        """
        from ..models.library.registry import parameters_type
        from ..models.library.trebuchet import short_end

        kind = parameters_type(name)
        fields = kind.model_fields
        for parameter in self.numbers:
            if parameter not in fields:
                raise InputError(
                    f"--set {parameter}: there is no such parameter; there are: "
                    f"{', '.join(fields)} (of {name})."
                )
        if not self:
            return None
        values = dict(self.numbers)
        if self.beam is not None:
            if not {"l1", "l2"} <= fields.keys():
                raise InputError(
                    f"--beam {self.beam!r} keeps l1 + l2 of a trebuchet; these parameters have no "
                    f"l1 and l2."
                )
            if "l2" in values:
                raise InputError("--beam chooses l2 itself; leave out --set l2, or --beam.")
            l1 = values["l1"] if "l1" in values else float(fields["l1"].default)
            values["l2"] = short_end(l1, self.beam)
        return kind(**values)

    def whipper(self, name: str) -> TrebuchetParameters | None:
        """The same for a machine of the paper; None, too, for any other."""
        from ..models.library.registry import models
        from ..models.library.trebuchet import TrebuchetParameters

        parameters = self.of(name) if name in models() else None
        return parameters if isinstance(parameters, TrebuchetParameters) else None


def parameters(texts: list[str] | None, beam: float | None) -> Chosen:
    """Read parameters from --set and --beam.

    Raises:
        InputError: a value is not a number.
    """
    numbers: dict[str, float] = {}
    for name, value in assignments(texts, "--set").items():
        numbers[name] = number(value, f"--set {name} =")
    return Chosen(numbers, beam)


def number(text: str, what: str) -> float:
    """A number.

    Raises:
        InputError: the text is none.
    """
    try:
        return float(text)
    except ValueError:
        raise InputError(f"{what} {text!r} is not a number.") from None


def given(text: str, texts: list[str] | None, beam: float | None) -> list[Mechanism | Problem]:
    """Read mechanisms by name or from files, and problems of the library; --set and --beam apply.

    Parameters of --set and --beam are those of named machines.

    Raises:
        InputError: a name is unknown, a parameter is not valid, or a file cannot be read or is not
            a mechanism.
    """
    from ..models.library.registry import library_problem, model
    from ..models.mechanism import Mechanism

    chosen = parameters(texts, beam)
    found: list[Mechanism | Problem] = []
    for name in names(text, "--models"):
        if not name.endswith(".json"):
            found.append(library_problem(name, chosen.of(name)) or model(name, chosen.of(name)))
        elif chosen:
            raise InputError(
                f"--set and --beam are for named machines; {name} holds its own values."
            )
        else:
            found.append(Mechanism.load(Path(name)))
    return found


def only(
    text: str, texts: list[str] | None, beam: float | None, command: str
) -> Mechanism | Problem:
    """Read the one model of a command that takes one; see :func:`given`.

    Raises:
        InputError: as :func:`given`, or there are several.
    """
    found = given(text, texts, beam)
    if len(found) != 1:
        raise InputError(f"--model {text!r} names {len(found)} machines; `{command}` takes one.")
    return found[0]


def chosen_names(text: str | None, what: str) -> list[str] | None:
    """Split a comma list; None, which stands for all, where nothing is said.

    Raises:
        InputError: the list is empty.
    """
    return None if text is None else names(text, what)


def needs(texts: list[str] | None, file: Path | None) -> dict[str, float | str]:
    """Tolerances from --tolerance and the file of --tolerances; those of the command line go first.

    Raises:
        InputError: a text has not its form, or the file cannot be read or holds something else.
    """
    from ..comparisons.runs.tolerances import ToleranceFile

    from_file = {} if file is None else ToleranceFile.load(file).tolerances
    return {**from_file, **assignments(texts, "--tolerance")}


def engine_options(
    texts: list[str] | None, timestep: float | None, engines: list[str] | None = None
) -> dict[str, Any]:
    """--option values as JSON where they are JSON, lists also without brackets, else as text.

    The engine itself validates them.

    Args:
        timestep: of --timestep [s].
        engines: names of those they are for; None: all.

    Raises:
        InputError: an option is chosen by another flag, or is there twice, or none of the engines
            has it.
    """
    from ..engines.registry import refuse_unknown_options

    options = {name: _value(value) for name, value in assignments(texts, "--option").items()}
    refuse_unknown_options(options, engines or engine_names())
    if timestep is None:
        return options
    if "timestep" in options:
        raise InputError(
            f"--timestep {timestep:g} and --option timestep are both given; leave out one of them."
        )
    return {**options, "timestep": timestep}


def _value(text: str) -> object:
    """Value of an option: JSON where it is, else text."""
    import json

    for form in (text, f"[{text}]") if "," in text else (text,):
        try:
            return json.loads(form)
        # No JSON, or a number of thousands of digits, or nested too deep.
        except (ValueError, RecursionError):
            continue
    return text
