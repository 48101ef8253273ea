"""The page of an animation in a browser.

What is drawn is where the data say, and the controls move it.
"""

from __future__ import annotations

from collections.abc import Iterator
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trebucheck as tb
from mechanisms import everything, fixed, hanging_bob
from trebucheck.comparisons.report.drawing import animation
from trebucheck.comparisons.report.drawing.animation import Animation, Stage
from trebucheck.comparisons.report.drawing.scene import RunLook, Scene, play_times, scene
from trebucheck.reference.solver import solve

pytestmark = pytest.mark.slow

RED, BLUE = "#d00000", "#0000d0"
SPY = """
window.arcs = [];
const arc = CanvasRenderingContext2D.prototype.arc;
CanvasRenderingContext2D.prototype.arc = function (x, y, ...rest) {
  window.arcs.push([x, y]);
  arc.call(this, x, y, ...rest);
};
"""
PLAYER = "document.querySelector('section.animation').trebucheck"


def _scene(mechanism: tb.Mechanism, duration: float, shift: float) -> Scene:
    """Two runs that leave the reference in opposite directions, by angles and slides that grow with
    time.
    """
    solution = solve(tb.Problem(mechanism, duration))
    t = np.linspace(0.0, duration, 401)
    motion = solution.trajectory(t)
    looks: dict[str, RunLook] = {}
    for name, sign, colour in (("first", 1, RED), ("second", -1, BLUE)):
        run = solution.reading(
            t, solution.motion_of(t, motion.q + sign * shift * t[:, None], motion.u)
        )
        looks[name] = RunLook(run, colour, dashed=sign < 0)
    return scene(solution.trajectory, looks, end=duration)


@cache
def _shown(index: int) -> Scene:
    """One of the three scenes of the page."""
    mechanism, duration, shift = (
        (fixed, 2.7, 1e-4),
        (hanging_bob, 2.0, 1e-7),
        (everything, 0.5, 1e-3),
    )[index]
    return _scene(mechanism(), duration, shift)


@pytest.fixture(scope="module")
def window(windows: Any, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Any]:
    """A window and the address of the scenes' page in it."""
    path = tmp_path_factory.mktemp("animation") / "scenes.html"
    Animation(tuple(map(_shown, range(3))), "scenes").save(path)
    page = windows.new_page()
    page.add_init_script(SPY)
    yield page, path.as_uri()
    page.close()


SIZE = {"width": 1000, "height": 900}


@pytest.fixture
def page(window: Any) -> Iterator[Any]:
    """The page, loaded anew; it complains about nothing and asks for nothing."""
    page, address = window
    complaints: list[str] = []
    heard = {
        "console": lambda message: complaints.append(message.text),
        "pageerror": lambda error: complaints.append(str(error)),
        "request": lambda request: complaints.append(request.url),
    }
    for event, listener in heard.items():
        page.on(event, listener)
    page.set_viewport_size(SIZE)
    page.goto(address)
    yield page
    for event, listener in heard.items():
        page.remove_listener(event, listener)
    quiet = (address, "data:", "Canvas2D")
    assert [text for text in complaints if not text.startswith(quiet)] == []


def _pixel(shown: Scene, point: np.ndarray, canvas: dict[str, float]) -> np.ndarray:
    """Where a point of the world belongs in a canvas that shows the scene's box as large as it
    can."""
    x0, y0, x1, y1 = shown.box
    scale = min(canvas["width"] / (x1 - x0), canvas["height"] / (y1 - y0))
    middle = np.array([x0 + x1, y0 + y1]) / 2
    return np.array([canvas["width"], canvas["height"]]) / 2 + scale * (point - middle) * (1, -1)


@pytest.mark.parametrize("index", [0, 1])
@pytest.mark.parametrize("factor", [1, 1000])
def test_a_run_s_marker_is_drawn_where_the_data_say(page: Any, index: int, factor: int) -> None:
    shown = _shown(index)
    page.evaluate(f"{PLAYER}.choose({index}); {PLAYER}.magnify({factor})")
    for option in ("traces", "names"):
        page.uncheck(f".animation-{option}")
    for box in page.locator("tbody input").all():
        box.uncheck()
    canvas = page.evaluate(
        "(c => ({width: c.clientWidth, height: c.clientHeight}))(document.querySelector('canvas'))"
    )
    marker = next(iter(shown.drawing.markers))
    for k, (run, colour) in enumerate(zip(shown.runs, ((0xD0, 0, 0), (0, 0, 0xD0)), strict=True)):
        page.locator("tbody input").nth(k + 1).check()
        for time in (0.0, 0.31 * shown.t[-1], float(shown.t[-1])):
            arcs = np.array(page.evaluate(f"window.arcs = []; {PLAYER}.seek({time}); window.arcs"))
            there = shown.at(np.array([time]), run, factor)[0, shown.drawing.markers[marker]]
            expected = _pixel(shown, there, canvas)
            assert page.evaluate(f"{PLAYER}.pixelOf('{marker}', '{run.name}')") == pytest.approx(
                expected, abs=0.5
            )
            assert np.hypot(*(arcs - expected).T).min() < 0.1  # the disc of the marker itself
            x, y = (round(float(v)) for v in expected)
            if 1 < x < canvas["width"] - 1 and 1 < y < canvas["height"] - 1:
                pixel = (
                    f"document.querySelector('canvas').getContext('2d').getImageData({x}, "
                    f"{y}, "
                    "1, "
                    "1).data"
                )
                assert page.evaluate(f"Array.from({pixel})")[:3] == list(colour)
        page.locator("tbody input").nth(k + 1).uncheck()


@pytest.mark.parametrize("index", [0, 1, 2])
def test_live_errors_are_the_data_s(page: Any, index: int) -> None:
    shown = _shown(index)
    assert len(shown.runs) > 0
    page.evaluate(f"{PLAYER}.choose({index})")
    for frame in (len(shown.t) // 3, len(shown.t) - 1):
        page.evaluate(f"{PLAYER}.seek({float(shown.t[frame])!r})")
        for k, run in enumerate(shown.runs):
            expected = shown.error(run)[frame]
            assert page.evaluate(f"{PLAYER}.errorOf('{run.name}')") == pytest.approx(
                expected, rel=1e-5
            )
            written = page.locator("tbody tr").nth(k + 1).locator("td").last.inner_text()
            assert float(written) == pytest.approx(expected, rel=6e-3)


@pytest.mark.parametrize("index", [0, 2])
def test_forces_are_those_of_the_solver_that_is_chosen(page: Any, index: int) -> None:
    shown = _shown(index)
    page.evaluate(f"{PLAYER}.choose({index}); {PLAYER}.magnify(1)")
    for option in ("traces", "names"):
        page.uncheck(f".animation-{option}")
    for box in page.locator("tbody input").all():
        box.uncheck()  # the lines of the solvers have their colours
    assert page.locator(".animation-solver option").all_inner_texts() == [
        "reference", "first", "second", "all that are shown"
    ]  # fmt: skip
    frame = len(shown.t) // 4
    page.evaluate(f"{PLAYER}.seek({float(shown.t[frame])!r})")
    reference = page.evaluate(f"{PLAYER}.forcesOf('reference')")
    for run, red in zip(shown.runs, (True, False), strict=True):
        found = page.evaluate(f"{PLAYER}.forcesOf('{run.name}')")
        assert found["joints"] and found != reference
        for name, force in found["joints"].items():
            assert force == pytest.approx(
                run.forces[name][frame], rel=1e-3, abs=1e-3 * np.abs(run.forces[name]).max()
            )
        for name, value in found["stops"].items():
            assert value == pytest.approx(run.torques[name][frame], rel=1e-3, abs=1e-9)
        page.select_option(".animation-solver", run.name)
        assert page.is_checked(".animation-forces")
        assert (_count(page, (0xD0, 0, 0)) > 20, _count(page, (0, 0, 0xD0)) > 20) == (red, not red)
    page.locator("tbody input").nth(1).check()
    page.select_option(".animation-solver", "reference")
    lines = _count(page, (0xD0, 0, 0))
    page.select_option(".animation-solver", "*")
    assert _count(page, (0xD0, 0, 0)) > lines


def _count(page: Any, colour: tuple[int, int, int]) -> int:
    """Pixels of a colour."""
    return page.evaluate(
        """colour => {
          const canvas = document.querySelector('canvas');
          const { data } = canvas.getContext('2d').getImageData(0, 0, canvas.width, canvas.height);
          let count = 0;
          for (let i = 0; i < data.length; i += 4) count += colour.every((value, k) => data[i + k] === value);
          return count;
        }""",
        list(colour),
    )


def test_play_scrub_keys_and_events_move_the_drawing(page: Any) -> None:
    picture = "document.querySelector('canvas').toDataURL()"
    before = page.evaluate(picture)
    page.click(".animation-play")
    page.wait_for_function(f"{PLAYER}.time > 0.05 && {PLAYER}.time < 2")
    assert page.evaluate(picture) != before
    page.focus("canvas")
    page.keyboard.press(" ")
    assert not page.evaluate(f"{PLAYER}.playing")
    time = page.evaluate(f"{PLAYER}.time")
    page.keyboard.press("ArrowRight")
    assert page.evaluate(f"{PLAYER}.time") == pytest.approx(time + 0.005 * _shown(0).t[-1])
    page.locator(".animation-ticks button").first.click()
    assert page.evaluate(f"{PLAYER}.time") == _shown(0).events[0].time
    page.locator(".animation-bar input").fill("0.5")
    assert page.evaluate(f"{PLAYER}.time") == 0.5
    page.locator(".animation-magnify input").fill("3")
    assert page.locator(".animation-magnify output").inner_text() == "× 1,000"


@pytest.mark.parametrize("width", [360, 390, 1200])
def test_nothing_leaves_the_screen(page: Any, width: int) -> None:
    page.set_viewport_size({"width": width, "height": 800})
    page.locator("details").first.evaluate("details => { details.open = true; }")
    assert page.evaluate("document.documentElement.scrollWidth") <= width


def test_an_svg_plays_in_a_browser(windows: Any, tmp_path: Path) -> None:
    shown = _shown(0)
    Animation((shown,)).save(tmp_path / "motion.svg")
    stage = Stage(shown, 640)
    times = play_times(shown, animation._SVG_RATE)
    page = windows.new_page()
    page.set_viewport_size({"width": 700, "height": 700})
    page.goto((tmp_path / "motion.svg").as_uri())
    seen = "getComputedStyle(e).visibility == 'visible'"
    for k in (0, len(times) // 3, len(times) - 1):
        page.evaluate("document.documentElement.pauseAnimations()")
        instant = (k + 0.5) / animation._SVG_RATE
        page.evaluate("time => document.documentElement.setCurrentTime(time)", instant)
        boxes = page.evaluate(
            f"Array.from(document.querySelectorAll('g#mass'), e => {seen} && e.getBBox())"
            ".filter(b => b).map(b => [b.x + b.width / 2, b.y + b.height / 2])"
        )
        assert len(boxes) == 2  # those of one frame
        points = stage.pixels(stage.points(times[k]))
        for marker in ("counterweight", "projectile"):
            there = points[shown.drawing.markers[marker]]
            assert min(abs(complex(*each) * 96 / 72 - there) for each in boxes) < 0.05
        texts = f"Array.from(document.querySelectorAll('text')).filter(e => {seen})"
        clocks = page.evaluate(f"{texts}.map(t => t.textContent)")
        (clock,) = (text for text in clocks if text.startswith("t = "))
        assert float(clock.split()[2]) == pytest.approx(times[k], abs=1e-3)
    page.close()
