"""Mistakes that strangers make in adapters, through the whole path: rejected, with the cause; the
table is longer.

`python tests/adapter_mistakes.py` prints all of it.
"""

from __future__ import annotations

from collections.abc import Iterator
from functools import cache

import adapter_mistakes
import numpy as np
import pytest
import trebucheck as tb
from adapter_mistakes import MISTAKES, compared, problem, verdict
from conftest import again
from trebucheck.comparisons.diagnosis.diagnose import diagnose_motion
from trebucheck.comparisons.runs import record as machine
from trebucheck.comparisons.runs.process import Worker
from trebucheck.comparisons.runs.results import Outcome
from trebucheck.comparisons.runs.runner import Runner
from trebucheck.comparisons.runs.study import Until
from trebucheck.comparisons.runs.tolerances import Needs

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


@pytest.mark.parametrize(
    ("name", "mistake", "cause"),
    # The others are read wrongly: `make test` diagnoses them without the whole path, below.
    [SAMPLE[0], *(pytest.param(*row, marks=again) for row in SAMPLE[1:-1]), SAMPLE[-1]],
)
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


READ = tuple(name for name, mistake in MISTAKES.items() if mistake.read)
HIDDEN = {
    "slider-crank": {
        "clock in single precision": "it is below the tolerances",
        "leapfrog: speeds and their energy of half a step before": "what it reads is two mistakes",
        "y of the markers down": "no marker leaves y = 0",
        "torque as impulse": "there is no stop",
        "torque with the wrong sign": "there is no stop",
        "torques of two stops swapped": "there is no stop",
        "release one step late": "there is no stop",
        "release at the next sample": "there is no stop",
        "release 0.1 s late": "there is no stop",
        "never released is 0": "there is no stop",
        "potential energy without springs": "there is no spring",
        "potential energy zero at the start": "it is zero at the start",
    },
    "fixed": {
        "all one step ahead": "its releases are earlier, too: two mistakes",
        "clock in single precision": "it is below the tolerances",
        "markers at the centres of mass": "the marker is on a point mass",
        "velocities of the centres of mass": "the marker is on a point mass",
        "potential energy without springs": "there is no spring",
    },
}
"""Mistakes in reading that have no effect on a machine, or are not told from others, and why."""
OF_STOPS = ("torque", "release", "never", "potential energy zero")


def _read_wrongly() -> Iterator[object]:
    for mistake in READ:
        yield pytest.param("slider-crank", mistake, id=f"slider-crank-{mistake}")
        marks = () if mistake.startswith(OF_STOPS) else (again,)
        yield pytest.param("fixed", mistake, id=f"fixed-{mistake}", marks=marks)


@cache
def _row(name: str) -> tuple[Runner, machine.Machine, tb.Trajectory]:
    """A machine as compared, and the reference at 240 times."""
    mechanism, options = problem(name)
    law = tb.StopLaw(options.get("stop_law", "release-once"))
    runner = Runner(mechanism, None, Until.of(options.get("duration")), law)
    right = runner.solution.trajectory(np.linspace(0.0, runner.end, 240))
    return runner, machine.machine_row(runner, Needs.of(None)), right


@pytest.mark.parametrize(("name", "mistake"), list(_read_wrongly()))
def test_a_motion_that_is_read_wrongly_is_named(name: str, mistake: str) -> None:
    """The reference's own motion, with one mistake in reading it and no other error."""
    runner, row, right = _row(name)
    read = MISTAKES[mistake].read
    assert read is not None
    wrong, engine = read(right), tb.engine("reference")
    record = machine.new_record("reference", "assisted", engine, right.mechanism)
    run = machine.judged(
        record.measured(wrong, runner.measured(wrong)), engine, row, Needs.of(None)
    )
    told = None
    if run.broken:
        diagnosis = diagnose_motion(run.broken, wrong, runner.solution, runner.end)
        told = verdict(MISTAKES[mistake], run.model_copy(update={"diagnosis": diagnosis}))
    if mistake in HIDDEN[name]:
        assert told in (None, "none"), HIDDEN[name][mistake]
    else:
        assert told == "named"
