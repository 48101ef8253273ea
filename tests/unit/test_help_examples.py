"""The first example of every command's help works when it is pasted into a new folder."""

from __future__ import annotations

import shlex
from pathlib import Path

import pytest
import typer
from trebucheck.__main__ import main
from trebucheck.cli.app import app
from trebucheck.comparisons.runs.process import Worker

LONG = ("compare", "converge", "explain", "recommend", "paper", "certify", "animate")
"""Of these, all is done but for the work in their processes."""
NEEDS = {
    "diff": "results of earlier comparisons",
    "figures": "results of an earlier comparison",
    "view": "a screen",
    "importer": "an importer",
    "judge": "a file of somebody else's",
    "matrix": "results of earlier comparisons",
    "campaign run": "a description",
    "campaign resume": "a campaign",
    "campaign show": "a campaign",
    "campaign diff": "two campaigns",
    "campaign machine": "a campaign",
    "campaign shrink": "a campaign",
    "models read": "a model's file",
    "audit": "a model's file",
}


def _commands(
    group: typer.core.TyperGroup, path: tuple[str, ...] = ()
) -> dict[tuple[str, ...], str]:
    """Help of every command by its words."""
    found: dict[tuple[str, ...], str] = {}
    for name, command in group.commands.items():
        if isinstance(command, typer.core.TyperGroup):
            found |= _commands(command, (*path, name))
        else:
            found[*path, name] = command.help or ""
    return found


def _first_example(text: str) -> list[str] | None:
    _, found, rest = text.replace("Example:", "Examples:").partition("Examples:")
    return shlex.split(rest.strip().splitlines()[0])[1:] if found else None


COMMANDS = _commands(typer.main.get_group(app))
EXAMPLES = {
    " ".join(words): example
    for words, text in COMMANDS.items()
    if (example := _first_example(text))
}


def test_every_command_has_an_example_but_those_without_arguments() -> None:
    assert {" ".join(words) for words in COMMANDS} - EXAMPLES.keys() == {
        "models list",
        "models schema",
    }
    assert all(example[: len(name.split())] == name.split() for name, example in EXAMPLES.items())


@pytest.mark.parametrize(
    "name", [name for name in EXAMPLES if name not in LONG and name not in NEEDS]
)
def test_the_first_example_works(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    for engine in {"mujoco", "pymunk", "exudyn"}.intersection(EXAMPLES[name]):
        pytest.importorskip(engine)
    assert main(EXAMPLES[name]) == 0


@pytest.mark.parametrize("name", [name for name in EXAMPLES if name in LONG])
def test_the_first_example_of_a_long_command_comes_to_its_work(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def begun(*_: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(Worker, "call", begun)
    monkeypatch.setattr(Worker, "compute", begun)
    assert main(EXAMPLES[name]) == 130


@pytest.mark.parametrize("name", sorted({"diff", "figures"} & EXAMPLES.keys()))
def test_the_first_example_of_what_needs_results_says_what_is_missing(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    assert main(EXAMPLES[name]) == 2
    assert "cannot be read" in capsys.readouterr().err
