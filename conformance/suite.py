"""The checks of one engine: each problem is run once, when the first of its checks is asked for.

Whatever the engine does there, it does in processes of their own: no problem's verdict depends on
what another one did.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field
from functools import cached_property
from types import TracebackType

from ..comparisons.compare.machine import Case, MachineRuns, RunRecord
from ..comparisons.compare.sentences import diagnosis
from ..comparisons.report.numbers import format_number
from ..comparisons.runs.results import FAILURES, Metric, Outcome, Run
from ..comparisons.runs.study import Study
from ..comparisons.runs.worker import Worker
from ..engines.protocol import Capabilities, Engine
from ..engines.registry import announce, capabilities_of, engine_class, supplied_in
from ..models.errors import InputError, TrebucheckError
from . import interface
from .problems import check_name, given, missing, quantities
from .verdicts import State, Verdict

INTERFACE = "interface"
"""In the place of a problem's name: checks of the engine's description and of how it answers."""
_DIAGNOSED = 2  # broken problems of an engine whose cause is looked for: a diagnosis may take ten times as long as a run


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
        presets = tuple(interface.presets_of(name, engine_class(name)))
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
        self._references, self._worker = (
            references or References(),
            Worker(timeout, isolate, fresh=True),
        )
        self._known: dict[str, dict[str, Verdict]] = {}
        self._diagnosed = 0
        self.ids = tuple(
            self._id(problem, check) for problem, checks in self._checks.items() for check in checks
        )
        """Of all checks, in their order."""

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
        """That the engine declares with the options of its preset."""
        return capabilities_of(self.target.engine, self.target.preset)

    @cached_property
    def supplied(self) -> dict[str, str] | None:
        """What trebucheck does in the engine's place, as it says; None if it does not."""
        return supplied_in(self.target.engine, self.target.preset)

    @cached_property
    def version(self) -> str:
        """Of the engine."""
        return str(engine_class(self.target.engine).version())

    @cached_property
    def _checks(self) -> dict[str, tuple[str, ...]]:
        """Names of the checks by problem."""
        checks = {INTERFACE: interface.CHECKS}
        for problem in self.problems:
            metrics = quantities(*given(problem), self.capabilities)
            beyond = missing(*given(problem), self.capabilities)
            checks[problem] = ("runs",) if beyond else ("runs", "model", *map(check_name, metrics))
        return checks

    def _id(self, problem: str, check: str) -> str:
        return f"{self.target.label}/{problem}/{check}"

    def verdict(self, id: str) -> Verdict:
        """On a check; its problem is run now if it is the first one of it."""
        _, problem, check = id.rsplit("/", 2)
        if problem not in self._known:
            self._known[problem] = self._judged(problem)
        return self._known[problem][check]

    def verdicts(self) -> Iterable[Verdict]:
        """On all checks, each when it is asked for."""
        return map(self.verdict, self.ids)

    def _judged(self, problem: str) -> dict[str, Verdict]:
        if not interface.is_installed(engine_class(self.target.engine)):
            text = interface.absence(engine_class(self.target.engine)).removesuffix(".")
            return self._all(problem, State.BROKEN if self.required else State.SKIPPED, text)
        if problem == INTERFACE:
            found = interface.checked(
                self.target.engine, self.target.preset, self.problems, self._worker
            )
            return {
                c: Verdict(id=self._id(problem, c), state=state, text=text)
                for c, (state, text) in found.items()
            }
        lacking = missing(*given(problem), self.capabilities)
        if lacking:
            return self._all(problem, State.SKIPPED, f"it has no {', no '.join(lacking)}")
        return self._run(problem)

    def _all(self, problem: str, state: State, text: str) -> dict[str, Verdict]:
        return {
            c: Verdict(id=self._id(problem, c), state=state, text=text)
            for c in self._checks[problem]
        }

    def _failed(self, problem: str, text: str, check: str = "runs") -> dict[str, Verdict]:
        """One check broken, and the others without a motion to look at."""
        others = self._all(
            problem,
            State.SKIPPED,
            "there is no motion to judge; see the first check of this problem",
        )
        return others | {check: Verdict(id=self._id(problem, check), state=State.BROKEN, text=text)}

    def _run(self, problem: str) -> dict[str, Verdict]:
        study = Study([problem], [self.target.engine], [self.target.preset])
        runs = self._references.of(study, problem)
        runs.diagnoses = self._diagnosed < _DIAGNOSED
        runs.runner.worker = self._worker
        try:
            made = study.engine(self.target.engine, self.target.preset)
            own = study.engine_for(problem, runs.machine.scales.time, made)
        except (TrebucheckError, TypeError, ValueError) as error:
            return self._failed(problem, f"the engine cannot be made: {error}")
        run = self._made(runs, problem, own)
        if run.outcome in FAILURES:
            slow = run.outcome is Outcome.TIMED_OUT
            longer = (
                "; a longer --timeout [s] (of pytest: --trebucheck-timeout) may let it"
                if slow
                else ""
            )
            return self._failed(
                problem, f"{(run.message or '').removesuffix('.') if slow else run.message}{longer}"
            )
        if run.outcome is Outcome.UNSUPPORTED:
            return self._failed(problem, f"it refuses what it declares: {run.message}")
        if run.outcome is Outcome.NOT_EQUIVALENT:
            return self._failed(problem, " ".join([f"{run.message}", *diagnosis(run)]), "model")
        self._diagnosed += bool(run.broken)
        scaled = own.timestep != made.timestep
        return self._of_run(problem, run, f" at steps of {own.timestep:g} s" if scaled else "")

    def _made(self, runs: MachineRuns, problem: str, own: Engine) -> Run:
        found = runs.made(Case(problem, self.target.engine, self.target.preset), own)
        assert not isinstance(found, RunRecord)  # there is no store
        return found.run

    def _of_run(self, problem: str, run: Run, steps: str) -> dict[str, Verdict]:
        """Verdicts; those that speak against the engine say at which steps, where those are not the preset's."""
        verdicts = {
            check: self._of_quantity(problem, check, run) for check in self._checks[problem][2:]
        }
        found = {
            "runs": self._of_rest(problem, run),
            "model": self._of_model(problem, run),
        } | verdicts
        broken = {
            check: v.model_copy(update={"text": v.text + steps})
            for check, v in found.items()
            if v.failed
        }
        return found | broken

    def _of_rest(self, problem: str, run: Run) -> Verdict:
        """That it ran; and whatever is judged of a run and is no check of its own."""
        rest = [m for m in run.metrics if check_name(m.name) not in self._checks[problem]]
        found = _judgement(rest, run)
        kept = found.state is State.SKIPPED
        update = {"id": self._id(problem, "runs"), "wall_time": run.wall_time}
        return found.model_copy(update=update | ({"state": State.KEPT, "text": ""} if kept else {}))

    def _of_model(self, problem: str, run: Run) -> Verdict:
        equality = run.equality
        shown = equality is not None and equality.exposed
        text = (
            "" if shown else "it does not show its built model (`inspect`): only its motion tells"
        )
        return Verdict(
            id=self._id(problem, "model"), state=State.KEPT if shown else State.SKIPPED, text=text
        )

    def _of_quantity(self, problem: str, check: str, run: Run) -> Verdict:
        found = _judgement([m for m in run.metrics if check_name(m.name) == check], run)
        return found.model_copy(update={"id": self._id(problem, check)})


def _judgement(metrics: Iterable[Metric], run: Run) -> Verdict:
    """On the metrics of one quantity, by the worst of them."""
    own = [m for m in metrics if m.follows is None]
    judged = sorted((m for m in own if m.share is not None), key=lambda m: m.share or 0.0)
    if not judged:
        told = [m.note for m in own if m.note]
        unjudged = [m for m in own if m.unjudged]
        text = told[0] if told else "there is no such event in this motion"
        return Verdict(id="", state=State.NOT_JUDGED if unjudged else State.SKIPPED, text=text)
    worst = judged[-1]
    broken = [m for m in judged if m.holds is False]
    unjudged = [m for m in own if m.unjudged]
    state = State.BROKEN if broken else State.NOT_JUDGED if unjudged else State.KEPT
    text = "; ".join(
        [
            *map(_complaint, reversed(broken)),
            *(f"{m.label}: not judged: {m.note}" for m in unjudged),
        ]
    )
    return Verdict(
        id="", state=state, text=text, subject=worst.subject, error=None if worst.value is None else abs(worst.value),
        unit=worst.unit, tolerance=worst.tolerance, source=f"{worst.source}: {worst.reason}",
        cause=" ".join(diagnosis(run)) if broken else "",
    )  # fmt: skip


def _complaint(m: Metric) -> str:
    unit = "" if m.unit == "1" else f" {m.unit}"
    measured = m.note or f"{format_number(m.value)}{unit}"
    return f"{m.label}: {measured}, tolerance {format_number(m.tolerance)}{unit}"
