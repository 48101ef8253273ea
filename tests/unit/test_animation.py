"""Animations: their data are the trajectories', and files of them are whole or refused with a
sentence.
"""

from __future__ import annotations

import base64
import dataclasses
import json
import re
import xml.etree.ElementTree as ET
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np
import pytest
import trebucheck as tb
from mechanisms import everything, fixed, hanging_bob
from PIL import Image
from trebucheck.__main__ import main
from trebucheck.comparisons.report import html, markdown
from trebucheck.comparisons.report.document import AnimationBlock, Document, Heading
from trebucheck.comparisons.report.drawing import animation
from trebucheck.comparisons.report.drawing.animation import PALETTE, Animation, Stage, scene_data
from trebucheck.comparisons.report.drawing.scene import RunLook, Scene, resampled, scene
from trebucheck.models.trajectory import Trajectory, save
from trebucheck.reference.solution import Solution
from trebucheck.reference.solver import solve

END = 2.76
SVG = "{http://www.w3.org/2000/svg}"


@cache
def _solution(theta0: float = 0.0) -> Solution:
    return solve(tb.Problem(fixed(tb.TrebuchetParameters(theta0=theta0)), 2.8))


@cache
def _run(samples: int = 2801) -> Trajectory:
    """The machine from a start 1e-5 rad aside, at times of its own, as an engine's run."""
    return _solution(1e-5).trajectory(np.linspace(0.0, 2.8, samples))


@cache
def _scene(runs: int = 1, samples: int = 2801) -> Scene:
    looks = {f"run {k}": RunLook(_run(samples), "#1f77b4", k > 0) for k in range(runs)}
    return scene(_solution().trajectory, looks, end=END)


def _unpacked(text: str, kind: str = "<f4") -> np.ndarray:
    return np.frombuffer(base64.b64decode(text), dtype=kind)


def _beside(times: np.ndarray, marker: str = "projectile") -> np.ndarray:
    """The run's marker less the reference's [m], both solutions read at these times."""
    own, reference = (
        _solution(start).trajectory(times).marker(marker).position for start in (1e-5, 0.0)
    )
    return own - reference


def test_frames_are_the_reference_s_states() -> None:
    shown = _scene()
    data = scene_data(shown)
    t = _unpacked(data["t"], "<f8")
    assert t[0] == 0 and t[-1] == END and (np.diff(t) > 0).all()
    q = _unpacked(data["q"]).reshape(len(t), data["width"])
    np.testing.assert_allclose(q, _solution().trajectory(t).q, rtol=1e-6, atol=1e-7)
    at = list(_solution().trajectory(t).markers)
    for name in at:
        drawn = shown.at(t)[:, shown.drawing.markers[name]]
        np.testing.assert_allclose(
            drawn, _solution().trajectory(t).marker(name).position, rtol=0, atol=1e-11
        )


def test_events_are_frames_and_frames_are_closer_about_them() -> None:
    shown = _scene()
    for event in shown.events:
        assert event.time in shown.t
        steps = np.diff(shown.t)
        assert steps[np.abs(shown.t[:-1] - event.time) < 0.01 * END].max() < 0.7 * steps.max()
    releases = _solution().release_times
    named = {event.stop: event for event in shown.events if event.kind == "release"}
    assert {name: event.reference for name, event in named.items()} == {
        name: time for name, time in releases.items() if time is not None
    }
    later = _run().release_times["sling rest"]
    assert named["sling rest"].runs == {"run 0": later}


def test_between_frames_the_motion_is_smooth() -> None:
    """Cubic in time between frames, an event's speeds apart: a tenth of a millimetre of 25 m."""
    times = np.random.default_rng(3).uniform(0.0, END, 400)
    drawn = _scene().at(times)[:, _scene().drawing.markers["projectile"]]
    assert np.abs(drawn - _solution().trajectory(times).marker("projectile").position).max() < 1e-4


def test_deviations_are_the_run_s_own_at_its_own_times() -> None:
    shown = _scene()
    (run,) = shown.runs
    there = _beside(shown.t)
    found = shown.deviation(run)[:, shown.drawing.markers["projectile"]]
    # linear between samples of 1 ms: the square of the interval times the deviation's curvature,
    # some 1e-4 of it
    np.testing.assert_allclose(found, there, rtol=0, atol=1e-3 * np.abs(there).max())
    largest = np.max(
        [np.linalg.norm(_beside(shown.t, name), axis=1) for name in shown.drawing.markers], axis=0
    )
    np.testing.assert_allclose(shown.error(run), largest, rtol=0, atol=1e-3 * largest.max())
    at = shown.t[10:-10:40]  # at a sample nothing is interpolated
    looks = {"coarse": RunLook(_solution(1e-5).trajectory(np.unique([0.0, *at, 2.8])), "#000000")}
    coarse = scene(_solution().trajectory, looks, end=END)
    found = coarse.deviation(coarse.runs[0])[
        np.isin(coarse.t, at), coarse.drawing.markers["projectile"]
    ]
    np.testing.assert_allclose(found, _beside(at[np.isin(at, coarse.t)]), rtol=1e-9, atol=1e-13)


def test_forces_of_runs_are_their_own_and_those_not_told_are_none() -> None:
    own = _run()
    silent = dataclasses.replace(
        own, stop_torques={}, joint_reactions={"fulcrum": own.joint_reaction("fulcrum")}
    )
    looks = {name: RunLook(each, "#000000") for name, each in (("own", own), ("silent", silent))}
    shown = scene(_solution().trajectory, looks, end=END)
    data = scene_data(shown)
    stops, joints = ([name for name, *_ in data[key]] for key in ("stops", "joints"))
    at = _solution(1e-5).trajectory(shown.t)
    # linear between samples of 1 ms, and half precision; at a release a sample is before or behind
    # it
    calm = (
        np.min(
            [np.abs(shown.t - time) for time in at.release_times.values() if time is not None],
            axis=0,
        )
        > 2e-3
    )
    unit, text = data["runs"][0]["torques"]
    torques = unit * _unpacked(text, "<f2").reshape(len(shown.t), len(stops)).astype(float)
    for name, column in zip(stops, torques.T, strict=True):
        np.testing.assert_allclose(
            column[calm], at.stop_torque(name)[calm], rtol=2e-3, atol=1e-3 * unit
        )
    unit, text = data["runs"][1]["forces"]
    forces = unit * _unpacked(text, "<f2").reshape(len(shown.t), len(joints), 2).astype(float)
    np.testing.assert_allclose(
        forces[calm, 0], at.joint_reaction("fulcrum")[calm], rtol=2e-3, atol=1e-2 * unit
    )
    assert (
        joints[0] == "fulcrum"
        and np.isnan(forces[:, 1:]).all()
        and data["runs"][1]["torques"] is None
    )


def test_a_deviation_of_a_picometre_keeps_its_digits() -> None:
    t = np.linspace(0.0, END, 301)
    reference = _solution().trajectory(t)
    tiny = np.ldexp(
        np.sin(7 * t)[:, None] * (1.0, -0.5, 0.25), -44
    )  # 6e-14 rad: a few roundings of an angle
    q = reference.q + tiny
    markers = {name: dataclasses.replace(motion) for name, motion in reference.markers.items()}
    run = dataclasses.replace(
        reference, q=q, markers={n: m for n, m in markers.items() if n == "absent"}
    )
    shown = scene(_solution().trajectory, {"tiny": RunLook(run, "#000000")}, end=END)
    data = scene_data(shown)["runs"][0]
    d = _unpacked(data["d"]).reshape(len(shown.t), 3)
    at = [int(np.argmin(np.abs(shown.t - time))) for time in t[30:270:40]]
    exact = np.stack([np.interp(shown.t[at], t, (q - reference.q)[:, k]) for k in range(3)], axis=1)
    np.testing.assert_allclose(d[at], exact, rtol=1e-5, atol=1e-21)


def test_a_marker_that_is_not_where_the_coordinates_put_it_is_shown_where_it_is() -> None:
    run = _run()
    own = run.marker("projectile")
    drifted = dataclasses.replace(own, position=own.position + np.array([0.0, 1e-3]))
    moved = dataclasses.replace(run, markers={**run.markers, "projectile": drifted})
    shown = scene(_solution().trajectory, {"drifted": RunLook(moved, "#000000")}, end=END)
    assert set(shown.runs[0].aside) == {"projectile"}
    found = shown.deviation(shown.runs[0])[:, shown.drawing.markers["projectile"]]
    straight = _scene().deviation(_scene().runs[0])[:, _scene().drawing.markers["projectile"]]
    np.testing.assert_allclose(
        found - straight, np.broadcast_to((0.0, 1e-3), found.shape), rtol=0, atol=1e-9
    )


def test_a_run_that_ends_early_is_shown_until_then() -> None:
    run = _run()
    early = dataclasses.replace(
        run,
        **{
            name: getattr(run, name)[:1000]
            for name in ("t", "q", "u", "kinetic_energy", "potential_energy")
        },
        markers={
            n: dataclasses.replace(m, position=m.position[:1000], velocity=m.velocity[:1000])
            for n, m in run.markers.items()
        },
    )
    shown = scene(_solution().trajectory, {"early": RunLook(early, "#000000")}, end=END)
    assert np.array_equal(np.isnan(shown.error(shown.runs[0])), shown.t > early.t[-1] + 1e-8)


def test_without_markers_centres_of_mass_are_compared() -> None:
    solution = solve(tb.Problem(everything(), 0.5))
    t = np.linspace(0.0, 0.5, 51)
    moved = dataclasses.replace(solution.trajectory(t), q=solution.trajectory(t).q + 1e-6)
    shown = scene(solution.trajectory, {"run": RunLook(moved, "#000000")}, end=0.5)
    assert len(shown.drawing.compared) == 5 and (shown.error(shown.runs[0]) > 1e-7).all()


def test_eight_runs_of_one_machine_weigh_less_than_100_kilobytes() -> None:
    assert len(json.dumps(scene_data(_scene(runs=8)), separators=(",", ":"))) < 100_000


@pytest.mark.parametrize(("magnify", "factor"), [(None, 1e3), (250.0, 250.0)])
def test_deviations_are_magnified_to_be_seen_or_as_asked_for(
    magnify: float | None, factor: float
) -> None:
    shown = scene(
        _solution().trajectory, {"run": RunLook(_run(), "#000000")}, end=END, magnify=magnify
    )
    assert shown.magnification == factor
    if magnify is None:
        seen = factor * np.max(shown.error(shown.runs[0])) / shown.drawing.size
        assert 1 / 80 < seen <= 1 / 8


@pytest.mark.parametrize(
    ("change", "complaint"),
    [
        ({"end": 0.0}, "end = 0.0 s"),
        ({"end": None}, "end = None"),
        ({"magnify": 0.5}, "magnify = 0.5"),
    ],
)
def test_what_cannot_be_shown_is_refused(change: dict[str, Any], complaint: str) -> None:
    with pytest.raises(tb.InputError, match=complaint):
        scene(_solution().trajectory, **({"end": END} | change))


def test_a_run_of_another_mechanism_is_refused() -> None:
    other = solve(tb.Problem(hanging_bob(), 1.0)).trajectory(np.linspace(0, 1, 11))
    with pytest.raises(tb.InputError, match="another mechanism"):
        scene(_solution().trajectory, {"other": RunLook(other, "#000000")}, end=END)


# --- Pages
# --------------------------------------------------------------------------------------------------


def test_a_page_needs_nothing_else_and_no_name_ends_its_script() -> None:
    shown = dataclasses.replace(_scene(), name="</script><b>")
    page = Animation((shown,), "a < b").to_html()
    assert not re.findall(
        r"""(?:src|href)\s*=\s*["'](?!data:)""", page
    ) and "http" not in page.replace("http-equiv", "")
    assert page.count("</script>") == 2 and "a &lt; b" in page
    (data,) = re.findall(r'<script type="application/json">(.*?)</script>', page, re.DOTALL)
    assert json.loads(data)[0]["name"] == "</script><b>"


def test_a_document_has_its_assets_once_and_markdown_none_of_it() -> None:
    block = AnimationBlock((_scene(),))
    report = Document(
        "title",
        (Heading("Motion", 2), block, AnimationBlock(lambda: (_scene(),), "again", anchor="b")),
    )
    page = html.page(report)
    assert page.count("class Player") == 1 and page.count('<section class="animation"') == 2
    assert "class Player" not in html.page(Document("title", (Heading("Motion", 2),)))
    assert "animation" not in markdown.text(report)


def test_the_script_prints_in_the_colours_of_pictures() -> None:
    (printed,) = re.findall(r"const PRINTED = \{(.*?)\}", animation.assets())
    assert dict(re.findall(r'(\w+): "(#\w+)"', printed)) == PALETTE


# --- Files
# --------------------------------------------------------------------------------------------------


@pytest.mark.slow
def test_a_gif_plays_the_motion_slower_about_events(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(animation, "_GIF_RATE", 6)  # a third of the frames
    times = animation.play_times(_scene(), 6.0)
    assert times[0] == 0 and times[-1] == END
    steps = np.diff(times)
    (launch,) = (event.time for event in _scene().events if event.kind == "launch")
    assert steps[np.searchsorted(times, launch) - 2] < 0.5 * steps.max()
    Animation((_scene(),)).save(tmp_path / "motion.gif", width=160)
    with Image.open(tmp_path / "motion.gif") as image:
        assert getattr(image, "n_frames", 1) == len(times) and image.width == 160
        first = np.asarray(image.convert("RGB"))
        assert (first[0, 0] == 255).all()  # the page that it is put into is white
        image.seek(len(times) // 2)
        assert (np.asarray(image.convert("RGB")) != first).any()


@pytest.mark.slow
def test_an_mp4_is_one(tmp_path: Path) -> None:
    pytest.importorskip("imageio_ffmpeg")
    bob = solve(tb.Problem(hanging_bob(), 0.3)).trajectory(np.linspace(0, 0.3, 31))
    bob.animate().save(tmp_path / "motion.mp4", width=100)
    assert (tmp_path / "motion.mp4").read_bytes()[4:8] == b"ftyp"


def test_an_mp4_without_its_package_is_refused_at_once(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(__import__("sys").modules, "imageio_ffmpeg", None)
    with pytest.raises(tb.InputError, match=r"pip install trebucheck\[video\]"):
        Animation((_scene(),)).save(tmp_path / "motion.mp4")
    assert not list(tmp_path.iterdir())


def _centres(part: ET.Element, name: str) -> list[complex]:
    """Centres of the circles of a name in an SVG by Matplotlib [px]; its unit is the point."""
    found: list[complex] = []
    for group in part.iter(f"{SVG}g"):
        if group.get("id") == name:
            (path,) = group.iter(f"{SVG}path")
            numbers = [float(each) for each in re.findall(r"-?[\d.]+", path.get("d", ""))]
            x, y = numbers[0::2], numbers[1::2]
            found.append(complex(min(x) + max(x), min(y) + max(y)) / 2 * 96 / 72)
    return found


def _layers(root: ET.Element, name: str) -> list[ET.Element]:
    """Layers of a moving SVG in their order."""
    return [each for each in root.iter(f"{SVG}g") if each.get("id", "").startswith(f"{name}-")]


def _visibility(layer: ET.Element) -> tuple[list[str], list[float]]:
    """States of a layer, and when it changes to them, in parts of the whole."""
    (animate,) = layer.findall(f"{SVG}animate")
    times = [float(each) for each in animate.get("keyTimes", "").split(";")]
    return animate.get("values", "").split(";"), times


MASSES = ("counterweight", "projectile")


def _masses(stage: Stage, time: float) -> np.ndarray:
    """Where both masses belong in the picture [px]."""
    return stage.pixels(stage.points(time))[[stage.scene.drawing.markers[n] for n in MASSES]]


def test_a_stroboscope_shows_start_events_and_end(tmp_path: Path) -> None:
    releases = [event.time for event in _scene().events if event.kind == "release"]
    times = [0.0, *releases, END]
    Animation((_scene(),)).save(tmp_path / "motion.svg", at=times)
    root = ET.fromstring((tmp_path / "motion.svg").read_text())
    stage = Stage(_scene(), 640)
    size = [float(root.attrib[name].removesuffix("pt")) * 96 / 72 for name in ("width", "height")]
    assert size == [640, stage.height]
    drawn = _centres(root, "mass")
    assert len(drawn) == 2 * len(times)
    for time in times:
        for place in _masses(stage, time):
            assert np.abs(np.array(drawn) - place).min() < 0.02


def test_a_still_picture_is_of_its_instant(tmp_path: Path) -> None:
    Animation((_scene(),)).save(tmp_path / "still.svg", at=1.25)
    text = (tmp_path / "still.svg").read_text()
    drawn = _centres(ET.fromstring(text), "mass")
    assert len(drawn) == 2
    for place in _masses(Stage(_scene(), 640), 1.25):
        assert np.abs(np.array(drawn) - place).min() < 0.02
    assert "<animate" not in text and "t = 1.250 s" in text


@pytest.fixture(scope="module")
def moving_svg(tmp_path_factory: pytest.TempPathFactory) -> str:
    """Of the scene with one run."""
    path = tmp_path_factory.mktemp("svg") / "motion.svg"
    Animation((_scene(),)).save(path)
    return path.read_text()


def test_an_svg_plays_by_itself_from_start_to_end(moving_svg: str) -> None:
    shown, text = _scene(), moving_svg
    root = ET.fromstring(text)
    assert "<script" not in text and "href" not in text and len(text) < 1_200_000
    stage, times = Stage(shown, 640), animation.play_times(shown, animation._SVG_RATE)
    frames = _layers(root, "frame")
    assert len(frames) == len(times)
    duration = len(times) / animation._SVG_RATE + animation.HOLD
    for k, (frame, time) in enumerate(zip(frames, times, strict=True)):
        drawn = np.array(_centres(frame, "mass"))
        for place in _masses(stage, time):
            assert np.abs(drawn - place).min() < 0.02
        states, at = _visibility(frame)
        assert states.count("visible") == 1
        begin = at[states.index("visible")]
        assert begin == pytest.approx(k / animation._SVG_RATE / duration, abs=1e-5)
        end = 1.0 if states[-1] == "visible" else at[-1]
        last = k == len(times) - 1
        finish = (k + 1) / animation._SVG_RATE / duration
        assert end == pytest.approx(1.0 if last else finish, abs=1e-5)
    labels = [each.text for each in root.iter(f"{SVG}text")]
    assert "t = 0.000 s" in labels and f"t = {END:.3f} s" in labels


def test_in_an_svg_traces_grow_and_stay(moving_svg: str) -> None:
    paths = _layers(ET.fromstring(moving_svg), "path")
    assert not list(paths[0].iter(f"{SVG}path"))  # at the start there is none
    for path in paths[1:]:
        assert len(list(path.iter(f"{SVG}path"))) == 2 * len(_scene().drawing.compared)
        assert _visibility(path)[0] == ["hidden", "visible"]


def test_a_program_that_plays_no_svg_shows_one_instant_with_its_traces(moving_svg: str) -> None:
    root = ET.fromstring(moving_svg)
    (seen,) = [
        k for k, each in enumerate(_layers(root, "frame")) if each.get("visibility") == "visible"
    ]
    paths = [each.get("visibility") for each in _layers(root, "path")]
    assert paths == ["visible"] * (seen + 1) + ["hidden"] * (len(paths) - seen - 1)


def test_in_an_svg_a_run_is_not_seen_after_its_end(tmp_path: Path) -> None:
    short = _solution(1e-5).trajectory(np.linspace(0.0, 1.0, 1001))
    shown = scene(_solution().trajectory, {"short": RunLook(short, "#00ff00")}, end=1.5)
    Animation((shown,)).save(tmp_path / "motion.svg")
    root = ET.fromstring((tmp_path / "motion.svg").read_text())
    frames = _layers(root, "frame")
    times = animation.play_times(shown, animation._SVG_RATE)
    assert times[0] <= 1.0 < times[-1]
    for frame, time in zip(frames, times, strict=True):
        assert ("#00ff00" in ET.tostring(frame, encoding="unicode")) == (time <= 1.0)


def test_a_trajectory_plays_in_a_notebook_with_others_over_it() -> None:
    reference = _solution().trajectory(np.linspace(0, 2.8, 1401))
    shown = reference.animate(_run())
    assert repr(shown) == "Animation of fixed (1 runs)"
    assert shown._repr_html_().startswith("<iframe")
    own, other = (
        shown.scenes[0],
        scene(_solution().trajectory, {"run": RunLook(_run(), "#000000")}, end=2.8),
    )
    # the trajectory's own states between its samples of 2 ms: cubic, so that the deviation of 1e-4
    # m stays itself
    np.testing.assert_allclose(
        np.nanmax(own.error(own.runs[0])), np.nanmax(other.error(other.runs[0])), rtol=1e-3, atol=0
    )
    at = np.array([0.3, 1.0, 2.0])
    np.testing.assert_allclose(
        resampled(reference)(at).q, _solution().trajectory(at).q, rtol=0, atol=1e-8
    )


@cache
def _swing(*start: float, engine: str = "reference") -> Trajectory:
    """A double pendulum from a start, by an engine."""
    mechanism = tb.model("double-pendulum", start=start)
    motion = solve(tb.Problem(mechanism, 2.2)).trajectory(np.linspace(0.0, 2.2, 441))
    made = dataclasses.replace(motion.provenance, engine=engine, preset="default")
    return dataclasses.replace(motion, provenance=made)


def test_motions_from_other_starts_are_drawn_alike_and_named_by_their_starts() -> None:
    first, other = _swing(-0.5, -0.5), _swing(1.0, -0.5)
    shown = first.animate(other, _swing(0.5, 0.5, engine="mine")).scenes[0]
    assert shown.label == "reference, start a1 = -0.5 rad, a2 = -0.5 rad"
    assert [run.name for run in shown.runs] == [
        "reference, start a1 = 1 rad",
        "mine default, start a1 = 0.5 rad, a2 = 0.5 rad",
    ]
    assert len({run.colour for run in shown.runs}) == 2
    # They are no runs that deviate from the first one, and nothing is magnified.
    assert not any(run.compared for run in shown.runs) and shown.magnification == 1.0
    t, marker = np.linspace(0.0, 2.2, 441), shown.drawing.markers["tip"]
    drawn = shown.at(t, shown.runs[0], 1000.0)[:, marker]
    np.testing.assert_allclose(drawn, other.marker("tip").position, rtol=0, atol=5e-3)
    left, lower, right, upper = shown.box
    x, y = other.marker("tip").position.T
    assert (left < x).all() and (x < right).all() and (lower < y).all() and (y < upper).all()
    # The same shapes of the same sizes, in another colour.
    stage = Stage(shown)
    stage.show(0.7)
    widths: dict[str, list[float]] = {}
    for patch in stage.stage.patches:
        colour = mpl.colors.to_hex(patch.get_edgecolor())
        widths.setdefault(colour, []).append(patch.get_linewidth())
    bodies = [widths[colour] for colour in (PALETTE["body"], *(r.colour for r in shown.runs))]
    assert len(bodies[0]) == 2 and bodies[1:] == bodies[:1] * 2


def test_what_others_deviate_from_is_the_reference_s_own() -> None:
    own, mine = _swing(-0.5, -0.5), _swing(-0.5, -0.5, engine="mine")
    for first, other in ((mine, own), (own, mine)):
        shown = first.animate(other).scenes[0]
        assert shown.label == "reference" and [run.name for run in shown.runs] == ["mine default"]
        assert shown.runs[0].compared
    assert mine.animate().scenes[0].label == "mine default"
    again = own.animate(*(dataclasses.replace(own) for _ in range(2))).scenes[0]
    assert [run.name for run in again.runs] == [
        "another run of the reference", "another run of the reference (2)",
    ]  # fmt: skip


def test_a_motion_beyond_its_horizon_has_a_warning() -> None:
    chaotic, tame = _swing(-0.5, -0.5).animate(), _swing(1.5, 1.6).animate()
    shown = chaotic.scenes[0]
    assert shown.horizon is not None and 1.0 < shown.horizon < 2.2
    assert f"{shown.horizon:.4g} s" in shown.warning and shown.warning in shown.notes
    assert scene_data(shown)["horizon"] == shown.horizon
    stage = Stage(shown)
    said = " ".join(text.get_text() for text in stage.legend.texts)
    assert shown.warning in said
    assert not tame.scenes[0].warning and not Stage(tame.scenes[0]).legend.texts
    # It is that of any motion that is drawn.
    assert _swing(1.5, 1.6).animate(_swing(-0.5, -0.5)).scenes[0].horizon == shown.horizon


# --- The command
# --------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("arguments", "complaint"),
    [
        (
            ["fixed", "--out", "motion.png"],
            "'motion.png' must end in one of: .gif, .mp4, .svg, .html.",
        ),
        (["fixed", "--out", "motion"], "must end in one of"),
        (["fixed,rolling", "--out", "motion.gif"], "can show one machine, not 2"),
        (["pendulum", "--magnify", "0.1", "--out", "motion.svg"], "magnify = 0.1"),
        (["pendulum", "--width", "20", "--out", "motion.svg"], "width = 20 px"),
        (
            ["pendulum", "--at", "0.1", "--out", "motion.gif"],
            "instants are chosen for a still picture (.svg)",
        ),
        (["pendulum", "--at", "0.1,soon", "--out", "motion.svg"], "--at 'soon' is not a number"),
        (
            ["pendulum", "--until", "0.1", "--at", "0.2", "--out", "motion.svg"],
            "at = 0.2 s is not within the motion",
        ),
        (
            ["pendulum", "--until", "0.1", "--at", "nan", "--out", "motion.svg"],
            "at = nan s is not within the motion",
        ),
        (["--from", ".", "--out", "motion.svg"], "holds no trajectories"),
        (["absent", "--out", "motion.svg"], "no model 'absent'"),
        (["fixed", "--engines", "mujoko", "--out", "motion.svg"], "did you mean 'mujoco'"),
        (["fixed", "--timeout", "0", "--out", "motion.svg"], "--timeout"),
    ],
)
def test_wrong_input_gets_a_sentence_and_writes_nothing(
    arguments: list[str],
    complaint: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    refused: Callable[..., str],
) -> None:
    monkeypatch.chdir(tmp_path)
    assert complaint in refused("animate", *arguments)
    assert not list(tmp_path.iterdir())


def test_a_file_in_the_folder_s_place_is_told(tmp_path: Path, refused: Callable[..., str]) -> None:
    (tmp_path / "there").write_text("")
    assert "is not a folder" in refused(
        "animate", "pendulum", "--out", str(tmp_path / "there" / "motion.gif")
    )


@pytest.mark.slow
def test_animate_writes_a_problem_s_motion_and_that_of_files(
    tmp_path: Path, refused: Callable[..., str], capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["animate", "pendulum", "--out", str(tmp_path / "motion.svg")]) == 0
    assert (tmp_path / "motion.svg").read_text().startswith("<svg")
    save(_run(), tmp_path / "kept" / "fixed.nc")
    assert (
        main(["animate", "--from", str(tmp_path / "kept"), "--out", str(tmp_path / "motion.html")])
        == 0
    )
    for k, start in enumerate(((-0.5, -0.5), (1.0, 2.0))):
        save(_swing(*start), tmp_path / "two" / f"{k}.nc")
    out = tmp_path / "two.svg"
    assert main(["animate", "--from", str(tmp_path / "two"), "--at", "1", "--out", str(out)]) == 0
    assert "start a1 = 1 rad, a2 = 2 rad" in out.read_text()
    assert "motion.html" in capsys.readouterr().out
    assert "holds those of: fixed" in refused(
        "animate",
        "rolling",
        "--from",
        str(tmp_path / "kept"),
        "--out",
        str(tmp_path / "other.html"),
    )


def test_view_without_a_display_is_one_sentence(
    monkeypatch: pytest.MonkeyPatch, refused: Callable[..., str]
) -> None:
    pytest.importorskip("mujoco")  # whose viewer it is
    for name in ("DISPLAY", "WAYLAND_DISPLAY"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setattr("sys.platform", "linux")
    assert "a viewer needs a display" in refused("view", "fixed")
    assert "has no viewer" in refused("view", "fixed", "--engine", "reference")


def test_view_opens_the_exported_scene_at_the_start(monkeypatch: pytest.MonkeyPatch) -> None:
    viewer, shown = pytest.importorskip("mujoco.viewer"), list[Any]()
    monkeypatch.setenv("DISPLAY", ":0")
    monkeypatch.setattr(
        viewer, "launch", lambda model, data: shown.append((model, data.qpos.copy()))
    )
    assert main(["view", "rolling"]) == 0
    ((model, start),) = shown
    assert (
        model.nq == 4 and model.nlight >= 1 and not start.any()
    )  # its joints read zero at the start
