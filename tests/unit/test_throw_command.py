"""`trebucheck throw`, and `throw` from Python: whole files, one sentence for wrong input."""

from __future__ import annotations

import math
import re
from collections.abc import Callable
from pathlib import Path

import pytest
import trebucheck as tb
from trebucheck.__main__ import main
from trebucheck.reference.solver import solve
from trebucheck.reference.throw.flight import Air, Projectile, Surroundings, fly
from trebucheck.reference.throw.throw import Throw, throw


@pytest.mark.slow
@pytest.mark.parametrize(
    ("arguments", "complaint"),
    [
        (["--density", "-1", "--drag-area", "0.05"], "density = -1.0"),
        (["--density", "1.2", "--drag-area", "-0.05"], "drag_area = -0.05"),
        (["--density", "nan", "--drag-area", "0.05"], "density = nan"),
        (["--density", "1.2"], "needs a drag_area"),
        (["--drag-area", "0.05"], "needs a density (or a body)"),
        (["--body", "pluto"], "there are: moon, mars, earth, venus"),
        (["--body", "mars", "--density", "1"], "brings its own density"),
        (["--body", "mars", "--set", "g=3"], "brings its own gravity"),
        (["--body", "mars", "--drag-area", "-1"], "drag_area = -1.0"),
        (["--release-angle", "40", "--best"], "release_angle and best each choose the release"),
        (
            ["--release-time", "2", "--sling-angle", "300"],
            "release_time and sling_angle each choose",
        ),
        (
            ["--release-angle", "200"],
            "release_angle = 200 deg must be between -90 and 90 deg, above level",
        ),
        (["--release-angle", "nan"], "release_angle = nan deg"),
        (["--release-time", "99"], "release time = 99.0 s must lie within the motion"),
        (["--release-time", "-1"], "release time = -1.0 s must lie within the motion"),
        (["--release-time", "inf"], "release_time = inf s"),
        (["--sling-angle", "1000"], "sling angle = 1000 deg is never reached"),
        (["--height", "500"], "never comes up to the landing height"),
        (["--height", "5000", "--best"], "no release of the first sweep comes up"),
        (["--height", "nan"], "height = nan m"),
        (["--model", "fixed,rolling"], "names 2 machines"),
        (["--model", "floating"], "no model 'floating'"),
        (["--model", "absent.json"], "absent.json cannot be read"),
        (["--model", "absent.json", "--sensitivities"], "absent.json"),
        (["--set", "l1=-3"], "l1 = -3.0"),
    ],
)
def test_wrong_input_gets_a_sentence(
    arguments: list[str], complaint: str, refused: Callable[..., str]
) -> None:
    assert complaint in refused("throw", *arguments)


def test_gravity_that_is_not_downwards_is_refused_and_gives_no_range() -> None:
    """The flight knows of down only: it took 9.81 m/s^2 there, whatever the direction."""
    tilted = tb.fixed().model_copy(update={"gravity_direction": (math.sin(0.1), -math.cos(0.1))})
    with pytest.raises(
        tb.InputError, match=r"gravity_direction = \(0\.0998.* must be \(0, -1\) for a throw"
    ):
        throw(tilted)
    rounded = tb.fixed().model_copy(update={"gravity_direction": (6e-17, -1.0)})
    assert throw(rounded).flight.range == pytest.approx(throw(tb.fixed()).flight.range, rel=1e-12)


@pytest.mark.slow
def test_a_machine_too_weak_to_throw(refused: Callable[..., str], tmp_path: Path) -> None:
    # A feather for a counterweight: the arm falls, and the projectile stays below the fulcrum.
    arguments = ["--set", "m_cw=1", "--out", str(tmp_path / "out")]
    assert "never comes up to the landing height" in refused("throw", *arguments)
    assert not (tmp_path / "out").exists()


@pytest.mark.slow
def test_a_mechanism_of_one_s_own(
    refused: Callable[..., str], capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    path = tmp_path / "own.json"
    path.write_text(tb.rolling().to_json())
    assert main(["throw", "--model", str(path), "--sensitivities", "--out", str(tmp_path)]) == 0
    found = Throw.load(tmp_path / "throw.json")
    assert {"mass of sling", "place of sling pin on arm, x"} <= {
        each.name for each in found.sensitivities
    }
    assert found.model_copy(update={"sensitivities": ()}) == throw(tb.rolling())
    assert "mass of sling" in capsys.readouterr().out
    path.write_text(tb.rolling().to_json().replace('"gravity": 9.81', '"gravity": 0'))
    assert "gravity = 0.0" in refused("throw", "--model", str(path))
    moved = tb.fixed().to_json().replace('"name": "projectile"', '"name": "stone"')
    path.write_text(moved)
    assert "no marker 'projectile' to throw" in refused("throw", "--model", str(path))


@pytest.mark.slow
def test_all_is_shown_and_written(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    out = tmp_path / "deep" / "throw"
    arguments = ["--model", "rolling", "--density", "1.2", "--drag-area", "0.05", "--sensitivities"]
    assert main(["throw", *arguments, "--out", str(out)]) == 0
    shown = re.sub(r"\s+", " ", capsys.readouterr().out)
    for word in (
        "2.509621264 s",
        "112.718321 m/s",
        "hanger rest opens",
        "wheels would lift off",
        "rope would be slack",
    ):
        assert word in shown
    assert sorted(path.name for path in out.iterdir()) == ["throw.html", "throw.json"]
    found = Throw.load(out / "throw.json")
    assert [each.name for each in found.sensitivities][:2] == ["l1", "l2"]
    assert found.model_copy(update={"sensitivities": ()}) == throw(
        tb.rolling(), density=1.2, drag_area=0.05
    )
    page = (out / "throw.html").read_text()
    assert "Sensitivities" in page and "lift off" in page
    assert not re.search(r"<(script|link|img)[^>]+(src|href)=.(https?:)?//", page), (
        "the page must need nothing else"
    )


@pytest.mark.slow
def test_a_page_that_fails_leaves_nothing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    from trebucheck.comparisons.report.pages import throw as throw_page

    def broken(_: object) -> None:
        raise RuntimeError("no picture")

    monkeypatch.setattr(throw_page, "force_plots", broken)
    with pytest.raises(RuntimeError, match="no picture"):
        main(["throw", "--out", str(tmp_path / "out")])
    assert not (tmp_path / "out").exists()


def test_help_has_examples(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["throw", "--help"]) == 0
    shown = capsys.readouterr().out
    for word in (
        "--release-angle",
        "--sling-angle",
        "--body",
        "Examples",
        "trebucheck throw --model rolling",
    ):
        assert word in shown


def test_figures_agree_with_their_parts() -> None:
    """The collected figures are those of the flight and release modules, on Mars, from a machine of
    one's own.
    """
    parameters = tb.TrebuchetParameters(l1=9.5)
    found = throw(tb.fixed(parameters), body="mars", drag_area=0.05, height=-3.0, best=True)
    machine = tb.fixed(tb.TrebuchetParameters(l1=9.5, g=3.71))
    assert found.mechanism == machine
    thrown = Projectile(solve(tb.Problem(machine, duration=6.0)))
    drag = Air(density=0.02, drag_area=0.05).drag(60.0)
    surroundings = Surroundings(gravity=3.71, drag=drag, ground=-3.0)
    best = thrown.best_release(surroundings)
    assert best is not None
    # Two integrations with other step sequences: the solver's uncertainty, some 1e-12 relative,
    # times a thousand.
    assert found.launch.time == pytest.approx(best.time, abs=1e-9)
    assert found.flight.range == pytest.approx(fly(best, surroundings).range, rel=1e-9)
    assert found.gain == 0.0
    assert found.launch.energy_ratio == pytest.approx(
        30.0 * best.speed**2 / found.total_energy, rel=1e-9
    )


def test_a_machine_that_stands_elsewhere_throws_as_far() -> None:
    """Range, apex and height count from the fulcrum at the start."""
    here = tb.fixed()
    pin = here.joints[0].model_copy(update={"parent_point": (100.0, 7.0)})
    there = throw(tb.Mechanism(**{**dict(here), "joints": (pin, *here.joints[1:])}), height=-2.0)
    at_origin = throw(here, height=-2.0)
    for name in ("range", "apex_height", "time", "impact_speed"):
        assert getattr(there.flight, name) == pytest.approx(
            getattr(at_origin.flight, name), rel=1e-11
        )  # rounding
    assert there.launch.x == pytest.approx(at_origin.launch.x, abs=1e-10)


@pytest.mark.slow
def test_each_choice_of_release() -> None:
    launch = throw(tb.fixed()).launch
    assert throw(tb.fixed(), release_angle=math.pi / 4).launch == launch
    assert throw(tb.fixed(), release_time=launch.time).launch == launch
    assert throw(tb.fixed(), sling_angle=launch.sling_angle).launch.time == pytest.approx(
        launch.time, abs=1e-12
    )
    best = throw(tb.fixed(), best=True)
    assert best.launch == best.best_launch and best.gain == 0.0


def test_an_arm_that_goes_through_its_stop_is_told_of() -> None:
    late = throw(tb.fixed(), release_angle=math.radians(-80))
    assert any("'arm stop'" in warning for warning in late.warnings)
    assert not any("'arm stop'" in warning for warning in throw(tb.fixed()).warnings)


def test_a_free_body_is_thrown(tmp_path: Path) -> None:
    """Nothing holds it: its centre comes down where it would have without a release.

    No members, no supports.
    """
    speed, ends = (6.0, 9.0), {"inertia": 0.4, "mass": 2.0, "centre": (0.0, 0.0)}
    hull = tb.Mechanism(
        name="hull",
        bodies=(tb.Body(name="hull", angle="turn", **ends),),
        joints=(
            tb.FreeJoint(name="sea", child="hull", child_point=(1, 0), coordinates=("x", "y")),
        ),
        markers=(tb.Marker(name="projectile", body="hull", point=(0, 0), mass=0.5),),
        gravity=9.81,
        start=(0.0, 0.0, 0.0),
        start_speeds=(0.0, *speed),
    )
    found = throw(hull, release_time=0.2)
    # It starts 1 m behind the joint's point, from which places are measured, at the height of the
    # landing.
    assert found.flight.range == pytest.approx(2 * speed[0] * speed[1] / 9.81 - 1, rel=1e-11)
    assert found.members == found.supports == ()
    path = tmp_path / "hull.json"
    path.write_text(hull.to_json())
    assert (
        main(["throw", "--model", str(path), "--release-time", "0.2", "--out", str(tmp_path)]) == 0
    )
