"""Options that several commands share: flags, defaults, completion, and how texts are read."""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Iterable
from contextlib import suppress
from inspect import Parameter
from pathlib import Path
from typing import Annotated, Any

import typer

from ..models.errors import InputError

MACHINES = (
    "fixed, rolling, catapult, hinged, floating-arm, a problem (`trebucheck problems`), "
    "or a .json, .xml (MJCF) or .urdf file"
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
    from ..engines.presets import GIVEN, PRESETS
    from ..engines.registry import engines

    presets = [preset for status in engines().values() for preset in status.presets]
    return list(dict.fromkeys((*PRESETS, *presets, GIVEN)))


def _assigned_options() -> list[str]:
    from ..engines.registry import engines, option_names

    usable = [name for name, status in engines().items() if not status.broken]
    return [f"{name}.{option}=" for name in usable for option in option_names(name) or ()]


# ------------------------------------------------------------------------------ declarations


def _declared(kind: Any, info: Any, default: Any) -> Parameter:
    """An option or argument of a command, which gives it its name."""
    return Parameter("_", Parameter.KEYWORD_ONLY, default=default, annotation=Annotated[kind, info])


def _of_kind(kind: Any) -> dict[str, Any]:
    """Reader of a number or a path, whose complaint names the text."""
    if kind in (float, float | None):
        return {"parser": _real}
    if kind in (int, int | None):
        return {"parser": _whole}
    if kind in (Path, Path | None, list[Path]):
        return {"parser": _path}
    return {}


def _real(text: str | float) -> float:
    try:
        return float(text)
    except ValueError:
        raise typer.BadParameter(f"{text!r} is not a number.") from None


def _whole(text: str | int) -> int:
    try:
        return int(text)
    except ValueError:
        raise typer.BadParameter(f"{text!r} is not a whole number.") from None


def positive_number(text: str | float) -> float:
    """Read a number of an option that must be greater than zero."""
    value = _real(text)
    if not value > 0:
        raise typer.BadParameter(f"{value!r} must be positive.")
    return value


def _path(text: str | Path) -> Path:
    if not str(text).strip():
        raise typer.BadParameter("it is empty; a name is needed (the folder one is in is '.').")
    return Path(text)


def option(
    flags: str,
    help: str,
    kind: Any = str | None,
    default: Any = None,
    names: Callable[[], Iterable[str]] | None = None,
    **info: Any,
) -> Parameter:
    """Declare an option.

    Args:
        flags: separated by blanks; empty: made from the name.
        help: what the help says of it.
        kind: its type.
        default: its value where it is not given; `...`: it must be given.
        names: what shells complete it with.
        info: further arguments of `typer.Option`.
    """
    info = _of_kind(kind) | info | {"help": help, "autocompletion": _completion(names)}
    return _declared(kind, typer.Option(*flags.split(), **info), default)


def argument(
    help: str,
    kind: Any = str,
    default: Any = Parameter.empty,
    names: Callable[[], Iterable[str]] | None = None,
    **info: Any,
) -> Parameter:
    """Declare an argument; without a default it must be given. See :func:`option`."""
    info = _of_kind(kind) | info | {"help": help, "autocompletion": _completion(names)}
    return _declared(kind, typer.Argument(**info), default)


def folder(default: str | None, text: str) -> Parameter:
    """Declare the option --out; `text` is its help."""
    if default is None:
        return _declared(Path | None, out(text), None)
    return _declared(Path, out(text), Path(default))


def out(text: str) -> Any:
    """Make the option --out of a command; `text` is its help."""
    return typer.Option("--out", parser=_path, metavar="PATH", help=text)


def timeout(default: float, text: str) -> Parameter:
    """Declare the option --timeout; `text` is its help."""
    return option("--timeout", text, float, default, parser=positive_number)


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
    "engines": option(
        "--engines --engine", "Engines, comma-separated; all by default.", names=engine_names
    ),
    "preset": option(
        "--preset --presets",
        "default, settings, assisted, comma-separated; all that an engine has by default.",
        str | None,
        None,
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
        "Processes at once; as many as cores are idle by default, or 1 where times are shown: with "
        "more than one, wall times include what runs cost each other.",
        int | None,
        None,
    ),
    "cluster": option(
        "--cluster",
        "Dask cluster that makes the runs: its scheduler's address (tcp://HOST:PORT) or file.",
        str | None,
        None,
    ),
    "diagnose": option(
        "--diagnose/--no-diagnose",
        "Look for the causes of exceeded tolerances; without it, compare takes less time.",
        bool,
        True,
    ),
    "sweep": option(
        "--sweep",
        "Run at other time steps as well, for diagrams of cost and error.",
        bool,
        False,
    ),
    "timeout": timeout(600.0, "Longest wait for one run (s)."),
    "keyframe": option("--keyframe", "Name or number of the file's keyframe to start from."),
    "qpos": option("--qpos", "Positions at the start, in the file's order (rad, m), as 0.1,0,2."),
    "qvel": option("--qvel", "Velocities at the start, in the file's order (rad/s, m/s)."),
    "ctrl": option(
        "--ctrl",
        "Controls in the file's order, constant; or recorded, the path of a .csv or .npz file.",
    ),
    "without": option(
        "--without",
        "Features to leave out: limits, friction-loss, fluid, actuators, equalities, tendons.",
    ),
    "quiet": option("--quiet -q", "Print only the verdict in a line, and the files.", bool, False),
    "json": option("--json", "Print the results as JSON, and nothing else.", bool, False),
}

# For commands of other distributions, which are annotated functions.
Engines = OPTIONS["engines"].annotation
Quiet = OPTIONS["quiet"].annotation
Json = OPTIONS["json"].annotation


# --------------------------------------------------------------------------- texts to values


def names(text: str, what: str) -> list[str]:
    """Split a comma list; InputError if the list or a part of it is empty."""
    names = [part.strip() for part in text.split(",")]
    if not any(names):
        raise InputError(f"{what} is empty; at least one name is needed.")
    if not all(names):
        raise InputError(f"{what} = {text!r} has nothing between two commas or at an end.")
    return names


def numbers(text: str, what: str) -> list[float]:
    """Split a comma list of numbers; InputError if one is none, or not finite."""
    values: list[float] = []
    for part in names(text, what):
        try:
            values.append(float(part))
        except ValueError:
            values.append(math.nan)
        if not math.isfinite(values[-1]):
            raise InputError(f"{what} = {text!r}: {part!r} is no finite number.")
    return values


def assignments(texts: list[str] | None, option: str) -> dict[str, str]:
    """NAME=VALUE texts as a mapping; InputError if a text has no '=', or a name stands twice."""
    values: dict[str, str] = {}
    for text in texts or []:
        name, separator, value = text.partition("=")
        if not separator or not all(map(str.strip, (*name.split("."), value))):
            raise InputError(f"{option} {text!r} must have the form NAME=VALUE.")
        if name.strip() in values:
            raise InputError(f"{option} names {name.strip()!r} twice.")
        values[name.strip()] = value.strip()
    return values


def number(text: str, what: str) -> float:
    """A number; InputError if the text is none."""
    try:
        return float(text)
    except ValueError:
        raise InputError(f"{what} {text!r} is not a number.") from None


def chosen_names(text: str | None, what: str) -> list[str] | None:
    """Split a comma list; None, which stands for all, where nothing is said.

    Raises:
        InputError: the list is empty.
    """
    return None if text is None else names(text, what)


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

    options: dict[str, Any] = {}
    for name, text in assignments(texts, "--option").items():
        options[name] = text
        for form in (text, f"[{text}]") if "," in text else (text,):
            # No JSON, or a number of thousands of digits, or nested too deep.
            with suppress(ValueError, RecursionError):
                options[name] = json.loads(form)
                break
    refuse_unknown_options(options, engines or engine_names())
    if timestep is None:
        return options
    if "timestep" in options:
        raise InputError(
            f"--timestep {timestep:g} and --option timestep are both given; leave out one of them."
        )
    return {**options, "timestep": timestep}
