"""No wrong engine agrees, and a right one agrees everywhere.

Engines of strangers, of which nothing is known.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import mechanisms
import pytest
import trebucheck as tb
import wrong_engines
from trebucheck.cli.app import main
from trebucheck.comparisons.runs.results import Outcome, Results, Run


@pytest.fixture(autouse=True, scope="module")
def announced(tmp_path_factory: pytest.TempPathFactory) -> Iterator[None]:
    """The engines, as an installed distribution announces them.

    Without diagnoses, which are tried elsewhere.
    """
    folder = tmp_path_factory.mktemp("site")
    wrong_engines.announce(folder)
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(str(folder))
        yield


@pytest.fixture(scope="module")
def wrong(announced: None) -> dict[str, Results]:
    """Each wrong engine's run on the fixed machine, as results of its own."""
    names = [cls.name for cls in wrong_engines.WRONG.values()]
    results = tb.compare([tb.fixed()], names, ["assisted"], isolate=False, diagnose=False).results
    return {run.engine: results.model_copy(update={"runs": (run,)}) for run in results.runs}


def _run(engine: str, mechanism: tb.Mechanism, **options: object) -> tuple[Run, bool]:
    comparison = tb.compare(
        [mechanism], [engine], ["assisted"], isolate=False, diagnose=False, **options
    )  # type: ignore[arg-type]
    (run,) = comparison.results.runs
    return run, comparison.passed


RIGHT: dict[str, tuple[tb.Mechanism, dict[str, object]]] = {
    "fixed": (tb.fixed(), {}),
    "rolling": (tb.rolling(), {}),
    "hinged": (tb.hinged(), {}),
    "catapult": (tb.catapult(), {}),
    "desk": (
        tb.fixed(
            tb.TrebuchetParameters(l1=0.2, l2=0.08, r=0.12, h=0.16, m_b=0.02, m_cw=1.0, m_a=0.15)
        ),
        {},
    ),
    "fixed, to a release": (tb.fixed(), {"until": "release:sling rest"}),
    "fixed, far": (tb.fixed(), {"duration": 8.0, "timestep": 5e-3}),
    "rolling, impacts": (tb.rolling(), {"duration": 3.0, "stop_law": "unilateral"}),
    "pendulum": (mechanisms.hanging_bob(), {"duration": 2.0}),
}


@pytest.mark.parametrize("name", RIGHT)
def test_a_right_engine_agrees(name: str) -> None:
    mechanism, options = RIGHT[name]
    run, passed = _run("honest", mechanism, **options)
    assert run.outcome is Outcome.AGREES, [run.message, run.broken, run.unjudged]
    assert passed and len(run.judged) >= 6


@pytest.mark.parametrize("engine", sorted(wrong_engines.WRONG))
def test_a_wrong_engine_does_not_agree(engine: str, wrong: dict[str, Results]) -> None:
    results = wrong[wrong_engines.WRONG[engine].name]
    (run,) = results.runs
    assert run.outcome in (Outcome.DISAGREES, Outcome.FAILED, Outcome.NOT_EQUIVALENT)
    assert not results.passed
    assert run.broken or (run.message and "Traceback" not in run.message)


def test_an_engine_that_follows_another_law_does_not_agree() -> None:
    run, passed = _run("bilateral", tb.rolling(), duration=3.0, stop_law="unilateral")
    assert run.outcome is Outcome.DISAGREES and not passed
    assert "stop_penetration (arm stop)" in {metric.label for metric in run.broken}


def test_a_wrong_engine_is_exit_code_1_and_a_right_one_0(tmp_path: Path) -> None:
    asked = [
        "compare",
        "--models",
        "fixed",
        "--preset",
        "assisted",
        "--no-diagnose",
        "--until",
        "1.2",
        "--out",
        str(tmp_path),
        "--engines",
    ]
    assert main([*asked, "honest"]) == 0
    assert main([*asked, "honest,nan"]) == 1
