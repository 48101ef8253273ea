"""A motion that violates a tolerance: the suspects whose effect fits its deviation from the reference."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ...engines.protocol import Engine
from ...engines.registry import causes_of, with_options
from ...engines.registry import engine as make
from ...models.arrays import FloatArray
from ...models.errors import TrebucheckError
from ...models.mechanism import Mechanism
from ...models.problem import Problem, StopLaw
from ...models.trajectory import Trajectory
from ...reference.perturbed import WithoutCentrifugal, solve_scheduled
from ...reference.solution import Solution
from ...reference.solver import solve
from ..runs.metrics import against
from ..runs.results import Cause, Diagnosis, Run
from .onset import find_onset
from .ranking import ranked
from .signatures import Channels, Match, match, readings, thinned, weights
from .suspects import Suspect, machine_suspects, more_wrong, with_closed_loops

Simulate = Callable[[Engine, Problem], Trajectory]

_SAMPLES = 300  # of the compared motion: enough to tell suspects apart
_TELLING = 0.05
_CERTAIN = 0.98  # a suspect that accounts for so much ends the search before engines have to run again
_REFINED = 4  # suspects that are tried once more with the size found, for what is not linear
_TOLERANCE = 1e-11  # of the suspects' motions


def diagnose_motion(
    run: Run, trajectory: Trajectory, solution: Solution, end: float, engine: Engine, simulate: Simulate
) -> Diagnosis:
    """The onset of the divergence from the reference, the first violated quantity, and the likeliest causes.

    Args:
        run: as judged, with broken tolerances.
        trajectory: of the run.
        solution: the reference's.
        end: end of the compared motion [s].
        engine: with its options; it is run again with other ones where no suspect explains the deviation.
        simulate: how engines are run.
    """
    case = _Case(trajectory, solution, end)
    onset = find_onset(against(trajectory, solution, end), run.broken)
    causes, likeliest = ranked(_causes(case, engine, simulate))
    return Diagnosis(
        leads=onset.first_violated if onset else run.broken[0].label,
        parts_at=onset.time if onset else None,
        holding=onset.active if onset else (),
        causes=causes,
        likeliest=likeliest,
    )


def _causes(case: _Case, engine: Engine, simulate: Simulate) -> Iterator[Cause]:
    causes = [*_machine_causes(case), *_law_causes(case), *_reading_causes(case)]
    yield from causes
    if max((cause.explained for cause in causes), default=0.0) < _CERTAIN:
        yield from _settings_causes(case, engine, simulate)


@dataclass(frozen=True)
class _Case:
    """A trajectory's deviation, thinned and weighted, and the signatures of other trajectories."""

    whole: Trajectory
    solution: Solution
    end: float

    @cached_property
    def trajectory(self) -> Trajectory:
        # Without the start: an engine that records its states late still starts there.
        n = int(np.searchsorted(self.whole.t, self.end, side="right"))
        return thinned(self.whole, np.unique(np.linspace(1, n - 1, _SAMPLES).astype(int)))

    @cached_property
    def reference(self) -> Trajectory:
        return self.solution.trajectory(self.trajectory.t)

    @cached_property
    def channels(self) -> Channels:
        return Channels.of(self.trajectory, self.reference)

    @cached_property
    def weights(self) -> FloatArray:
        return weights(self.channels.stacked(self.trajectory, self.reference))

    @cached_property
    def deviation(self) -> FloatArray:
        return self.signature(self.trajectory)

    def signature(self, wrong: Trajectory) -> FloatArray:
        """Of a trajectory at the same times."""
        return (self.weights * self.channels.stacked(wrong, self.reference)).ravel()

    @property
    def step(self) -> float:
        return float(np.median(np.diff(self.whole.t)))

    def carried(self, other: Trajectory) -> FloatArray:
        """Signature of a trajectory at other times."""
        difference = self.channels.stacked(other, self.solution.trajectory(other.t))
        t = self.trajectory.t
        return (self.weights * np.stack([np.interp(t, other.t, column) for column in difference.T], axis=1)).ravel()

    def problem(self, mechanism: Mechanism) -> Problem:
        law = StopLaw(self.solution.problem.stop_law)
        return Problem(mechanism, duration=float(self.trajectory.t[-1]), stop_law=law)

    def moved(self, mechanism: Mechanism) -> FloatArray | None:
        """Signature of another mechanism's motion; None if it cannot be computed."""
        try:
            closed = with_closed_loops(mechanism)
            if closed is None:
                return None
            solution = solve(self.problem(closed), _TOLERANCE, _TOLERANCE)
            return self.signature(solution.trajectory(self.trajectory.t))
        except TrebucheckError:
            return None


def _machine_causes(case: _Case) -> Iterator[Cause]:
    tried = [(s, case.moved(s.wrong)) for s in machine_suspects(case.whole.mechanism)]
    matched = [
        (suspect, match(case.deviation, signature, fixed=suspect.scale == 0))
        for suspect, signature in tried
        if signature is not None
    ]
    matched.sort(key=lambda pair: -pair[1].explained)
    for rank, (suspect, fit) in enumerate(matched):
        refined = _refined(case, suspect, fit.factor) if rank < _REFINED else None
        factor, explained = refined or (fit.factor, fit.explained)
        if max(explained, fit.explained) > _TELLING:
            yield suspect.cause(factor, max(explained, fit.explained))


def _refined(case: _Case, suspect: Suspect, factor: float) -> tuple[float, float] | None:
    """Factor and explained share of a suspect as large as it was found to be."""
    larger = more_wrong(case.whole.mechanism, suspect, factor)
    signature = None if larger is None else case.moved(larger.wrong)
    if signature is None:
        return None
    fit = match(case.deviation, signature)
    return factor * fit.factor, fit.explained


def _law_causes(case: _Case) -> Iterator[Cause]:
    """Stops that open at other times than they should, or never; and forces of the wrong law."""
    engine_times, reference_times = case.whole.release_times, case.solution.release_times
    closed = [stop.name for stop in case.whole.mechanism.stops if stop.closed]
    right: dict[str, float | None] = {name: reference_times.get(name) for name in closed}
    for name in closed:
        opened = engine_times.get(name)
        if opened != right[name]:
            amount = f"{_format_time(opened)} instead of {_format_time(right[name])}"
            yield from _release(case, name, amount, {**right, name: opened})
        if opened is not None:
            yield from _scheduled(case, f"{name} never opens", "", {**right, name: None})
    own = {name: engine_times.get(name) for name in closed}
    without = WithoutCentrifugal(case.whole.mechanism)
    yield from _scheduled(case, "velocity-dependent forces dropped", "", own, without)


def _release(case: _Case, stop: str, amount: str, releases: Mapping[str, float | None]) -> Iterator[Cause]:
    """A release at another time: either the motion shows it, or only the reported time is wrong."""
    yield from _scheduled(case, f"release of the {stop}", amount, releases)
    signature = _schedule(case, releases)
    if signature is None:
        return
    would = float(np.linalg.norm(signature))
    explained = 1.0 - float(np.linalg.norm(case.deviation)) / would if would else 0.0
    if explained > _TELLING:
        yield Cause(name=f"reading of the {stop}'s release", kind="reading", amount=amount, explained=explained)


def _format_time(t: float | None) -> str:
    return "never" if t is None else f"{t:.6g} s"


def _scheduled(
    case: _Case,
    name: str,
    amount: str,
    releases: Mapping[str, float | None],
    equations: WithoutCentrifugal | None = None,
) -> Iterator[Cause]:
    signature = _schedule(case, releases, equations)
    fit = Match(0.0, 0.0) if signature is None else match(case.deviation, signature, fixed=True)
    if fit.explained > _TELLING:
        yield Cause(name=name, kind="law", amount=amount, explained=fit.explained)


def _schedule(
    case: _Case, releases: Mapping[str, float | None], equations: WithoutCentrifugal | None = None
) -> FloatArray | None:
    try:
        solution = solve_scheduled(case.problem(case.whole.mechanism), releases, equations)
    except TrebucheckError:
        return None
    return case.signature(solution.trajectory(case.trajectory.t))


def _reading_causes(case: _Case) -> Iterator[Cause]:
    for reading in readings(case.solution, case.reference, case.step):
        fit = match(case.deviation, case.signature(reading.wrong))
        if fit.explained > _TELLING:
            amount = reading.amount(fit.factor)
            yield Cause(name=reading.name, kind="reading", amount=amount, explained=fit.explained)


def _settings_causes(case: _Case, engine: Engine, simulate: Simulate) -> Iterator[Cause]:
    """The causes of the engine's error budget, removed one at a time: each explains the part that then vanishes."""
    size = float(np.linalg.norm(case.deviation))
    problem = Problem(case.whole.mechanism, duration=case.whole.provenance.duration)
    for name, amount, changed in _other_settings(engine, case.whole.mechanism):
        try:
            other = simulate(changed, problem)
        except TrebucheckError:
            continue
        explained = 1.0 - float(np.linalg.norm(case.carried(other))) / size if size else 0.0
        if explained > _TELLING:
            yield Cause(name=name, kind="settings", amount=amount, explained=explained)


def _other_settings(engine: Engine, mechanism: Mechanism) -> Iterator[tuple[str, str, Engine]]:
    """The engine without one of its budget's causes, or with one option as tuned; name, amount, engine."""
    options = engine.settings
    known: set[str] = set()
    for cause in causes_of(engine, mechanism):
        if cause.removal is not None and cause.removal.options:
            known |= cause.removal.options.keys()
            yield cause.name, cause.removal.described(options), with_options(engine, cause.removal.options)
    tuned = make(engine.name, "tuned").settings
    for name, value in options.items():
        if name in tuned and value != tuned[name] and name not in known | {"timestep"}:
            yield f"option {name}", f"{value}; tuned: {tuned[name]}", with_options(engine, {name: tuned[name]})
