"""Machines with stops on points and loops of joints, as a user meets them.

Words, units, wrong files, suspects.
"""

from __future__ import annotations

import json
import math
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
import trebucheck as tb
from trebucheck.__main__ import main
from trebucheck.comparisons.diagnosis.faults import combined, machine_suspects, with_closed_loops
from trebucheck.comparisons.explain import causes_of
from trebucheck.engines.mujoco.engine import MujocoEngine
from trebucheck.models.library.registry import model
from trebucheck.reference.throw.throw import throw

NEW = ("catapult", "hinged", "floating-arm")


def _file(folder: Path, change: Callable[[dict[str, Any]], object], name: str = "hinged") -> Path:
    """A named machine's file with its first stop changed."""
    fields = json.loads(model(name).to_json())
    change(fields["stops"][0])
    path = folder / "own.json"
    path.write_text(json.dumps(fields))
    return path


def _mixed() -> tb.Mechanism:
    """The paper's machine over a floor that it does not touch.

    Stops of both kinds, one of them open.
    """
    fields = tb.fixed().model_dump()
    floor = {
        "name": "floor",
        "body": "sling",
        "point": (6, 0),
        "normal": (0, 1),
        "offset": -50.0,
        "closed": False,
    }
    return tb.Mechanism(**{**fields, "name": "mixed", "stops": [*fields["stops"], floor]})


@pytest.mark.parametrize(
    ("change", "complaint"),
    [
        ({"normal": [0, -1]}, "stop 'trough' is closed, but its gap at the start is 14.1 m, not 0"),
        (
            {"normal": [0, math.nan]},
            "cannot be built: stops.0.normal.1 = nan: input should be a finite number",
        ),
        ({"normal": [0, 2]}, "stops.0: normal of 'trough' must have length 1"),
        ({"offset": -8}, "is closed, but its gap at the start is 0.929 m, not 0"),
        ({"closed": False}, "is open, but its gap at the start is 0 m, not positive"),
        ({"offset": math.inf}, "stops.0.offset = inf"),
        ({"point": [1, 2, 3]}, "stops.0.point = [1, 2, 3]"),
        ({"body": "boom"}, "names the body 'boom'; there are"),
        ({"restitution": 2}, "stops.0.restitution = 2"),
    ],
)
def test_a_wrong_stop_gets_a_sentence(
    change: dict[str, Any], complaint: str, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    path = _file(tmp_path, lambda stop: stop.update(change))
    assert main(["throw", "--model", str(path), "--out", str(tmp_path / "out")]) == 2
    said = capsys.readouterr().err
    assert complaint in said and said.count("\n") == 1
    assert "cannot be built: ." not in said


def test_a_stop_without_its_point_misses_a_point(
    capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    path = _file(tmp_path, lambda stop: stop.pop("point"))
    assert main(["throw", "--model", str(path), "--out", str(tmp_path / "out")]) == 2
    assert "stops.0.point is missing." in capsys.readouterr().err


@pytest.mark.slow
@pytest.mark.parametrize("name", NEW)
def test_a_throw_speaks_of_what_the_machine_has(
    name: str, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    assert main(["throw", "--model", name, "--out", str(tmp_path)]) == 0
    shown = re.sub(r"\s+", " ", capsys.readouterr().out)
    page = (tmp_path / "throw.html").read_text()
    assert ("sling to arm" in shown) == (name != "catapult")
    assert ("trough, force at start 588.6000 N " in shown) == (name != "catapult")
    assert ("Forces of the stops" in page) == (name != "catapult")
    assert f"range from the {'wheel' if name == 'floating-arm' else 'fulcrum'}" in shown
    for silly in ("N m", "Rests", "-0.00 deg", "lift off from", "warning"):
        assert silly not in shown
    assert "Torques of the stops" not in page


def test_a_catapult_has_no_sling(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    assert (
        main(["throw", "--model", "catapult", "--sling-angle", "90", "--out", str(tmp_path)]) == 2
    )
    assert "there is no sling angle: the projectile is part of the 'arm'" in capsys.readouterr().err


def test_a_track_that_only_guides_bears_nothing() -> None:
    """The counterweight's track is upright.

    Nobody's wheels lift off it, by rounding least of all.
    """
    found = throw(model("floating-arm"))
    drop, track = found.supports
    assert (drop.joint, track.joint) == ("drop", "track")
    assert drop.least is None and not drop.rolls and not drop.pulls_down
    assert drop.peak > 0 and drop.peak_direction in (
        pytest.approx(0, abs=1e-9),
        pytest.approx(math.pi, abs=1e-9),
    )
    assert track.least is not None and track.rolls and track.least > 0
    assert not found.warnings


def test_places_of_the_floating_arm_are_measured_from_its_wheel() -> None:
    """Its first joint on the ground is the counterweight's track, higher up by l2 sin(theta0)."""
    machine = model("floating-arm")
    found = throw(machine)
    launch = tb.engine("reference").simulate(tb.Problem(machine, duration=2.0)).launch()
    assert launch is not None
    # The run's launch lies on a polynomial between samples, good to 1e-9 m.
    wheel = 4.0 * math.cos(machine.start[0])
    assert found.launch.time == pytest.approx(launch.time, abs=1e-9)
    motion = tb.engine("reference", timestep=1e-3).simulate(
        tb.Problem(machine, duration=found.launch.time)
    )
    x, y = motion.marker("projectile").position[-1]
    assert (found.launch.x, found.launch.y) == (
        pytest.approx(x - wheel, abs=1e-9),
        pytest.approx(y, abs=1e-9),
    )


def test_a_run_says_what_its_stop_pushes_with(
    capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    arguments = [
        "run",
        "--engine",
        "reference",
        "--model",
        "hinged",
        "--duration",
        "0.1",
        "--out",
        str(tmp_path),
    ]
    assert main(arguments) == 0
    shown = re.sub(r"[\s│]+", " ", capsys.readouterr().out)
    assert "trough, largest force 588.6 N " in shown


def test_units_follow_the_stops() -> None:
    assert [machine.force_unit for machine in (tb.fixed(), model("hinged"), model("catapult"))] == [
        "N m",
        "N",
        "N m",
    ]
    assert _mixed().force_unit == "N m"  # its floor is open at the start


@pytest.mark.parametrize(
    "machine", [model(name) for name in NEW] + [_mixed()], ids=lambda machine: machine.name
)
def test_suspects_are_machines_that_can_move(machine: tb.Mechanism) -> None:
    """Whatever is changed, stops touch and loops close again, for a thousand times the change as
    well.
    """
    suspects = machine_suspects(machine)
    names = [suspect.name for suspect in suspects]
    assert len(set(names)) == len(names)
    for stop in machine.point_stops:
        assert {f"place of the {stop.name}", f"direction of the {stop.name}"} <= set(names)
    for joint in machine.loop_joints:
        assert {f"{joint.name} missing", f"direction of the {joint.name}"} <= set(names)
    for suspect in suspects:
        assert suspect.wrong != machine, suspect.name
        larger = combined(machine, (suspect,), (1e3,))
        assert larger is not None or suspect.scale == 0, suspect.name
        for wrong in (suspect.wrong, *([larger] if larger else [])):
            closed = with_closed_loops(wrong)
            assert closed is not None
            tb.Problem(closed)


def test_points_bring_a_cause_of_their_own() -> None:
    """MuJoCo's contacts leave a term out that limits do not have."""
    default = MujocoEngine.presets()["default"]()
    assert "moving points" not in {cause.name for cause in causes_of(default, tb.fixed())}
    for name in ("hinged", "floating-arm"):
        first, *others = causes_of(default, model(name))
        assert first.name == "moving points"
        assert all("moving points" in cause.after for cause in others)
        assert "moving points" not in {
            cause.name for cause in causes_of(MujocoEngine(), model(name))
        }
