"""Options of engines: their table has one source, and each engine gets its own."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import plugin_engines
import pytest
import trebucheck as tb
from trebucheck.__main__ import main
from trebucheck.comparisons.runs.study import Study
from trebucheck.engines.options import default_text
from trebucheck.engines.registry import OptionRow, engine_names, option_table
from trebucheck.models.trajectory import load


@pytest.mark.parametrize("name", ["reference", "mujoco", "pymunk", "exudyn"])
def test_every_option_has_defaults_meaning_and_values(name: str) -> None:
    table = option_table(name)
    for preset in ("default", "assisted"):
        assert {row.name: row.defaults[preset] for row in table} == tb.engine(name, preset).settings
    assert all(row.meaning and row.values for row in table)


def _row(name: str, option: str) -> OptionRow:
    return next(row for row in option_table(name) if row.name == option)


@pytest.mark.parametrize(
    ("engine", "option", "values"),
    [
        ("mujoco", "timestep", "number above 0 and at most 1"),
        ("mujoco", "integrator", "RK4, Euler, implicit, implicitfast, discrete"),
        ("mujoco", "free_substeps", "integer from 1 to 1000"),
        ("mujoco", "solref", "2 values (number; number) or null"),
        ("mujoco", "preload", "true or false"),
        ("pymunk", "error_bias", "number from 0 to 1"),
        ("pymunk", "pivot_mass", "number from 1 to 1e+09"),
        ("exudyn", "spectral_radius", "number at least 0 and below 1"),
        ("exudyn", "newton_relative", "number above 0 and at most 0.01"),
        ("exudyn", "stop_stiffness", "number above 0 or null"),
    ],
)
def test_values_are_those_of_the_field(engine: str, option: str, values: str) -> None:
    assert _row(engine, option).values == values


@pytest.mark.parametrize("name", ["reference", "mujoco", "pymunk", "exudyn"])
def test_a_default_as_it_is_shown_is_taken_on_the_command_line(name: str, tmp_path: Path) -> None:
    from trebucheck.cli.options import engine_options

    for preset in ("default", "assisted"):
        texts = [
            f"{name}.{row.name}={default_text(row.defaults[preset])}" for row in option_table(name)
        ]
        made = Study(engines=[name], options=engine_options(texts, None)).engine(name, preset)
        expected = tb.engine(name, preset).settings
        assert {key: default_text(value) for key, value in made.settings.items()} == {
            key: default_text(value) for key, value in expected.items()
        }


def test_a_plug_in_s_options_are_listed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    plugin_engines.announce(tmp_path)
    monkeypatch.syspath_prepend(str(tmp_path))
    assert "second" in engine_names()
    (row,) = option_table("second")
    assert row == OptionRow("timestep", {"assisted": 1e-3, "default": 1e-3}, "number", "")


def test_an_option_of_one_engine_is_no_other_s() -> None:
    study = Study(
        engines=["mujoco", "pymunk", "exudyn"],
        options={"mujoco.timestep": 2e-3, "locate_releases": False, "hold_lengths": False},
    )
    made = {name: study.engine(name, "assisted").settings for name in study.every_engine}
    assert made["mujoco"]["timestep"] == 2e-3 and made["pymunk"]["timestep"] == 1e-3
    assert made["mujoco"]["locate_releases"] is made["pymunk"]["locate_releases"] is False
    assert made["pymunk"]["hold_lengths"] is False
    assert made["exudyn"] == tb.engine("exudyn", locate_releases=False).settings


def test_an_option_s_old_name_is_still_read_and_means_the_same() -> None:
    new = tb.engine("exudyn", locate_releases=False)
    assert "located_releases" not in new.settings
    assert tb.engine("exudyn", located_releases=False) == new
    for option in ("located_releases", "exudyn.located_releases"):
        study = Study(engines=["exudyn"], options={option: False})
        assert study.engine("exudyn", "assisted").settings == new.settings
    with pytest.raises(tb.InputError, match="located_releases"):
        tb.engine("exudyn", located_releases=False, locate_releases=True)


def test_an_engine_s_own_value_goes_before_that_of_all() -> None:
    study = Study(engines=["mujoco", "pymunk"], options={"mujoco.timestep": 2e-3, "timestep": 5e-4})
    assert [study.engine(name, "assisted").timestep for name in study.every_engine] == [2e-3, 5e-4]


COMPARE = ["compare", "--engines", "mujoco,pymunk"]


@pytest.mark.parametrize(
    ("arguments", "complaint"),
    [
        (
            [*COMPARE, "--option", "mujoco.colour=1"],
            "mujoco: colour is not a field it has; its options are: timestep",
        ),
        ([*COMPARE, "--option", "mujoco.solreff=1"], "did you mean 'solref'"),
        ([*COMPARE, "--option", "colour=1"], "mujoco, pymunk: colour is not a field"),
        (
            [*COMPARE, "--option", "exudyn.timestep=1e-3"],
            "'exudyn' is not among the engines asked for: mujoco, pymunk",
        ),
        ([*COMPARE, "--option", "mujoco.solref=1"], "solref = 1: "),
        ([*COMPARE, "--option", "mujoco.integrator=RK5"], "'RK4', 'Euler'"),
        ([*COMPARE, "--option", "mujoco.preset=default"], "preset = 'default' is no option"),
        ([*COMPARE, "--option", "duration=1"], "duration is not a field"),
        ([*COMPARE, "--option", "mujoco.solref"], "NAME=VALUE"),
        ([*COMPARE, "--timestep", "1e-3", "--option", "timestep=1e-3"], "leave out one of them"),
        (
            ["explain", "--engines", "mujoco", "--option", "pymunk.iterations=3"],
            "'pymunk' is not among",
        ),
        (["run", "--engine", "mujoco", "--option", "pymunk.iterations=3"], "'pymunk' is not among"),
        (["engines", "mujuco"], "did you mean 'mujoco'"),
    ],
)
def test_wrong_options_get_a_sentence(
    arguments: list[str], complaint: str, refused: Callable[..., str]
) -> None:
    assert complaint in refused(*arguments)


@pytest.mark.parametrize("form", ["mujoco.solref=-40000,-400", "solref=[-40000, -400]"])
def test_an_option_reaches_the_engine(form: str, tmp_path: Path) -> None:
    pytest.importorskip("mujoco")
    path = tmp_path / "own.nc"
    arguments = [
        "run",
        "--engine",
        "mujoco",
        "--duration",
        "0.05",
        "--option",
        form,
        "--out",
        str(path),
    ]
    assert main(arguments) == 0
    assert load(path).provenance.settings["solref"] == [-40000.0, -400.0]


@pytest.mark.slow
def test_options_of_a_comparison_are_in_its_results(tmp_path: Path) -> None:
    arguments = [
        "compare",
        "--model",
        "fixed",
        "--engines",
        "reference,mujoco",
        "--preset",
        "assisted",
    ]
    main(
        [
            *arguments,
            "--option",
            "mujoco.timestep=2e-3",
            "--duration",
            "0.3",
            "--out",
            str(tmp_path),
        ]
    )
    runs = json.loads((tmp_path / "results.json").read_text())["runs"]
    assert {run["engine"]: run["settings"]["timestep"] for run in runs} == {
        "reference": 1e-3,
        "mujoco": 2e-3,
    }


def test_the_reference_s_version_is_trebucheck_s(capsys: pytest.CaptureFixture[str]) -> None:
    assert tb.engines()["reference"].version == tb.__version__
    run = tb.engine("reference").simulate(tb.Problem(tb.fixed(), duration=0.1))
    assert run.provenance.engine_version == tb.__version__
    assert main(["engines", "reference"]) == 0
    assert f"reference ({tb.__version__})" in capsys.readouterr().out
