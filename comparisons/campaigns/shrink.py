"""The least mechanism that still shows a disagreement: elements, bodies and digits are taken away.

Each trial takes one thing away and runs the engine again; it stays away if the quantity that was
worst still breaks its tolerance. This goes on until nothing more can go: what remains is small
enough to be read, and to be sent to those who write the engine. (Zeller and Hildebrandt,
Simplifying and isolating failure-inducing input, IEEE Trans. Software Engineering 28 (2002) 183,
one element at a time.) The tolerance may not shrink with the machine, and masses and inertias do
not become zero: else the search ends at a machine that hardly moves, or a singular one.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from typing import Any

from ...models.elements import GROUND
from ...models.errors import (
    InputError,
    SimulationError,
    StudyEndedError,
    UnsupportedProblemError,
)
from ...models.mechanism import Mechanism
from ...models.problem import Problem, mechanism_of
from ...models.stacked import numbers, with_numbers
from ..runs.process import Worker
from ..runs.results import Metric, Outcome, Run
from ..runs.study import Progress
from .machines import EngineCase, MovedMachine
from .spec import Runs

_DIGITS = (1, 2, 3)  # significant ones that a number is rounded to, the fewest first
MOST_TRIALS = 2000
_LEAST_TOLERANCE = 0.1  # of that on the whole machine
_DIRECTIONS = ("axis", "normal", "gravity_direction")  # last part of a vector's name
_NEVER_ZERO = ("mass", "inertia")  # last part of a number's name


@dataclass(frozen=True)
class Shrunk:
    """The least machine that still shows a disagreement."""

    given: Mechanism | Problem
    run: Run
    """Run of the engine on it."""
    worst: str
    """Name of the metric that breaks its tolerance."""
    gone: tuple[str, ...]
    """Parts that were taken away and numbers that were rounded, in their order."""
    trials: int
    script: str | None
    """Program of the engine's own interface that makes the run; None: there is none."""

    @property
    def mechanism(self) -> Mechanism:
        """Its mechanism."""
        return mechanism_of(self.given)


def shrink(
    given: Mechanism | Problem,
    runs: Runs,
    case: EngineCase,
    progress: Progress | None = None,
    most: int = MOST_TRIALS,
) -> Shrunk:
    """Take away whatever does not matter to a disagreement.

    Args:
        given: the machine.
        runs: options of the runs.
        case: engine that disagrees.
        progress: called with what is tried, and the number of trials.
        most: trials; what is left when they are used up is given.

    Raises:
        InputError: the engine does not disagree on it; the sentence says what it does.
        SimulationError: the reference failed on it.
    """
    with Worker(runs.timeout) as worker:
        trial = _Trial(runs, case, worker)
        run = trial.run(given)
        worst = max(run.broken, key=lambda metric: metric.share or 0.0, default=None)
        if worst is None:
            why = f" ({run.message.rstrip('.')})" if run.message else ""
            raise InputError(
                f"{case.engine} {case.preset} does not disagree on this machine: its run "
                f"{run.outcome.value}{why}; nothing can be taken away."
            )
        least = _LEAST_TOLERANCE * (worst.tolerance or 0.0)
        search = _Search(trial, given, run, worst.name, least, progress, most)
        before = None
        while before != search.given:
            before = search.given
            search.take_parts_away()
            search.simplify_numbers()
        program = trial.script(search.given)
        return Shrunk(
            search.given, search.run, worst.name, tuple(search.gone), search.trials, program
        )


@dataclass
class _Search:
    """The least machine so far, and what was tried."""

    trial: _Trial
    given: Mechanism | Problem
    run: Run
    worst: str
    least_tolerance: float  # of that quantity, in its unit
    progress: Progress | None
    most: int
    gone: list[str] = field(default_factory=list[str])
    trials: int = 0

    def take_parts_away(self) -> None:
        """Take bodies and elements away until none can go."""
        parts = (_without_bodies, _without_elements)
        while any(self._accept(*part) for parts_of in parts for part in parts_of(self._mechanism)):
            pass

    def simplify_numbers(self) -> None:
        """Put the simplest number that shows the disagreement in the place of each."""
        for name, value in numbers(self._mechanism).items():
            for simple in _simpler(value):
                if simple == 0 and name.rpartition(".")[2] in _NEVER_ZERO:
                    continue
                fields = _with_numbers(self._mechanism, {name: simple})
                if self._accept(f"{name} = {simple:g}", fields):
                    break
        # The two numbers of a direction have to change together: its length is 1
        for name, value in numbers(self._mechanism).items():
            vector, _, place = name.rpartition(".")
            if place != "0" or vector.rpartition(".")[2] not in _DIRECTIONS or abs(value) in (0, 1):
                continue
            for x, y in ((1.0, 0.0), (0.0, 1.0), (-1.0, 0.0), (0.0, -1.0)):
                fields = _with_numbers(self._mechanism, {f"{vector}.0": x, f"{vector}.1": y})
                if self._accept(f"{vector} = ({x:g}, {y:g})", fields):
                    break

    @property
    def _mechanism(self) -> Mechanism:
        return mechanism_of(self.given)

    def _accept(self, text: str, fields: dict[str, Any]) -> bool:
        """Try a machine with other fields; whether it still disagrees, and is taken."""
        smaller = _valid(self.given, fields)
        if smaller is None or self.trials >= self.most:
            return False
        if self.progress is not None:
            self.progress(text, self.trials, self.most)
        self.trials += 1
        run = self.trial.run_if_valid(smaller)
        if run is None or not any(self._is_it(metric) for metric in run.broken):
            return False
        self.given, self.run = smaller, run
        self.gone.append(text)
        return True

    def _is_it(self, metric: Metric) -> bool:
        """Tell whether a broken tolerance is that of before."""
        return metric.name == self.worst and (metric.tolerance or 0.0) >= self.least_tolerance


@dataclass(frozen=True)
class _Trial:
    """Runs one engine on one machine after the other."""

    runs: Runs
    case: EngineCase
    worker: Worker

    def run(self, given: Mechanism | Problem) -> Run:
        """The judged run."""
        machine = MovedMachine(given, self.runs, self.worker)
        return machine.run(self.case, machine.engine(self.case)).run

    def run_if_valid(self, given: Mechanism | Problem) -> Run | None:
        """The run, if it disagrees; None for a machine that cannot be moved or run."""
        try:
            run = self.run(given)
        except StudyEndedError:
            raise
        except (InputError, SimulationError, UnsupportedProblemError):
            return None
        return run if run.outcome is Outcome.DISAGREES else None

    def script(self, given: Mechanism | Problem) -> str | None:
        """Program of the engine's own interface; None where the adapter writes none."""
        machine = MovedMachine(given, self.runs, self.worker)
        engine: Any = machine.engine(self.case)
        if not hasattr(engine, "script"):
            return None
        try:
            return str(engine.script(machine.compared.runner.problem(engine)))
        except (UnsupportedProblemError, InputError):
            return None


# --- What can be taken away


def _valid(given: Mechanism | Problem, fields: dict[str, Any]) -> Mechanism | Problem | None:
    """A machine with other fields; None where they are not valid together."""
    try:
        made = Mechanism(**(dict(mechanism_of(given)) | fields))
        if isinstance(given, Problem):
            return Problem(made, duration=given.duration, stop_law=given.stop_law)
        return Problem(made).mechanism  # whose loops close
    except InputError:
        return None


def _without_bodies(mechanism: Mechanism) -> Iterator[tuple[str, dict[str, Any]]]:
    """Fields without a body that carries none, and without whatever is on it."""
    for body in reversed(mechanism.bodies):
        if mechanism.children(body.name) or len(mechanism.bodies) == 1:
            continue
        joints = [joint for joint in mechanism.joints if body.name in (joint.parent, joint.child)]
        gone = {body.angle}
        gone |= {slide.coordinate for slide in mechanism.slides if slide.joint in joints}
        fields: dict[str, Any] = {
            "bodies": tuple(each for each in mechanism.bodies if each != body),
            "joints": tuple(each for each in mechanism.joints if each not in joints),
        }
        for name in ("stops", "force_elements", "markers"):
            fields[name] = tuple(
                each for each in getattr(mechanism, name) if body.name not in _bodies_of(each)
            )
        fields["couplers"] = tuple(
            each for each in mechanism.couplers if gone.isdisjoint(each.coordinates)
        )
        for name in ("start", "start_speeds"):
            values = zip(mechanism.coordinates, getattr(mechanism, name), strict=False)
            fields[name] = tuple(value for coordinate, value in values if coordinate not in gone)
        yield f"without {body.name}", fields


def _bodies_of(element: Any) -> set[str]:
    """Bodies that an element is on."""
    names = (getattr(element, name, None) for name in ("body", "relative_to", "parent", "child"))
    return {name for name in names if name is not None and name != GROUND}


def _without_elements(mechanism: Mechanism) -> Iterator[tuple[str, dict[str, Any]]]:
    """Fields without one element, loop joint, coupler or marker."""
    for name in ("force_elements", "stops", "couplers", "markers"):
        every = getattr(mechanism, name)
        for element in every:
            yield f"without {element.name}", {name: tuple(e for e in every if e != element)}
    for joint in mechanism.loop_joints:
        rest = tuple(each for each in mechanism.joints if each != joint)
        yield f"without {joint.name}", {"joints": rest}


def _simpler(value: float) -> Iterator[float]:
    """Simpler numbers in the place of one: 0, 1, and itself with fewer digits."""
    tried = {value}
    for simple in (0.0, 1.0, -1.0, *(float(f"{value:.{digits}g}") for digits in _DIGITS)):
        # Not a simpler one than before, or the trials would go on for ever
        if simple not in tried and len(repr(simple)) < len(repr(value)):
            tried.add(simple)
            yield simple


def _with_numbers(mechanism: Mechanism, values: Mapping[str, float]) -> dict[str, Any]:
    """Fields with other values of some numbers."""

    def replaced(path: str, before: float) -> float:
        return values.get(path, before)

    fields: dict[str, Any] = with_numbers(mechanism, replaced).model_dump()
    if not mechanism.start_speeds and not any(fields["start_speeds"]):
        del fields["start_speeds"]
    return fields
