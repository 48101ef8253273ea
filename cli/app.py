"""The `trebucheck` command: its subcommands, and how errors reach the user."""

from __future__ import annotations

import importlib.metadata
import os
import shlex
import signal
import sys
import threading
import warnings
from collections.abc import Callable, Generator, Iterable, Sequence
from contextlib import contextmanager, suppress
from functools import cache
from typing import Annotated, Any, NoReturn

import typer

from ..models.errors import InputError, SimulationError, TrebucheckError, shortened
from . import agree, campaign, catalogue, motion, truth, why
from .output import printable

app = typer.Typer(
    name="trebucheck",
    help="How far can you trust a multibody engine, and why does it differ?\n\n"
    "A trebuchet, fixed or rolling, and its relatives are solved by a Lagrangian reference and "
    "built again in MuJoCo, "
    "pymunk and Exudyn. Exit codes: 0 fine, 1 a tolerance is broken or a run failed, 2 wrong "
    "input, 130 interrupted.",
    epilog="Examples:\n\n"
    "trebucheck compare --out report\n\n"
    "trebucheck compare --models rolling --engines mujoco,exudyn --preset settings\n\n"
    "trebucheck run --engine pymunk --model fixed --set l1=9.5 --set m_cw=2500\n\n"
    "trebucheck throw --model rolling --best --sensitivities\n\n"
    "trebucheck paper --out paper\n\n"
    "trebucheck models export rolling --set r=7 --out my-rolling",
    no_args_is_help=True,
    pretty_exceptions_enable=False,
)
# Commands by the question that they answer, in the order of the help.
_AGREE = "Does an engine agree?"
_WHY = "Why does it differ, and what helps?"
_MOTION = "What does a machine do?"
_TRUTH = "What is certain?"
_THERE = "What is there?"
_MORE = "From other distributions"
_COMMANDS: dict[str, dict[str, Callable[..., None]]] = {
    _AGREE: {
        "compare": agree.compare_command,
        "judge": agree.judge_command,
        "audit": agree.audit_command,
        "conform": agree.conform_command,
        "matrix": agree.matrix_command,
        "diff": agree.diff_command,
        "figures": agree.figures_command,
    },
    _WHY: {
        "explain": why.explain_command,
        "converge": why.converge_command,
        "recommend": why.recommend_command,
    },
    _MOTION: {
        "throw": motion.throw_command,
        "run": motion.run_command,
        "animate": motion.animate_command,
        "view": motion.view_command,
    },
    _TRUTH: {
        "certify": truth.certify_command,
        "prove": truth.prove_command,
        "data": truth.data_command,
        "problems": truth.problems_command,
    },
    _THERE: {"engines": catalogue.engines_command},
}
for _panel, _commands in _COMMANDS.items():
    for _name, _command in _commands.items():
        app.command(_name, rich_help_panel=_panel)(_command)
app.add_typer(campaign.campaign_app, name="campaign", rich_help_panel=_WHY)
app.add_typer(catalogue.models_app, name="models", rich_help_panel=_THERE)
app.add_typer(catalogue.plugin_app, name="plugin", rich_help_panel=_THERE)


def add_satellites(to: typer.Typer, points: Iterable[importlib.metadata.EntryPoint]) -> None:
    """Add commands that other distributions bring: the paper's audit, the check of importers.

    One that cannot be loaded says so when it is called, and spoils no other command. None takes the
    place of a command of trebucheck.
    """
    own = {name for commands in _COMMANDS.values() for name in commands}
    own |= {"campaign", "models", "plugin"}
    for point in points:
        if point.name in own:
            continue
        settings: dict[str, bool] = {}
        try:
            command = point.load()
        except Exception as error:  # of a distribution that is not ours
            command = _unavailable(point, error)
            settings = {"allow_extra_args": True, "ignore_unknown_options": True}
        to.command(point.name, rich_help_panel=_MORE, context_settings=settings)(command)


def _unavailable(point: importlib.metadata.EntryPoint, error: Exception) -> Callable[..., None]:
    """A command that says why the one of that name is not there."""
    distribution = point.dist.name if point.dist is not None else point.value

    def command() -> None:
        raise InputError(
            f"the command {point.name!r} of {distribution} cannot be loaded: "
            f"{type(error).__name__}: {error}."
        )

    command.__doc__ = f"Not available: {distribution} cannot be loaded."
    return command


add_satellites(app, importlib.metadata.entry_points(group="trebucheck.commands"))


def _show_version(requested: bool) -> None:
    if requested:
        from ..version import __version__

        typer.echo(f"trebucheck {__version__}")
        raise typer.Exit


@app.callback()
def root(
    version: Annotated[
        bool,
        typer.Option("--version", callback=_show_version, is_eager=True, help="Show the version."),
    ] = False,
) -> None:
    """Hold the options that belong to no subcommand; the help text stands where the app is made."""


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line.

    Returns:
        The exit code: 0, 1 (disagreement or a failed run), 2 (wrong input) or 130 (interrupted).
    """
    if sys.stdout is None:  # pyright: ignore[reportUnnecessaryComparison] - it was closed
        return _refused("standard output is closed; > /dev/null discards what is written to it.")
    words = list(sys.argv[1:] if arguments is None else arguments)
    try:
        with warnings.catch_warnings(), _ended_as_interrupted():
            warnings.showwarning = _noted
            code = _group().main(
                words, "trebucheck", standalone_mode=False, obj=shlex.join(["trebucheck", *words])
            )
        sys.stdout.flush()
    except (TrebucheckError, MemoryError, OSError) as error:
        if isinstance(error, TrebucheckError):  # some are errors of the system's kinds as well
            sentence = str(error)
        elif isinstance(error, MemoryError):
            sentence = "there is not enough memory for this."
        else:  # the system's, such as a full disk
            # Standard output may be what fails: what is still to be written there would fail again
            # at the end.
            with suppress(OSError, ValueError):
                os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
            where = "" if error.filename is None else f"{error.filename}: "
            sentence = f"{where}{error.strerror or error}."
        return _refused(sentence, code=1 if isinstance(error, SimulationError) else 2)
    except KeyboardInterrupt:
        return _interrupted(words)
    except Exception as error:
        # Usage errors of the command-line library carry their own sentence; anything else is a
        # fault of ours.
        sentence = getattr(error, "format_message", None)
        if sentence is None:
            raise
        return _refused(sentence()) if str(sentence()) else 2
    if code == _INTERRUPTED:
        return _interrupted(words)
    return code if isinstance(code, int) else 0


_INTERRUPTED = 130


@contextmanager
def _ended_as_interrupted() -> Generator[None, None, None]:
    """Make signals that end a process, sent by `kill` or a closed terminal, as good as Ctrl-C."""

    def interrupt(*_: object) -> NoReturn:
        raise KeyboardInterrupt

    before: dict[int, Any] = {}
    if threading.current_thread() is threading.main_thread():
        for name in ("SIGTERM", "SIGHUP"):  # the second is not everywhere
            number = getattr(signal, name, None)
            if number is not None and signal.getsignal(number) is signal.SIG_DFL:
                before[number] = signal.signal(number, interrupt)
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


@cache
def _group() -> Any:
    """Make the commands and their options from the functions, once a process."""
    # With the options that install completion, which a group alone lacks.
    return typer.main.get_command(app)


def _noted(message: Warning | str, *_: object, **__: object) -> None:
    """Print what a user should know as a sentence, without the line of code that warns."""
    print(f"note: {printable(str(message))}", file=sys.stderr)


def _refused(sentence: str, code: int = 2) -> int:
    print(f"error: {printable(shortened(sentence))}", file=sys.stderr)
    return code


def _interrupted(words: Sequence[str]) -> int:
    commands = _group().commands
    name = next((word for word in words if word in commands), None)
    options = [] if name is None else [each.name for each in commands[name].params]
    kept = "; finished runs are kept, and --resume goes on from them" if "resume" in options else ""
    if name == "campaign":
        kept = "; `trebucheck campaign resume` goes on from its finished runs"
    print(f"interrupted{kept}.", file=sys.stderr)
    return _INTERRUPTED
