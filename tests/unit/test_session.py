"""What a session or a notebook shows of everything a user holds, and the commands as functions."""

from __future__ import annotations

import doctest
import importlib
import pickle
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trebucheck as tb
from trebucheck.comparisons import certify as certifying
from trebucheck.comparisons.compare import Comparison
from trebucheck.models.library.registry import library_problem
from trebucheck.models.shown import Reported, Shown
from trebucheck.reference.certification.certificate import load_certificate
from trebucheck.reference.solver import solve
from trebucheck_paper.evidence.claims import Study as PaperStudy

pytestmark = pytest.mark.slow  # one of everything is made for all of them: some 5 s

PROBLEM = tb.Problem(tb.fixed(), duration=2.0)


@cache
def comparison() -> Comparison:
    return tb.compare(
        [PROBLEM], ["mujoco"], ["default"], timestep=4e-3, isolate=False, diagnose=False
    )


@cache
def held() -> dict[str, Any]:
    """One of everything."""
    with_store = comparison()
    pendulum: dict[str, Any] = {"until": 0.5, "isolate": False}
    return {
        "mechanism": tb.fixed(),
        "problem": PROBLEM,
        "trajectory": tb.engine("reference").simulate(PROBLEM),
        "solution": solve(PROBLEM),
        "throw": tb.throw(tb.fixed()),
        "certificate": load_certificate(tb.fixed()),
        "comparison": with_store,
        "difference": tb.diff(with_store, with_store),
        "convergence": tb.converge("pendulum", ["mujoco"], knobs=["integrator"], **pendulum),
        "explanation": tb.explain(
            tb.fixed(), ["mujoco"], ["default"], timestep=1e-2, until=0.5, isolate=False
        ),
        "advice": tb.recommend("fixed", ["mujoco"], position=1e-2, neighbours=0, isolate=False),
    }


KINDS = (
    "mechanism",
    "problem",
    "trajectory",
    "solution",
    "throw",
    "certificate",
    "comparison",
    "difference",
    "convergence",
    "explanation",
    "advice",
)


@pytest.mark.parametrize("kind", KINDS)
def test_a_repr_is_one_short_line(kind: str) -> None:
    each = held()[kind]
    assert isinstance(each, Shown)
    for text in (repr(each), str(each)):
        assert "\n" not in text
        assert 20 < len(text) < 300
        assert "array(" not in text


@pytest.mark.parametrize("kind", KINDS)
def test_a_notebook_shows_a_fragment(kind: str) -> None:
    html = held()[kind]._repr_html_()
    whole = html.startswith("<iframe") and html.endswith("</iframe>") and html.count("<iframe") == 1
    assert whole or (html.startswith("<table>") and html.endswith("</table>"))
    assert "<html" not in html  # a page stands in a frame, as the text of an attribute


@pytest.mark.parametrize("kind", KINDS)
def test_data_frames_hold_what_the_results_hold(kind: str) -> None:
    each = held()[kind]
    if isinstance(each, Reported):
        rows, frame = list(each.rows()), each.to_dataframe()
        assert len(frame) == len(rows) > 0


def test_the_frame_of_a_trajectory_is_the_trajectory() -> None:
    motion = held()["trajectory"]
    frame = motion.to_dataframe()
    assert np.array_equal(frame.index, motion.t)
    assert np.array_equal(frame["projectile y"], motion.marker("projectile").position[:, 1])
    assert np.array_equal(frame["stop hanger rest"], motion.stop_torque("hanger rest"))
    assert np.array_equal(frame["joint fulcrum x"], motion.joint_reaction("fulcrum")[:, 0])


def test_the_frame_of_a_comparison_has_every_metric() -> None:
    frame = comparison().to_dataframe()
    (run,) = comparison().results.runs
    assert list(frame["value"].astype(object).where(frame["value"].notna(), None)) == [
        m.value for m in run.metrics
    ]


@pytest.mark.parametrize(
    "kind", ["trajectory", "throw", "comparison", "convergence", "explanation"]
)
def test_plots_are_figures_that_a_notebook_shows(kind: str) -> None:
    figure = held()[kind].plot()
    assert any(axes.lines or axes.patches for axes in figure.axes)
    assert figure._repr_png_().startswith(b"\x89PNG")


def test_a_figure_that_is_not_there_is_named_with_those_that_are() -> None:
    with pytest.raises(
        tb.InputError, match=r"has no figure 'fixed-nonsense'; there are .*fixed-distances"
    ):
        comparison().plot("fixed-nonsense")
    assert comparison().plot("fixed-distances").axes


@pytest.mark.parametrize("kind", ["trajectory", "throw", "comparison", "difference", "certificate"])
def test_pages_are_written(kind: str, tmp_path: Path) -> None:
    path = tmp_path / "page.html"
    held()[kind].write_html(path)
    assert path.read_text(encoding="utf-8").startswith("<!doctype html>")


def test_a_throw_keeps_its_motion_only_in_the_session() -> None:
    throw = held()["throw"]
    again = tb.throw(tb.fixed())
    assert again == throw
    assert throw.performance.flight.range == throw.flight.range
    assert pickle.loads(pickle.dumps(throw)) == throw
    read = type(throw).from_json(throw.to_json())
    assert read == throw
    assert read.headline() == throw.headline()
    with pytest.raises(tb.InputError, match="read from a file and has no motion"):
        read.plot()


@pytest.mark.parametrize("name", ["reference", "mujoco", "pymunk", "exudyn"])
def test_simulate_says_what_is_missing(name: str) -> None:
    wrong: Any = tb.fixed()
    with pytest.raises(
        tb.InputError,
        match=r"simulate\(a Mechanism\) .* simulate\(tb\.Problem\(mechanism, duration=",
    ):
        tb.engine(name).simulate(wrong)


def test_the_paper_can_be_called_whatever_was_imported_first() -> None:
    importlib.import_module("trebucheck_paper.report")
    wrong: Any = ["nonsense"]
    with pytest.raises(tb.InputError, match="nonsense"):
        tb.paper(wrong)
    paper: Any = tb.paper
    empty = PaperStudy(made="", versions={}, machines=(), claims=(), seconds=0.0)
    assert repr(empty).startswith("<The paper, 0 rows")
    assert paper.__doc__


def test_nothing_asked_is_refused() -> None:
    with pytest.raises(tb.InputError, match="nothing is asked"):
        tb.recommend("fixed")


def test_certify_takes_a_problems_own_duration_and_law(monkeypatch: pytest.MonkeyPatch) -> None:
    asked: list[dict[str, Any]] = []
    monkeypatch.setattr(certifying.certification, "certify", lambda *_, **how: asked.append(how))
    tb.certify(tb.Problem(tb.fixed(), duration=0.1, stop_law=tb.StopLaw.UNILATERAL))
    tb.certify("squeezer")
    tb.certify("fixed", duration=1.5)
    squeezer = library_problem("squeezer")
    assert squeezer is not None
    assert [how["duration"] for how in asked] == [0.1, squeezer.duration, 1.5]
    assert [how["stop_law"] for how in asked] == ["unilateral", squeezer.stop_law, "release-once"]


@pytest.mark.parametrize(
    "module",
    [
        "comparisons.converge",
        "comparisons.explain",
        "comparisons.certify",
        "comparisons.diff",
    ],
)
def test_examples_in_docstrings_are_python(module: str) -> None:
    found = doctest.DocTestFinder().find(importlib.import_module(f"trebucheck.{module}"))
    assert any(test.examples for test in found)
    for test in found:
        for example in test.examples:
            compile(example.source, module, "single")
