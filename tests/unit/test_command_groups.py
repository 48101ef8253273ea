"""Commands that other distributions bring by entry points."""

from __future__ import annotations

from importlib.metadata import EntryPoint

import pytest
import trebucheck as tb
import typer
from trebucheck.cli.app import _COMMANDS, add_satellites, app  # pyright: ignore[reportPrivateUsage]
from typer.testing import CliRunner

GROUP = "trebucheck.commands"


def _with(*points: EntryPoint) -> typer.Typer:
    other = typer.Typer()
    other.command("compare")(lambda: print("ours"))
    add_satellites(other, points)
    return other


def test_a_satellite_that_cannot_be_imported_is_a_sentence_when_it_is_called() -> None:
    app = _with(
        EntryPoint("broken", "no_such_package.command:run", GROUP),
        EntryPoint("works", "math:sqrt", GROUP),
    )
    help_text = CliRunner().invoke(app, ["--help"])
    assert help_text.exit_code == 0
    assert "broken" in help_text.output and "works" in help_text.output
    for words in (["broken"], ["broken", "--out", "x", "y"]):
        called = CliRunner().invoke(app, words)
        assert isinstance(called.exception, tb.InputError)
        assert "'broken' of no_such_package.command:run cannot be loaded" in str(called.exception)
        assert "No module named 'no_such_package'" in str(called.exception)


def test_no_satellite_takes_the_place_of_a_command() -> None:
    app = _with(EntryPoint("compare", "no_such_package:run", GROUP))
    assert CliRunner().invoke(app, []).output == "ours\n"


@pytest.mark.parametrize("question", _COMMANDS)
def test_the_help_groups_commands_by_their_question(question: str) -> None:
    text = CliRunner().invoke(app, ["--help"], env={"COLUMNS": "120"}).output
    assert question in text
    _, _, rest = text.partition(question)
    panel, _, _ = rest.partition("╰")
    assert all(f" {name} " in panel for name in _COMMANDS[question])


def _options(group: typer.core.TyperGroup, path: str = "") -> dict[str, set[str | None]]:
    """Names of the options of every command, by its words."""
    found: dict[str, set[str | None]] = {}
    for name, command in group.commands.items():
        words = f"{path} {name}".strip()
        if isinstance(command, typer.core.TyperGroup):
            found |= _options(command, words)
        else:
            found[words] = {parameter.name for parameter in command.params}
    return found


def test_what_takes_several_processes_takes_a_cluster() -> None:
    """And so does what makes many runs one after the other here; a single computation does not."""
    options = _options(typer.main.get_group(app))
    several = {words for words, names in options.items() if "jobs" in names}
    cluster = {words for words, names in options.items() if "cluster" in names}
    assert several == cluster - {"conform", "certify"}
    assert {"compare", "campaign run", "campaign resume"} < several
    assert not cluster & {"throw", "run", "judge", "prove", "animate"}
