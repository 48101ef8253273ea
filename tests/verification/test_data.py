"""The published trajectories.

Whole, readable without us, and right within the uncertainties that they state.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from importlib.resources import files
from pathlib import Path

import numpy as np
import pytest
import trebucheck as tb
import xarray as xr
from conftest import again
from trebucheck.cli.app import main
from trebucheck.comparisons.data import certified as published_files
from trebucheck.comparisons.data.certified import certified_dataset, names, published, states
from trebucheck.models.arrays import FloatArray
from trebucheck.models.library.benchmark import swing, turn
from trebucheck.models.library.registry import benchmarks, library_problem, model, models
from trebucheck.models.trajectory import load

FOLDER = Path(str(files("trebucheck.comparisons.data") / "trajectories"))


def _read(name: str) -> xr.Dataset:
    with xr.open_dataset(FOLDER / f"{name}.nc") as dataset:
        return dataset.load()


def test_every_machine_and_problem_is_there_as_it_was_published() -> None:
    assert set(published()) == set(names()) == {*models(), *(entry.name for entry in benchmarks())}
    assert {state for *_, state in states()} == {"good"}
    assert sum(size for _, _, size, _ in states()) < 3e6


@pytest.mark.parametrize(
    "name", [pytest.param(name, marks=again if k % 3 else ()) for k, name in enumerate(names())]
)
def test_a_file_describes_itself(name: str) -> None:
    dataset = _read(name)
    assert dataset.attrs["mechanism_hash"] == tb.model(name).content_hash
    assert 0 < dataset.attrs["predictability_horizon"] <= float(dataset["time"][-1])
    for variable in ("q", "u", "position", "kinetic_energy"):
        assert dataset[variable].attrs["units"]
        assert np.isfinite(dataset[variable]).all()
        uncertainty = dataset[f"{variable}_uncertainty"]
        assert (uncertainty.diff("time") >= 0).all()
        assert uncertainty.attrs["units"] == dataset[variable].attrs["units"]
    assert load(FOLDER / f"{name}.nc").mechanism == tb.model(name)


def _refuse_other_values(old: xr.Dataset, new: xr.Dataset) -> None:
    for name in (str(name) for name in old if f"{name}_uncertainty" in old):
        apart = abs(old[name] - new[name])
        apart = apart.max("axis") if "axis" in apart.dims else apart
        assert (apart <= old[f"{name}_uncertainty"] + new[f"{name}_uncertainty"]).all(), name


@pytest.mark.parametrize("name", ["catapult", "bouncing"])
def test_a_file_made_again_is_the_same_within_its_uncertainty(name: str) -> None:
    old, new = _read(name), certified_dataset(library_problem(name) or model(name))
    assert set(old.variables) == set(new.variables)
    assert old.attrs["predictability_horizon"] == pytest.approx(
        new.attrs["predictability_horizon"], rel=0.1
    )
    _refuse_other_values(old, new)
    with pytest.raises(AssertionError, match="position"):
        _refuse_other_values(old, new.assign(position=new["position"] * (1 + 1e-9)))


def _four_bar(t: FloatArray) -> FloatArray:
    return -math.pi / 2 + turn(math.sqrt(2 * 9.81 / (2 / 3 + 1)), 1.0, t)


@pytest.mark.parametrize(
    ("name", "exact"),
    [
        ("pendulum", lambda t: math.pi / 2 + swing(math.sqrt(9.81), math.pi / 2, t)),
        ("high-pendulum", lambda t: math.pi / 2 + swing(math.sqrt(9.81), math.radians(179), t)),
        ("n-four-bar", _four_bar),
        ("oscillator", lambda t: 0.3 * np.cos(5 * t)),
        ("incline", lambda t: -2 * t + 9.81 * math.sin(0.3) * t**2 / 2),
    ],
)
def test_an_uncertainty_covers_the_error(
    name: str, exact: Callable[[FloatArray], FloatArray]
) -> None:
    dataset = _read(name)
    error = abs(dataset["q"].values[:, 0] - exact(dataset["time"].values))
    bound = dataset["q_uncertainty"].values[:, 0]
    # The closed forms are rounded, too.
    assert (error <= bound + 4 * np.finfo(float).eps * abs(dataset["q"].values[:, 0])).all()
    assert bound[-1] < 1e-7


def test_events_are_in_the_files() -> None:
    bouncing = _read("bouncing")
    assert float(bouncing["rest_time"][0]) == pytest.approx(3 * math.sqrt(2 / 9.81), abs=1e-10)
    first = bouncing["impact_impulse"].sel(struck_stop="floor")[0]
    assert float(first) == pytest.approx(1.5 * 2.0 * math.sqrt(2 * 9.81), rel=1e-11)
    assert float(_read("fixed")["launch_speed"]) == pytest.approx(
        tb.throw(tb.fixed()).launch.speed, rel=1e-9
    )
    assert float(_read("hinged")["release_time"].sel(releasable_stop="trough")) > 0


def test_on_the_command_line(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    assert main(["data"]) == 0
    assert "squeezer" in capsys.readouterr().out
    assert main(["data", "A03", "--out", str(tmp_path / "one.nc")]) == 0
    assert (tmp_path / "one.nc").read_bytes() == (FOLDER / "squeezer.nc").read_bytes()
    assert main(["data", "incline", "--set", "slope=0", "--out", str(tmp_path / "two.nc")]) == 0
    with xr.open_dataset(tmp_path / "two.nc") as dataset:
        assert dataset["q"].values[:, 0] == pytest.approx(-2 * dataset["time"].values, abs=1e-13)
    assert main(["data", "nonsense"]) == 2
    assert "no model 'nonsense'" in capsys.readouterr().err
    assert main(["data", "--check"]) == 0
    wrong = dict.fromkeys(published(), "0" * 64)
    monkeypatch.setattr(published_files, "published", lambda: wrong)
    assert main(["data", "--check"]) == 1
    assert "changed" in capsys.readouterr().out
    assert main(["data", "squeezer", "--out", str(tmp_path / "three.nc")]) == 2
    assert not (tmp_path / "three.nc").exists()
