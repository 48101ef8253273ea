"""The checks of one engine: its description, how it answers, and its runs of problems.

Each problem is run once, when the first of its checks is asked for. Whatever the engine does, it
does in processes of their own: no problem's verdict depends on what another one did.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from functools import cached_property
from types import TracebackType
from typing import Any

import numpy as np

from ..comparisons.compare import MachineRuns, RunKey
from ..comparisons.report.numbers import format_number
from ..comparisons.report.pages.compare import diagnosis
from ..comparisons.runs.balance import keeps_horizontal_momentum
from ..comparisons.runs.metrics import THROWN
from ..comparisons.runs.process import Worker, simulate
from ..comparisons.runs.quantities import JUDGED
from ..comparisons.runs.results import FAILURES, Metric, Outcome, Run
from ..comparisons.runs.runner import refuse_invalid
from ..comparisons.runs.study import Study
from ..engines.protocol import Capabilities, Engine
from ..engines.registry import (
    EngineClass,
    announce,
    capabilities_of,
    engine,
    engine_class,
    supplied_in,
)
from ..models.errors import InputError, SimulationError, TrebucheckError, UnsupportedProblemError
from ..models.features import missing_elements
from ..models.library.registry import benchmarks, library_problem, model, models
from ..models.mechanism import Mechanism
from ..models.problem import Problem, StopLaw
from ..models.trajectory import Trajectory
from .verdicts import CheckState, CheckVerdict

QUICK = ("catapult", "double-pendulum", "fixed", "stopped-pendulum")
STANDARD = (
    *QUICK, "pendulum", "rolling", "hinged", "floating-arm", "hanging-chain", "slider-crank",
    "bouncing", "bead", "incline", "welded-rods", "oscillator", "motor", "falling-rod",
    "thrown-plate", "spring-pendulum", "quick-return",
)  # fmt: skip
"""From the simplest on, so that errors are found early; every feature is in one."""
TIERS = ("quick", "standard", "full")


def problems_of(tier: str) -> tuple[str, ...]:
    """Names of the problems of a tier, in the order in which they are tried.

    Raises:
        InputError: there is no such tier.
    """
    if tier not in TIERS:
        raise InputError(f"tier = {tier!r} is unknown; there are: {', '.join(TIERS)}.")
    if tier == "full":
        every = (*models(), *(benchmark.name for benchmark in benchmarks()))
        return (*STANDARD, *(name for name in every if name not in STANDARD))
    return QUICK if tier == "quick" else STANDARD


def given(name: str) -> tuple[Mechanism, StopLaw]:
    """The mechanism of a named machine or problem, and the law of its stops.

    Raises:
        InputError: nothing has that name; the sentence lists the names there are.
    """
    problem = library_problem(name)
    if problem is None:
        return model(name), StopLaw.RELEASE_ONCE
    return problem.mechanism, problem.stop_law


def missing(mechanism: Mechanism, law: StopLaw, capabilities: Capabilities) -> tuple[str, ...]:
    """Names of what a problem needs and an engine does not declare."""
    names = missing_elements(
        mechanism, capabilities.features, capabilities.lacking, law, capabilities.elements
    )
    followed = not mechanism.stops or law in capabilities.stop_laws
    return (*names, *([] if followed else [f"{law.value} law of the stops"]))


def check_name(metric: str) -> str:
    """Name of the check that judges a metric, such as 'position' for position_max."""
    return metric.removesuffix("_max").replace("_", "-")


def quantities(mechanism: Mechanism, law: StopLaw, capabilities: Capabilities) -> tuple[str, ...]:
    """Metrics that a run of a problem may have, of those that are judged."""
    names = (q.name for q in JUDGED.values() if not q.of or q.subjects(mechanism))
    unilateral = law is StopLaw.UNILATERAL
    left_out = {
        "launch_time": mechanism.marker(THROWN) is None,
        "launch_speed": mechanism.marker(THROWN) is None,
        "impact_time": not unilateral,
        "stop_penetration": not unilateral,
        "impact_impulse": True,  # of files only, as the next
        "impact_speed": True,
        "horizontal_momentum": not keeps_horizontal_momentum(mechanism),
        "joint_gap_max": not capabilities.joint_gaps,
        "base_error": True,  # of motions beyond their horizon only; then it is judged with the run
    }
    return tuple(name for name in names if not left_out.get(name, False))


Found = tuple[CheckState, str]
_SHORT = 200  # steps of a run that is only made to see whether it is made
_SPAN = 0.1  # [s] of an engine that has no step


class _BrokenError(TrebucheckError):
    """A check's sentence."""


@dataclass(frozen=True)
class _Subject:
    """An engine with the problems on which its interface is checked."""

    name: str
    preset: str
    problems: Sequence[str]
    worker: Worker

    @property
    def cls(self) -> EngineClass:
        return engine_class(self.name)

    @property
    def fitting(self) -> list[str]:
        """Problems that it declares to be able to build."""
        capabilities = capabilities_of(self.name, self.preset)
        return [p for p in self.problems if not missing(*given(p), capabilities)]

    def made(self) -> Engine:
        return engine(self.name, self.preset)

    def short(self, problem: str, made: Engine) -> Trajectory:
        """A short run of a problem."""
        asked = _shortened(problem, made)
        return self.valid(self.worker.call(simulate, made, asked), asked)

    def valid(self, found: Trajectory, asked: Problem) -> Trajectory:
        """The trajectory, unless it is not whole."""
        return refuse_invalid(self.name, found, asked.mechanism, self.cls.capabilities)


def _shortened(problem: str, made: Engine) -> Problem:
    mechanism, law = given(problem)
    duration = _SPAN if made.timestep is None else _SHORT * made.timestep
    return Problem(mechanism, duration=duration, stop_law=law)


def _first_and_last(made: Engine, problems: Sequence[Problem]) -> tuple[Trajectory, Trajectory]:
    """First and last of several runs in one process; the others have checks of their own."""
    first = made.simulate(problems[0])
    for problem in problems[1:-1]:
        with suppress(Exception):
            made.simulate(problem)
    return first, made.simulate(problems[-1])


def presets_of(name: str, cls: EngineClass) -> Mapping[str, Callable[..., object]]:
    """The makers of an engine's class.

    Raises:
        InputError: it has none.
    """
    try:
        makers = cls.presets()
    except Exception as error:
        raise InputError(
            f"engine {name!r}: presets() failed: {type(error).__name__}: {error}."
        ) from error
    if not makers:
        raise InputError(
            f"engine {name!r}: presets() gives no maker; one called 'tuned' is needed at least."
        )
    return makers


def is_installed(cls: EngineClass) -> bool:
    """Whether its library is here; an engine whose method fails is not."""
    try:
        return bool(cls.is_installed())
    except Exception:
        return False


def absence(cls: EngineClass) -> str:
    """A sentence for an engine that is not installed, in its own words where it has any."""
    own = getattr(cls, "absence", None)
    return str(own() if own is not None else f"engine {cls.name!r} is not installed here.")


def check_interface(
    name: str, preset: str, problems: Sequence[str], worker: Worker
) -> dict[str, Found]:
    """Make every check of how an engine describes itself and answers."""
    subject = _Subject(name, preset, problems, worker)
    return {check: _found(_CHECKS[check], subject) for check in INTERFACE_CHECKS}


def _found(check: Callable[[_Subject], str], subject: _Subject) -> Found:
    """Result of a check; the text that it returns is the reason for which it is skipped."""
    try:
        skipped = check(subject)
    except TrebucheckError as error:
        return CheckState.BROKEN, str(error)
    except Exception as error:
        return CheckState.BROKEN, f"{type(error).__name__}: {error}"
    return (CheckState.SKIPPED, skipped) if skipped else (CheckState.KEPT, "")


def _describes_itself(s: _Subject) -> str:
    capabilities: Any = s.cls.capabilities
    if not isinstance(capabilities, Capabilities):
        raise _BrokenError(
            f"capabilities is a {type(capabilities).__name__}; a trebucheck.Capabilities is needed"
        )
    if s.cls.name != s.name:
        raise _BrokenError(
            f"the class is called {s.cls.name!r} and announced as {s.name!r}; both must be the same"
        )
    version: Any = s.cls.version()
    if not isinstance(version, str) or not version:
        raise _BrokenError(f"version() gives {version!r}; a text is needed")
    lacking = {"tuned", "stock"} - set(s.cls.presets())
    if lacking:
        raise _BrokenError(
            f"presets() lacks {sorted(lacking)[0]!r}; two names may lead to the same maker"
        )
    return ""


def _is_made_again(s: _Subject) -> str:
    first = s.made()
    again = engine(first.name, first.preset, **first.settings)
    if again.settings != first.settings:
        changed = next(k for k in first.settings if again.settings.get(k) != first.settings[k])
        raise _BrokenError(
            f"made again from its settings, its {changed} is {again.settings.get(changed)!r} "
            f"instead of {first.settings[changed]!r}"
        )
    if (first.name, first.preset) != (s.name, s.preset):
        raise _BrokenError(
            f"the engine made says that it is {first.name}/{first.preset}, not {s.name}/{s.preset}"
        )
    return ""


_NONE_FITS = "none of the problems is one that it can build"


def _moves_a_little(s: _Subject) -> str:
    """The trajectory of a short run is a valid one."""
    if not s.fitting:
        return _NONE_FITS
    s.short(s.fitting[0], s.made())
    return ""


def _is_the_same_again(s: _Subject) -> str:
    """Compare with a second run after one of another problem: state must not be kept."""
    fit, made = s.fitting, s.made()
    if not fit:
        return _NONE_FITS
    asked = [_shortened(problem, made) for problem in (*fit[:2], fit[0])]
    try:
        runs = s.worker.call(_first_and_last, made, asked)
    except SimulationError:  # perhaps of the problem between them
        runs = s.worker.call(_first_and_last, made, [asked[0], asked[-1]])
    for label, one, other in _sampled(*(s.valid(run, asked[0]) for run in runs)):
        if one.shape != other.shape:
            raise _BrokenError(
                f"{fit[0]}: {label} has the shape {other.shape} in a second run, {one.shape} in "
                "the first"
            )
        if not np.array_equal(one, other):
            apart = float(np.abs(one - other).max())
            raise _BrokenError(
                f"{fit[0]}: {label} differs by up to {apart:.3g} between two runs of the same "
                "problem"
            )
    return ""


def _sampled(one: Trajectory, other: Trajectory) -> Iterator[tuple[str, np.ndarray, np.ndarray]]:
    for label in ("t", "q", "u", "kinetic_energy", "potential_energy"):
        yield label, getattr(one, label), getattr(other, label)
    for name, motion in one.markers.items():
        yield f"the position of {name!r}", motion.position, other.marker(name).position
    for forces in ("joint_reactions", "stop_torques"):
        for name, values in getattr(one, forces).items():
            yield f"{forces} of {name!r}", values, getattr(other, forces)[name]


def _refuses_the_rest(s: _Subject) -> str:
    """Require UnsupportedProblemError for what it does not declare."""
    capabilities, made, seen = capabilities_of(s.name, s.preset), s.made(), set[str]()
    for problem in STANDARD:
        lacking = missing(*given(problem), capabilities)
        if not lacking or seen.issuperset(lacking):
            continue
        seen.update(lacking)
        try:
            s.short(problem, made)
        except UnsupportedProblemError:
            continue
        except (SimulationError, InputError) as error:
            raise _BrokenError(
                f"{problem}: it fails instead of refusing {lacking[0]}: {error}"
            ) from None
        raise _BrokenError(
            f"it moves {problem!r}, which has {lacking[0]}, and does not declare that it can"
        )
    return "" if seen else "it declares everything"


_CHECKS: dict[str, Callable[[_Subject], str]] = {
    "description": _describes_itself,
    "made-again": _is_made_again,
    "short-run": _moves_a_little,
    "same-again": _is_the_same_again,
    "refuses": _refuses_the_rest,
}
INTERFACE_CHECKS = tuple(_CHECKS)
"""In the order in which they are made."""
INTERFACE = "interface"
"""In the place of a problem's name: checks of the engine's description and of how it answers."""
_DIAGNOSED = 2
"""Broken problems whose cause is looked for: a diagnosis may take as long as ten runs."""


@dataclass(frozen=True)
class Target:
    """An engine and its preset."""

    engine: str
    preset: str

    @classmethod
    def of(cls, text: str) -> Target:
        """From NAME, NAME/PRESET, or the same with 'package.module:Class' for the name.

        The preset is 'tuned', or the first one where there is none of that name.

        Raises:
            InputError: there is no such engine or preset, or it cannot be loaded.
        """
        name, _, preset = text.strip().partition("/")
        name = announce(name) if ":" in name else name
        presets = tuple(presets_of(name, engine_class(name)))
        chosen = preset or ("tuned" if "tuned" in presets else presets[0])
        if chosen not in presets:
            raise InputError(f"{name} has no preset {chosen!r}; there are: {', '.join(presets)}.")
        return cls(name, chosen)

    @property
    def label(self) -> str:
        """Both, as ids begin."""
        return f"{self.engine}/{self.preset}"


@dataclass
class References:
    """Reference motions, each solved once a session."""

    _known: dict[str, MachineRuns] = field(default_factory=dict[str, MachineRuns])

    def of(self, study: Study, problem: str) -> MachineRuns:
        """The reference of a problem, in this process; raises as :class:`MachineRuns`."""
        if problem not in self._known:
            self._known[problem] = MachineRuns(study, study.mechanisms[0], Worker(isolate=False))
        return self._known[problem]


class Suite:
    """Checks of one engine.

    Args:
        target: engine and preset.
        problems: names, in the order in which they are tried.
        references: shared by the suites of a session.
        timeout: longest wait for one run [s].
        required: whether an engine that is not installed fails.
        isolate: make each call of it in a process of its own.
    """

    def __init__(
        self,
        target: Target,
        problems: Iterable[str],
        references: References | None = None,
        timeout: float = 120.0,
        required: bool = False,
        isolate: bool = True,
    ) -> None:
        self.target, self.problems, self.required = target, tuple(problems), required
        self._references = references or References()
        self._worker = Worker(timeout, isolate, fresh=True)
        self._known: dict[str, dict[str, CheckVerdict]] = {}
        self._diagnosed = 0
        self.ids = tuple(
            self._id(name, check) for name, own in self._checks.items() for check in own
        )
        """Ids of all checks, in their order."""

    def __enter__(self) -> Suite:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        at: TracebackType | None,
    ) -> None:
        self.close()

    def close(self) -> None:
        """End the engine's process."""
        self._worker.close()

    @cached_property
    def capabilities(self) -> Capabilities:
        """Capabilities with the options of its preset."""
        return capabilities_of(self.target.engine, self.target.preset)

    @cached_property
    def supplied(self) -> dict[str, str] | None:
        """Parts of a run that trebucheck does, as the engine states; None if it does not."""
        return supplied_in(self.target.engine, self.target.preset)

    @cached_property
    def version(self) -> str:
        """Version of the engine."""
        return str(engine_class(self.target.engine).version())

    @cached_property
    def _checks(self) -> dict[str, tuple[str, ...]]:
        """Names of the checks by problem."""
        checks = {INTERFACE: INTERFACE_CHECKS}
        for problem in self.problems:
            metrics = quantities(*given(problem), self.capabilities)
            beyond = missing(*given(problem), self.capabilities)
            checks[problem] = ("runs",) if beyond else ("runs", "model", *map(check_name, metrics))
        return checks

    def _id(self, problem: str, check: str) -> str:
        return f"{self.target.label}/{problem}/{check}"

    def verdict(self, id: str) -> CheckVerdict:
        """Verdict on a check; its problem is run now if this is its first one."""
        _, problem, check = id.rsplit("/", 2)
        if problem not in self._known:
            self._known[problem] = self._judged(problem)
        return self._known[problem][check]

    def verdicts(self) -> Iterable[CheckVerdict]:
        """Verdicts on all checks, each when it is asked for."""
        return map(self.verdict, self.ids)

    def _judged(self, problem: str) -> dict[str, CheckVerdict]:
        cls = engine_class(self.target.engine)
        if not is_installed(cls):
            state = CheckState.BROKEN if self.required else CheckState.SKIPPED
            return self._all(problem, state, absence(cls).removesuffix("."))
        if problem == INTERFACE:
            target = self.target
            found = check_interface(target.engine, target.preset, self.problems, self._worker)
            return {name: self._verdict(problem, name, *result) for name, result in found.items()}
        lacking = missing(*given(problem), self.capabilities)
        if lacking:
            return self._all(problem, CheckState.SKIPPED, f"it has no {', no '.join(lacking)}")
        return self._run(problem)

    def _verdict(self, problem: str, check: str, state: CheckState, text: str = "") -> CheckVerdict:
        return CheckVerdict(id=self._id(problem, check), state=state, text=text)

    def _all(self, problem: str, state: CheckState, text: str) -> dict[str, CheckVerdict]:
        checks = self._checks[problem]
        return {check: self._verdict(problem, check, state, text) for check in checks}

    def _failed(self, problem: str, text: str, check: str = "runs") -> dict[str, CheckVerdict]:
        """One check broken, and the others without a motion to look at."""
        nothing = "there is no motion to judge; see the first check of this problem"
        others = self._all(problem, CheckState.SKIPPED, nothing)
        return others | {check: self._verdict(problem, check, CheckState.BROKEN, text)}

    def _run(self, problem: str) -> dict[str, CheckVerdict]:
        target = self.target
        study = Study([problem], [target.engine], [target.preset])
        runs = self._references.of(study, problem)
        runs.diagnoses = self._diagnosed < _DIAGNOSED
        runs.runner.worker = self._worker
        try:
            made = study.engine(target.engine, target.preset)
            engine = study.engine_for(problem, runs.machine.scales.time, made)
        except (TrebucheckError, TypeError, ValueError) as error:
            return self._failed(problem, f"the engine cannot be made: {error}")
        run = runs.run(RunKey(problem, target.engine, target.preset), engine).run
        message = f"{run.message}"
        if run.outcome is Outcome.TIMED_OUT:
            longer = "a longer --timeout [s] (of pytest: --trebucheck-timeout) may let it"
            return self._failed(problem, f"{message.removesuffix('.')}; {longer}")
        if run.outcome in FAILURES:
            return self._failed(problem, message)
        if run.outcome is Outcome.UNSUPPORTED:
            return self._failed(problem, f"it refuses what it declares: {message}")
        if run.outcome is Outcome.NOT_EQUIVALENT:
            return self._failed(problem, " ".join([message, *diagnosis(run)]), "model")
        self._diagnosed += bool(run.broken)
        verdicts = self._of_run(problem, run)
        if engine.timestep != made.timestep:  # then failures say at which steps
            steps = f" at steps of {engine.timestep:g} s"
            for check, verdict in verdicts.items():
                if verdict.failed:
                    verdicts[check] = verdict.model_copy(update={"text": verdict.text + steps})
        return verdicts

    def _of_run(self, problem: str, run: Run) -> dict[str, CheckVerdict]:
        """Verdicts on a run, its built model, and each quantity."""
        runs, model, *checks = self._checks[problem]
        verdicts = {runs: self._of_rest(problem, run), model: self._of_model(problem, run)}
        for check in checks:
            verdict = judgement([m for m in run.metrics if check_name(m.name) == check], run)
            verdicts[check] = verdict.model_copy(update={"id": self._id(problem, check)})
        return verdicts

    def _of_rest(self, problem: str, run: Run) -> CheckVerdict:
        """Verdict on the run itself, and on metrics that have no check of their own."""
        rest = [m for m in run.metrics if check_name(m.name) not in self._checks[problem]]
        verdict = judgement(rest, run)
        changes: dict[str, object] = {"id": self._id(problem, "runs"), "wall_time": run.wall_time}
        if verdict.state is CheckState.SKIPPED:  # nothing else was judged: it ran
            changes |= {"state": CheckState.KEPT, "text": ""}
        return verdict.model_copy(update=changes)

    def _of_model(self, problem: str, run: Run) -> CheckVerdict:
        if run.equality is not None and run.equality.exposed:
            return self._verdict(problem, "model", CheckState.KEPT)
        text = "it does not show its built model (`inspect`): only its motion tells"
        return self._verdict(problem, "model", CheckState.SKIPPED, text)


def judgement(metrics: Iterable[Metric], run: Run) -> CheckVerdict:
    """Verdict on the metrics of one quantity, by the worst of them."""
    own = [m for m in metrics if m.follows is None]
    judged = sorted((m for m in own if m.share is not None), key=lambda m: m.share or 0.0)
    if not judged:
        notes = [m.note for m in own if m.note]
        # What was compared and has no tolerance is no success, and not merely absent.
        unjudged = any(m.unjudged for m in own)
        absent = "it has no tolerance" if unjudged else "there is no such event in this motion"
        state = CheckState.NOT_JUDGED if unjudged else CheckState.SKIPPED
        return CheckVerdict(id="", state=state, text=notes[0] if notes else absent)
    worst = judged[-1]
    broken = [m for m in judged if m.holds is False]
    unjudged = [m for m in own if m.unjudged]
    state = CheckState.BROKEN if broken else CheckState.NOT_JUDGED if unjudged else CheckState.KEPT
    complaints = [_complaint(metric) for metric in reversed(broken)]
    complaints += [f"{metric.label}: not judged: {metric.note}" for metric in unjudged]
    return CheckVerdict(
        id="",
        state=state,
        text="; ".join(complaints),
        subject=worst.subject,
        error=None if worst.value is None else abs(worst.value),
        unit=worst.unit,
        tolerance=worst.tolerance,
        source=f"{worst.source}: {worst.reason}",
        cause=" ".join(diagnosis(run)) if broken else "",
    )


def _complaint(m: Metric) -> str:
    unit = "" if m.unit == "1" else f" {m.unit}"
    measured = m.note or f"{format_number(m.value)}{unit}"
    return f"{m.label}: {measured}, tolerance {format_number(m.tolerance)}{unit}"
