"""Mistakes that strangers make in adapters, through the whole path: rejected, with the cause; the
table is longer.

`python tests/adapter_mistakes.py` prints all of it.
"""

from __future__ import annotations

from collections.abc import Iterator
from functools import cache

import adapter_mistakes
import pytest
import trebucheck as tb
from adapter_mistakes import MISTAKES, compared, problem, verdict
from trebucheck.comparisons.runs import record as machine
from trebucheck.comparisons.runs.process import Worker
from trebucheck.comparisons.runs.results import Outcome
from trebucheck.comparisons.runs.runner import Runner
from trebucheck.comparisons.runs.study import Until

SAMPLE = (
    (
        "slider-crank",
        "reactions of two joints swapped",
        "joint forces of the pivot and crank pin exchanged",
    ),
    ("slider-crank", "reactions in the parent's frame", "joint forces in the frame of the parent"),
    (
        "slider-crank",
        "angles relative, speeds not",
        "angles, not their speeds, relative to the parent",
    ),
    (
        "slider-crank",
        "kinetic energy without rotation",
        "kinetic energy without the rotation of the bodies",
    ),
    ("slider-crank", "inertias about the joints", "inertias about the joints in place of"),
)
"""Problem, mistake, and the beginning of a cause that is named."""


@cache
def _of(mechanism: tb.Mechanism, until: Until, law: tb.StopLaw) -> Runner:
    return Runner(mechanism, None, until, law)


def _runner(mechanism: tb.Mechanism, _: Worker, until: Until, law: tb.StopLaw) -> Runner:
    return _of(mechanism, until, law)


@pytest.fixture(autouse=True, scope="module")
def _announced(tmp_path_factory: pytest.TempPathFactory) -> Iterator[None]:
    """The engine, and each problem's reference once: no mistake is in it."""
    folder = tmp_path_factory.mktemp("site")
    adapter_mistakes.announce(folder)
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(str(folder))
        patch.setattr(machine, "Runner", _runner)
        yield


@pytest.mark.parametrize(("name", "mistake", "cause"), SAMPLE)
def test_a_mistake_is_rejected_and_named(name: str, mistake: str, cause: str) -> None:
    run = compared(mistake, *problem(name))
    assert run.outcome is Outcome.DISAGREES and run.diagnosis is not None
    assert verdict(MISTAKES[mistake], run) == "named", run.diagnosis
    assert any(each.name.startswith(cause) for each in run.diagnosis.named), run.diagnosis


def test_a_load_that_moves_nothing_is_named_beside_the_scale_of_what_it_loads() -> None:
    """The motor's bodies are balanced: gravity shows in the forces of the pins alone."""
    run = compared("gravity 9.8", *problem("motor"))
    assert run.diagnosis is not None
    assert {cause.name for cause in run.diagnosis.named} == {"scale of all joint forces", "gravity"}


def test_an_engine_without_a_mistake_agrees() -> None:
    """So that what is rejected above is so for its mistake."""
    mechanism, options = problem("motor")
    assert (
        compared("release one step late", mechanism, options).outcome is Outcome.AGREES
    )  # it has no stop
