"""The checks of engines: how they describe themselves and answer, and their runs of problems.

Each problem is run once, when the first of its checks is asked for. Whatever an engine does, it
does in processes of their own: no problem's verdict depends on what another one did.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ..comparisons.compare import MachineRuns, RunKey
from ..comparisons.report.document import format_number
from ..comparisons.report.pages.tables import diagnosis
from ..comparisons.runs.balance import keeps_horizontal_momentum
from ..comparisons.runs.metrics import THROWN, UNSEEN
from ..comparisons.runs.process import Worker, simulate
from ..comparisons.runs.quantities import JUDGED
from ..comparisons.runs.results import FAILURES, Metric, Outcome, Run
from ..comparisons.runs.runner import refuse_invalid
from ..comparisons.runs.study import Study
from ..comparisons.runs.study import cluster as join
from ..engines import registry
from ..engines.presets import ASSISTED, FORMER_NAMES, PRESETS, resolved
from ..engines.protocol import Capabilities, Engine
from ..models.errors import InputError, SimulationError, TrebucheckError, UnsupportedProblemError
from ..models.features import missing_elements
from ..models.files import refuse_unwritable, write_text
from ..models.library.registry import benchmarks, library_problem, model, models
from ..models.mechanism import Mechanism
from ..models.problem import Problem, StopLaw
from ..models.trajectory import Trajectory
from .verdicts import CheckState, CheckVerdict, Conformance, Deviations

if TYPE_CHECKING:
    from ..comparisons.runs.cluster import Cluster

QUICK = ("catapult", "double-pendulum", "fixed", "stopped-pendulum")
STANDARD = (
    *QUICK, "pendulum", "rolling", "hinged", "floating-arm", "hanging-chain", "slider-crank",
    "bouncing", "bead", "incline", "welded-rods", "oscillator", "motor", "falling-rod",
    "thrown-plate", "spring-pendulum", "quick-return",
)  # fmt: skip
"""From the simplest on, so that errors are found early; every feature is in one."""
TIERS = ("quick", "standard", "full")
INTERFACE = "interface"
"""Name in place of a problem's, for checks of the engine's description and of how it answers."""
_DIAGNOSED = 2  # broken problems whose cause is looked for: that may take as long as ten runs
_SHORT = 200  # steps of a run that is only made to see whether it is made
_SPAN = 0.1  # [s] of an engine that has no step


# --- Problems, and what an engine needs for them


def problems_of(tier: str) -> tuple[str, ...]:
    """Names of the problems of a tier, in the order in which they are tried.

    Raises:
        InputError: there is no such tier.
    """
    if tier not in TIERS:
        raise InputError(f"tier = {tier!r} is unknown; there are: {', '.join(TIERS)}.")
    if tier == "full":
        names = (*STANDARD, *models(), *(benchmark.name for benchmark in benchmarks()))
        return tuple(dict.fromkeys(names))
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


def missing(problem: str, capabilities: Capabilities) -> tuple[str, ...]:
    """Names of what a problem needs and an engine does not declare."""
    mechanism, law = given(problem)
    can, lacking = capabilities, capabilities.lacking
    names = tuple(missing_elements(mechanism, can.features, lacking, law, can.elements))
    if mechanism.stops and law not in can.stop_laws:
        return (*names, f"{law.value} law of the stops")
    return names


def check_name(metric: str) -> str:
    """Name of the check that judges a metric, such as 'position' for position_max."""
    return metric.removesuffix("_max").replace("_", "-")


def quantities(problem: str, capabilities: Capabilities) -> tuple[str, ...]:
    """Metrics that a run of a problem may have, of those that are judged."""
    mechanism, law = given(problem)
    left_out = {
        "impact_impulse", "impact_speed",  # of files only
        # Of motions beyond their horizon, and of samples far apart; then judged with the run
        "base_error", UNSEEN,
    }  # fmt: skip
    if mechanism.marker(THROWN) is None:
        left_out |= {"launch_time", "launch_speed"}
    if law is not StopLaw.UNILATERAL:
        left_out |= {"impact_time", "stop_penetration"}
    if not keeps_horizontal_momentum(mechanism):
        left_out.add("horizontal_momentum")
    if not capabilities.joint_gaps:
        left_out.add("joint_gap_max")
    names: list[str] = []
    for quantity in JUDGED.values():
        if quantity.name not in left_out and (not quantity.of or quantity.subjects(mechanism)):
            names.append(quantity.name)
    return tuple(names)


# --- The engine


def absence(cls: registry.EngineClass) -> str:
    """A sentence for an engine that is not installed, in its own words where it has any."""
    in_own_words = getattr(cls, "absence", None)
    return str(in_own_words() if in_own_words else f"engine {cls.name!r} is not installed here.")


@dataclass(frozen=True)
class Target:
    """An engine and its preset."""

    engine: str
    preset: str

    @classmethod
    def of(cls, text: str) -> Target:
        """Read NAME, NAME/PRESET, or the same with 'package.module:Class' for the name.

        The preset is 'assisted', or the last one where there is none of that name.

        Raises:
            InputError: there is no such engine or preset, or it cannot be loaded.
        """
        name, _, preset = text.strip().partition("/")
        name = registry.announce(name) if ":" in name else name
        engine_type = registry.engine_class(name)
        try:
            presets = tuple(engine_type.presets())
        except Exception as error:
            raise InputError(
                f"engine {name!r}: presets() failed: {type(error).__name__}: {error}."
            ) from error
        if not presets:
            raise InputError(
                f"engine {name!r}: presets() gives no maker; one of {', '.join(PRESETS)} is "
                "needed at least."
            )
        chosen = resolved(preset or ASSISTED, presets)
        if not preset and chosen not in presets:
            chosen = presets[-1]
        if chosen not in presets:
            raise InputError(f"{name} has no preset {chosen!r}; there are: {', '.join(presets)}.")
        return cls(name, chosen)

    @property
    def label(self) -> str:
        """Engine and preset, as ids begin."""
        return f"{self.engine}/{self.preset}"

    @property
    def engine_type(self) -> registry.EngineClass:
        """The engine's class."""
        return registry.engine_class(self.engine)

    @cached_property
    def capabilities(self) -> Capabilities:
        """Capabilities with the options of its preset."""
        return registry.capabilities_of(self.engine, self.preset)

    def lacks(self, problem: str) -> tuple[str, ...]:
        """Names of what a problem needs and the engine does not declare."""
        return missing(problem, self.capabilities)


# --- Checks of the interface


class _SkippedError(Exception):
    """Reason for which a check is skipped."""


class _Interface:
    """Checks of how an engine describes itself and answers; each yields what is wrong."""

    def __init__(self, target: Target, problems: Sequence[str], worker: Worker) -> None:
        self.target, self.problems, self.worker = target, problems, worker

    def _make(self) -> Engine:
        return registry.engine(self.target.engine, self.target.preset)

    def _fitting(self) -> list[str]:
        """Problems that the engine declares to be able to build."""
        fitting = [problem for problem in self.problems if not self.target.lacks(problem)]
        if not fitting:
            raise _SkippedError("none of the problems is one that it can build")
        return fitting

    def _shortened(self, problem: str, made: Engine) -> Problem:
        mechanism, law = given(problem)
        duration = _SPAN if made.timestep is None else _SHORT * made.timestep
        return Problem(mechanism, duration=duration, stop_law=law)

    def _valid(self, trajectory: Trajectory, problem: Problem) -> Trajectory:
        """The trajectory, unless it is not whole."""
        capabilities = self.target.engine_type.capabilities
        return refuse_invalid(self.target.engine, trajectory, problem.mechanism, capabilities)

    def _run_briefly(self, problem: str, made: Engine) -> None:
        short = self._shortened(problem, made)
        self._valid(self.worker.call(simulate, made, short), short)

    def description(self) -> Iterator[str]:
        cls, name = self.target.engine_type, self.target.engine
        capabilities: Any = cls.capabilities
        if not isinstance(capabilities, Capabilities):
            kind = type(capabilities).__name__
            yield f"capabilities is a {kind}; a trebucheck.Capabilities is needed"
        if cls.name != name:
            yield (
                f"the class is called {cls.name!r} and announced as {name!r}; both must be the same"
            )
        version: Any = cls.version()
        if not isinstance(version, str) or not version:
            yield f"version() gives {version!r}; a text is needed"
        named = set(cls.presets())
        if not named & {*PRESETS, *FORMER_NAMES}:
            yield f"presets() has none of {', '.join(PRESETS)}; one is needed at least"

    def made_again(self) -> Iterator[str]:
        first = self._make()
        again = registry.engine(first.name, first.preset, **first.settings)
        for name in (*first.settings, *again.settings):
            value, changed = first.settings.get(name), again.settings.get(name)
            if changed != value:
                yield (
                    f"made again from its settings, its {name} is {changed!r} instead of {value!r}"
                )
        label = f"{first.name}/{first.preset}"
        if label != self.target.label:
            yield f"the engine made says that it is {label}, not {self.target.label}"

    def short_run(self) -> Iterator[str]:
        self._run_briefly(self._fitting()[0], self._make())
        yield from ()

    def same_again(self) -> Iterator[str]:
        """Compare with a second run after one of another problem: state must not be kept."""
        made, names = self._make(), self._fitting()[:2]
        problems = [self._shortened(problem, made) for problem in (*names, names[0])]
        try:
            runs = self.worker.call(_first_and_last, made, problems)
        except SimulationError:  # perhaps of the problem between them
            runs = self.worker.call(_first_and_last, made, [problems[0], problems[-1]])
        first, second = (_samples(self._valid(run, problems[0])) for run in runs)
        for label, values in first.items():
            other = second[label]
            if values.shape != other.shape:
                yield (
                    f"{names[0]}: {label} has the shape {other.shape} in a second run, "
                    f"{values.shape} in the first"
                )
            elif not np.array_equal(values, other):
                difference = float(np.abs(values - other).max())
                yield (
                    f"{names[0]}: {label} differs by up to {difference:.3g} between two runs of "
                    "the same problem"
                )

    def refuses(self) -> Iterator[str]:
        """Require UnsupportedProblemError for what it does not declare."""
        made, seen = self._make(), set[str]()
        for problem in STANDARD:
            lacking = self.target.lacks(problem)
            if not lacking or seen.issuperset(lacking):
                continue
            seen.update(lacking)
            try:
                self._run_briefly(problem, made)
            except UnsupportedProblemError:
                continue
            except (SimulationError, InputError) as error:
                yield f"{problem}: it fails instead of refusing {lacking[0]}: {error}"
            else:
                element = lacking[0]
                yield f"it moves {problem!r}, which has {element}, and does not declare that it can"
        if not seen:
            raise _SkippedError("it declares everything")


_INTERFACE_CHECKS: dict[str, Callable[[_Interface], Iterator[str]]] = {
    "description": _Interface.description,
    "made-again": _Interface.made_again,
    "short-run": _Interface.short_run,
    "same-again": _Interface.same_again,
    "refuses": _Interface.refuses,
}


def _first_and_last(made: Engine, problems: Sequence[Problem]) -> tuple[Trajectory, Trajectory]:
    """First and last of several runs in one process; the others have checks of their own."""
    first = made.simulate(problems[0])
    for problem in problems[1:-1]:
        with suppress(Exception):
            made.simulate(problem)
    return first, made.simulate(problems[-1])


def _samples(run: Trajectory) -> dict[str, np.ndarray]:
    """Arrays of a motion that a second run must repeat, by what they are."""
    names = ("t", "q", "u", "kinetic_energy", "potential_energy")
    samples: dict[str, np.ndarray] = {name: getattr(run, name) for name in names}
    for name, motion in run.markers.items():
        samples[f"the position of {name!r}"] = motion.position
    for forces in ("joint_reactions", "stop_torques"):
        for name, values in getattr(run, forces).items():
            samples[f"{forces} of {name!r}"] = values
    return samples


# --- The suite of one engine


class Suite:
    """Checks of one engine.

    Args:
        target: engine and preset.
        problems: names, in the order in which they are tried.
        references: reference motions by problem, each solved once: the suites of a session share
            them.
        timeout: longest wait for one run [s].
        required: whether an engine that is not installed fails.
        isolate: make each call of it in a process of its own.
        cluster: that makes the calls; None: processes here.
    """

    def __init__(
        self,
        target: Target,
        problems: Iterable[str],
        references: dict[str, MachineRuns] | None = None,
        timeout: float = 120.0,
        required: bool = False,
        isolate: bool = True,
        cluster: Cluster | None = None,
    ) -> None:
        self.target, self.problems, self.required = target, tuple(problems), required
        self._references = {} if references is None else references
        self._worker = (
            Worker(timeout, isolate, fresh=True)
            if cluster is None
            else cluster.worker(timeout, fresh=True)
        )
        self._verdicts: dict[str, dict[str, CheckVerdict]] = {}
        self._diagnosed = 0

    def __enter__(self) -> Suite:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """End the engine's process."""
        self._worker.close()

    @cached_property
    def _checks(self) -> dict[str, tuple[str, ...]]:
        """Names of the checks by problem."""
        checks = {INTERFACE: tuple(_INTERFACE_CHECKS)}
        for problem in self.problems:
            checks[problem] = ("runs",)
            if not self.target.lacks(problem):
                metrics = quantities(problem, self.target.capabilities)
                checks[problem] = ("runs", "model", *map(check_name, metrics))
        return checks

    @cached_property
    def ids(self) -> tuple[str, ...]:
        """Ids of all checks, in their order."""
        ids: list[str] = []
        for problem, checks in self._checks.items():
            ids += [f"{self.target.label}/{problem}/{check}" for check in checks]
        return tuple(ids)

    def verdict(self, id: str) -> CheckVerdict:
        """Verdict on a check; its problem is run now if this is its first one."""
        _, problem, check = id.rsplit("/", 2)
        if problem not in self._verdicts:
            self._verdicts[problem] = self._judge(problem)
        return self._verdicts[problem][check].model_copy(update={"id": id})

    def verdicts(self) -> Iterable[CheckVerdict]:
        """Verdicts on all checks, each when it is asked for."""
        return map(self.verdict, self.ids)

    # The verdicts below get their ids from :meth:`verdict`.

    def _all(self, problem: str, state: CheckState, text: str) -> dict[str, CheckVerdict]:
        return dict.fromkeys(self._checks[problem], _plain(state, text))

    def _failed(self, problem: str, text: str, check: str = "runs") -> dict[str, CheckVerdict]:
        """One check broken, and the others without a motion to look at."""
        nothing = "there is no motion to judge; see the first check of this problem"
        others = self._all(problem, CheckState.SKIPPED, nothing)
        return others | {check: _plain(CheckState.BROKEN, text)}

    def _judge(self, problem: str) -> dict[str, CheckVerdict]:
        cls = self.target.engine_type
        try:
            is_installed = bool(cls.is_installed())
        except Exception:
            is_installed = False
        if not is_installed:
            state = CheckState.BROKEN if self.required else CheckState.SKIPPED
            return self._all(problem, state, absence(cls).removesuffix("."))
        if problem == INTERFACE:
            return self._judge_interface()
        lacking = self.target.lacks(problem)
        if lacking:
            return self._all(problem, CheckState.SKIPPED, f"it has no {', no '.join(lacking)}")
        return self._run(problem)

    def _judge_interface(self) -> dict[str, CheckVerdict]:
        verdicts: dict[str, CheckVerdict] = {}
        for name, check in _INTERFACE_CHECKS.items():
            interface = _Interface(self.target, self.problems, self._worker)
            try:
                text = next(check(interface), "")
                verdicts[name] = _plain(CheckState.BROKEN if text else CheckState.KEPT, text)
            except _SkippedError as reason:
                verdicts[name] = _plain(CheckState.SKIPPED, str(reason))
            except TrebucheckError as error:
                verdicts[name] = _plain(CheckState.BROKEN, str(error))
            except Exception as error:
                text = f"{type(error).__name__}: {error}"
                verdicts[name] = _plain(CheckState.BROKEN, text)
        return verdicts

    def _run(self, problem: str) -> dict[str, CheckVerdict]:
        target = self.target
        study = Study([problem], [target.engine], [target.preset])
        if problem not in self._references:  # solved in this process
            here = Worker(isolate=False)
            self._references[problem] = MachineRuns(study, study.mechanisms[0], here)
        runs = self._references[problem]
        runs.diagnoses = self._diagnosed < _DIAGNOSED
        runs.runner.worker = self._worker
        try:
            made = study.engine(target.engine, target.preset)
            runner = study.engine_for(problem, runs.machine.scales, made)
        except (TrebucheckError, TypeError, ValueError) as error:
            return self._failed(problem, f"the engine cannot be made: {error}")
        run = runs.run(RunKey(problem, target.engine, target.preset), runner).run
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
        verdicts = self._judge_run(problem, run)
        if runner.timestep != made.timestep:  # then failures say at which steps
            steps = f" at steps of {runner.timestep:g} s"
            for check, verdict in verdicts.items():
                if verdict.failed:
                    verdicts[check] = verdict.model_copy(update={"text": verdict.text + steps})
        return verdicts

    def _judge_run(self, problem: str, run: Run) -> dict[str, CheckVerdict]:
        """Verdicts on a run, its built model, and each quantity."""
        runs, model_check, *checks = self._checks[problem]
        # The run itself is judged by the metrics that have no check of their own.
        metrics: dict[str, list[Metric]] = {check: [] for check in (runs, *checks)}
        for metric in run.metrics:
            check = check_name(metric.name)
            metrics[check if check in metrics else runs].append(metric)
        verdicts = {check: judgement(metrics[check], run) for check in metrics}
        rest: dict[str, object] = {"wall_time": run.wall_time}
        if verdicts[runs].state is CheckState.SKIPPED:  # nothing else was judged: it ran
            rest |= {"state": CheckState.KEPT, "text": ""}
        verdicts[runs] = verdicts[runs].model_copy(update=rest)
        verdicts[model_check] = _plain(CheckState.KEPT)
        if run.equality is None or not run.equality.exposed:
            text = "it does not show its built model (`inspect`): only its motion tells"
            verdicts[model_check] = _plain(CheckState.SKIPPED, text)
        return verdicts


def _plain(state: CheckState, text: str = "") -> CheckVerdict:
    return CheckVerdict(id="", state=state, text=text)


def judgement(metrics: Iterable[Metric], run: Run) -> CheckVerdict:
    """Verdict on the metrics of one quantity, by the worst of them."""
    metrics = [m for m in metrics if m.follows is None]
    unjudged = [m for m in metrics if m.unjudged]
    judged = sorted((m for m in metrics if m.share is not None), key=lambda m: m.share or 0.0)
    if not judged:
        notes = [m.note for m in metrics if m.note]
        # What was compared and has no tolerance is no success, and not merely absent.
        absent = "it has no tolerance" if unjudged else "there is no such event in this motion"
        state = CheckState.NOT_JUDGED if unjudged else CheckState.SKIPPED
        return _plain(state, notes[0] if notes else absent)
    worst, complaints = judged[-1], list[str]()
    for m in reversed(judged):
        if m.holds is False:
            unit = "" if m.unit == "1" else f" {m.unit}"
            error = m.note or f"{format_number(m.value)}{unit}"
            complaints.append(f"{m.label}: {error}, tolerance {format_number(m.tolerance)}{unit}")
    state, cause = CheckState.NOT_JUDGED if unjudged else CheckState.KEPT, ""
    if complaints:
        state, cause = CheckState.BROKEN, " ".join(diagnosis(run))
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
        cause=cause,
    )


# --- A session of several engines


class Session:
    """Suites of one or several engines on the same problems.

    Args:
        suites: one an engine.
        tier: of the problems.
        deviations: known ones.
        path: where the verdicts are written; None: nowhere.
        joined: cluster that is left when the session is closed; None: there is none.
    """

    def __init__(
        self,
        suites: Sequence[Suite],
        tier: str,
        deviations: Deviations,
        path: Path | None = None,
        joined: Cluster | None = None,
    ) -> None:
        self._joined = joined
        self._suites, self._tier = tuple(suites), tier
        self._deviations, self._path = deviations, path
        self._by_id = {id: suite for suite in self._suites for id in suite.ids}
        self._found: dict[str, CheckVerdict] = {}
        self._rows = {row.row_id: row for row in deviations.deviation}
        self.rows = tuple(row.row_id for row in deviations.deviation)
        """Ids of the rows of the file of deviations."""
        self.ids = (*self._by_id, *self.rows)
        """Ids of all checks; the rows come last."""

    @classmethod
    def of(
        cls,
        engines: Sequence[str],
        options: Mapping[str, Any],
        folder: Path,
        required: Sequence[str] = (),
    ) -> Session:
        """Read the texts of a command line.

        Args:
            engines: as :meth:`Target.of` reads them.
            options: 'tier', 'problem' (names, comma-separated; those of the tier where empty),
                'timeout' [s], 'deviations' and 'json' (paths, or None), and 'cluster', if any, as
                :func:`.cluster` takes it.
            folder: in which packages of engines that are not installed, and files, are looked for.
            required: engines that fail if they are not installed.

        Raises:
            InputError: a name, a value or a file is not valid.
        """
        if str(folder) not in sys.path:
            # Behind all that is installed: a file `rich.py` there is not meant for us
            sys.path.append(str(folder))
        if not options["timeout"] > 0:
            raise InputError(f"timeout = {options['timeout']!r} s must be positive.")
        chosen = [name.strip() for text in options["problem"] for name in text.split(",")]
        of_tier = problems_of(options["tier"])  # refuses an unknown one in any case
        names = tuple(dict.fromkeys(chosen or of_tier))
        for name in names:
            given(name)
        targets = dict.fromkeys(map(Target.of, engines))
        known = options["deviations"]
        deviations = Deviations.read(folder / known) if known else Deviations()
        path = folder / options["json"] if options["json"] else None
        if path:
            refuse_unwritable(path.parent, path.name)
        references: dict[str, MachineRuns] = {}
        asked = options.get("cluster")
        joined = None if asked is None else join(asked)
        suites = [
            Suite(
                target,
                names,
                references,
                options["timeout"],
                target.engine in required,
                cluster=joined,
            )
            for target in targets
        ]
        tier = "chosen" if options["problem"] else options["tier"]
        return cls(suites, tier, deviations, path, joined)

    def judged(self, id: str) -> CheckVerdict:
        """The verdict on a check, or on a row of the file of deviations."""
        if id not in self._found:
            if id in self._rows:
                self._found[id] = self._rows[id].row_verdict(
                    self._known_ids(),
                    tuple(self._found.values()),
                    [suite.target.label for suite in self._suites],
                )
            else:
                self._found[id] = self._deviations.applied(self._by_id[id].verdict(id))
        return self._found[id]

    def _known_ids(self) -> Iterator[str]:
        """Ids of the checks of these engines on all problems that there are."""
        yield from self._by_id
        for suite in self._suites:
            yield from Suite(suite.target, problems_of("full")).ids

    def take(self, verdict: CheckVerdict) -> None:
        """Take over what another process has judged."""
        self._found.setdefault(verdict.id, verdict)

    @property
    def results(self) -> Conformance:
        """The verdicts so far."""
        targets = [suite.target for suite in self._suites]
        return Conformance.made_here(
            engines={t.label: str(t.engine_type.version()) for t in targets},
            supplied={t.label: registry.supplied_in(t.engine, t.preset) for t in targets},
            tier=self._tier,
            verdicts=tuple(self._found[id] for id in self.ids if id in self._found),
        )

    def write(self) -> None:
        """Write the verdicts, if a file was named and there are any; may raise InputError."""
        if self._path is not None and self._found:
            write_text(self._path, self.results.to_json())

    def close(self) -> None:
        """End the engines' processes."""
        for suite in self._suites:
            suite.close()
        if self._joined is not None:
            self._joined.close()
