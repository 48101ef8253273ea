"""Options that several commands share, and how their texts are read."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from ..models.errors import InputError
from . import completion

if TYPE_CHECKING:
    from ..models.library.trebuchet import TrebuchetParameters
    from ..models.mechanism import Mechanism
    from ..models.problem import Problem
    from ..models.spec import Spec

MACHINES = (
    "fixed, rolling, catapult, hinged, floating-arm, a problem (`trebucheck problems`), "
    "or a .json file"
)

Models = Annotated[
    str,
    typer.Option(
        "--models",
        "--model",
        autocompletion=completion.machines,
        help=f"Machines, comma-separated: {MACHINES}.",
    ),
]
Model = Annotated[
    str,
    typer.Option(
        "--model", "--models", autocompletion=completion.machines, help=f"Machine: {MACHINES}."
    ),
]
Engines = Annotated[
    str | None,
    typer.Option(
        "--engines",
        "--engine",
        autocompletion=completion.engines,
        help="Engines, comma-separated; all by default.",
    ),
]
Preset = Annotated[
    str,
    typer.Option(
        "--preset",
        "--presets",
        autocompletion=completion.presets,
        help="tuned, stock, or both: tuned,stock.",
    ),
]
Timestep = Annotated[
    float | None,
    typer.Option("--timestep", help="Step of every engine (s); else the preset's own."),
]
Duration = Annotated[
    float | None,
    typer.Option(
        "--duration",
        help="Compared or simulated time (s); the problem's, else to the launch, by default.",
    ),
]
Set = Annotated[
    list[str] | None,
    typer.Option(
        "--set", metavar="NAME=VALUE", help="A parameter of the machine, SI units; repeatable."
    ),
]
Beam = Annotated[
    float | None,
    typer.Option("--beam", help="Keep l1 + l2 at this length (m): l2 follows from l1 (paper: 14)."),
]
Until = Annotated[
    str | None,
    typer.Option(
        "--until",
        help="End of the compared motion: launch, launch:MARKER, release:STOP, or a time (s); "
        "else the problem's own, "
        "or the launch.",
    ),
]
Tolerance = Annotated[
    list[str] | None,
    typer.Option(
        "--tolerance",
        metavar="QUANTITY=VALUE",
        help="What is asked for, e.g. position=1e-3, energy=0.1%, release:STOP=1e-6, "
        "default=1%; repeatable.",
    ),
]
Tolerances = Annotated[
    Path | None,
    typer.Option(
        "--tolerances", help='The same from a JSON file: {"tolerances": {"position": 1e-3}}.'
    ),
]
Resume = Annotated[bool, typer.Option("--resume", help="Take finished runs from the folder again.")]
Jobs = Annotated[
    int,
    typer.Option(
        "--jobs",
        "-j",
        help="Processes at once. With more than one, wall times include what runs cost each other.",
    ),
]
Diagnose = Annotated[
    bool,
    typer.Option(
        "--diagnose/--no-diagnose",
        help="Look for the causes of exceeded tolerances; without it, compare takes less time.",
    ),
]
Quiet = Annotated[
    bool, typer.Option("--quiet", "-q", help="Print only the verdict in a line, and the files.")
]
Json = Annotated[bool, typer.Option("--json", help="Print the results as JSON, and nothing else.")]
Timeout = Annotated[float, typer.Option("--timeout", help="Longest wait for one run (s).")]
StopLaw = Annotated[
    str | None,
    typer.Option(
        "--stop-law",
        help="release-once or unilateral; by default the problem's own, else release-once.",
    ),
]
EngineOption = Annotated[
    list[str] | None,
    typer.Option(
        "--option",
        metavar="[ENGINE.]NAME=VALUE",
        autocompletion=completion.options,
        help="A numerical option, of every engine that has it, or of ENGINE; lists as 1,2,3; "
        "repeatable. "
        "`trebucheck engines ENGINE` lists them.",
    ),
]


@dataclass(frozen=True)
class Declared:
    """An option as a command takes it: its annotated type, and its default."""

    annotation: Any
    default: Any

    def by_default(self, default: object) -> Declared:
        """The same with another default."""
        return replace(self, default=default)


# The options that several commands share, by the names that their values have in a call.
OPTIONS = {
    "models": Declared(Models, "fixed,rolling"),
    "model": Declared(Model, "fixed"),
    "engines": Declared(Engines, None),
    "preset": Declared(Preset, "tuned,stock"),
    "timestep": Declared(Timestep, None),
    "duration": Declared(Duration, None),
    "until": Declared(Until, None),
    "set": Declared(Set, None),
    "beam": Declared(Beam, None),
    "tolerance": Declared(Tolerance, None),
    "tolerances": Declared(Tolerances, None),
    "option": Declared(EngineOption, None),
    "stop_law": Declared(StopLaw, None),
    "resume": Declared(Resume, False),
    "jobs": Declared(Jobs, 1),
    "diagnose": Declared(Diagnose, True),
    "timeout": Declared(Timeout, 600.0),
    "quiet": Declared(Quiet, False),
    "json": Declared(Json, False),
}


def out(text: str) -> Any:
    """The option --out of a command; `text` is its help."""
    return typer.Option("--out", parser=_path, metavar="PATH", help=text)


def _path(text: str | Path) -> Path:
    if not str(text).strip():
        raise typer.BadParameter("it is empty; a name is needed (the folder one is in is '.').")
    return Path(text)


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

        kind = parameters_type(name)
        known = list(kind.model_fields)
        for given in self.numbers:
            if given not in known:
                raise InputError(
                    f"--set {given}: there is no such parameter; there are: {', '.join(known)} "
                    f"(of {name})."
                )
        if not self:
            return None
        return kind(**(self.numbers | self._short_end(kind)))

    def whipper(self, name: str) -> TrebuchetParameters | None:
        """The same for a machine of the paper; None, too, for any other."""
        from ..models.library.registry import models
        from ..models.library.trebuchet import TrebuchetParameters

        parameters = self.of(name) if name in models() else None
        return parameters if isinstance(parameters, TrebuchetParameters) else None

    def _short_end(self, kind: type[Spec]) -> dict[str, float]:
        from ..models.library.trebuchet import short_end

        if self.beam is None:
            return {}
        if "l1" not in kind.model_fields or "l2" not in kind.model_fields:
            raise InputError(
                f"--beam {self.beam!r} keeps l1 + l2 of a trebuchet; these parameters have no "
                f"l1 and l2."
            )
        l1 = self.numbers["l1"] if "l1" in self.numbers else float(kind.model_fields["l1"].default)
        if "l2" in self.numbers:
            raise InputError("--beam chooses l2 itself; leave out --set l2, or --beam.")
        return {"l2": short_end(l1, self.beam)}


def parameters(texts: list[str] | None, beam: float | None) -> Chosen:
    """Parameters from --set and --beam.

    Raises:
        InputError: a value is not a number.
    """
    return Chosen(
        {
            name: number(value, f"--set {name} =")
            for name, value in assignments(texts, "--set").items()
        },
        beam,
    )


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
    from ..engines.registry import engine_names, refuse_unknown_options

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
        except (
            ValueError,
            RecursionError,
        ):  # no JSON, or a number of thousands of digits, or nested too deep
            continue
    return text
