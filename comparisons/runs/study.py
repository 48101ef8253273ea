"""Studies: what is compared and how it is run, checked once before anything runs.

`Until` is the end of a compared motion as a user states it, `Study` the mechanisms, engines and
presets with the options of their runs.
"""

from __future__ import annotations

import importlib.util
import math
import os
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from threading import Lock
from typing import TYPE_CHECKING, Any, Literal, Self, TypedDict, Unpack

from ...engines import registry
from ...engines.given import GivenModel
from ...engines.presets import DEFAULT, PRESETS, SETTINGS
from ...engines.protocol import Engine
from ...engines.registry import (
    Engines,
    Names,
    engine_class,
    engine_names,
    engine_study,
    engines_of,
    options_for,
    presets_of,
    refuse_unknown_options,
)
from ...models.errors import InputError
from ...models.launch import LAUNCH_ANGLE
from ...models.library.registry import Models, find_benchmark, library_problem, model, several
from ...models.mechanism import Mechanism
from ...models.problem import Problem, StopLaw, mechanism_of
from ...models.spec import Spec
from ...reference.solution import Solution
from ...reference.solver import characteristic_time, solve, solve_to_launch, solve_until
from .metrics import THROWN
from .process import Worker
from .results import REFERENCE
from .scales import Scales
from .store import Store
from .tolerances import DEFAULT as TOLERATED
from .tolerances import Needs, machine_epsilon

if TYPE_CHECKING:
    from .cluster import Cluster

_TAIL = 0.4  # of the compared time: the reference goes on, for events of engines that are late
_MOST_JOBS = 1024  # processes of one machine; a cluster has as many as its workers
_SPANS = (2.0, 5.5, 16.0)  # characteristic times within which a release is looked for


@dataclass(frozen=True)
class Until:
    """The end of a compared motion."""

    kind: Literal["launch", "time", "release"] = "launch"
    time: float = math.nan  # [s], of kind 'time'
    name: str = ""  # marker or stop; '' is the marker that machines throw
    required: bool = True  # False: without that event it is compared for a characteristic time

    @classmethod
    def of(cls, given: str | float | None) -> Self:
        """Reads 'launch', 'launch:tip', 'release:rest', '2.5' or 2.5; None: a launch, if any.

        Raises:
            InputError: it has none of these forms.
        """
        if given is None:
            return cls(required=False)
        if isinstance(given, str):
            kind, separator, name = given.strip().partition(":")
            if kind == "launch" and bool(separator) == bool(name.strip()):
                return cls(name=name.strip())
            if kind == "release" and name.strip():
                return cls("release", name=name.strip())
        try:
            return cls("time", float(given))
        except (ValueError, OverflowError):
            shown = str(given) if len(str(given)) <= 60 else f"{str(given)[:57]}..."
            raise InputError(
                f"until = {shown!r} must be 'launch', 'launch:MARKER', 'release:STOP', or a time "
                "in seconds."
            ) from None

    @property
    def thrown(self) -> str:
        """The marker whose launch is measured."""
        return self.name if self.kind == "launch" and self.name else THROWN

    def solve(self, mechanism: Mechanism, law: StopLaw) -> tuple[Solution, float]:
        """The reference motion, somewhat longer than the compared one, and the end of that [s].

        Raises:
            InputError: the time is not valid, there is no such marker or stop, or the event does
                not come.
            SimulationError: the reference cannot move the mechanism.
        """
        if self.kind == "time":
            end = Problem(mechanism, duration=self.time, stop_law=law).duration
            return solve(Problem(mechanism, duration=end * (1 + _TAIL), stop_law=law)), end
        if mechanism.gravity == 0:
            raise InputError(
                f"{mechanism.name!r} has no gravity, and so no time scale within which an event "
                "could be looked for; name the end of the compared motion in seconds, "
                "e.g. --until 2.5."
            )
        release = self.kind == "release"
        kind, known = "marker", [marker.name for marker in mechanism.markers]
        if release:
            kind, known = "closed stop", [stop.name for stop in mechanism.stops if stop.closed]
        if (self.name or release) and self.name not in known:
            raise InputError(
                f"until = '{self.kind}:{self.name[:60]}': {mechanism.name!r} has no such {kind}: "
                f"{known}."
            )

        def event(solution: Solution) -> float | None:
            if release:
                return solution.release_times[self.name]
            launch = solution.launch_at(LAUNCH_ANGLE, self.thrown)
            return None if launch is None else launch.time

        if not release and self.thrown == THROWN:
            solution = solve_to_launch(mechanism, law)
        else:
            solution = _solved(mechanism, law, event)
        time, duration = event(solution), solution.problem.duration
        if release and not time:
            when = "opens at the start" if time == 0.0 else f"does not open within {duration:.6g} s"
            raise InputError(f"until = 'release:{self.name}': the stop {when}; name another end.")
        if time is None and self.required:
            raise InputError(
                f"{mechanism.name!r} does not launch within {duration:.6g} s, so there is no end "
                "to measure up to; name one, e.g. --until 2.5."
            )
        return solution, time or duration / (1 + _TAIL)


def _solved(
    mechanism: Mechanism, law: StopLaw, event: Callable[[Solution], float | None]
) -> Solution:
    """Solved until the event, and on by the tail."""
    scale = characteristic_time(mechanism)

    def done(solution: Solution) -> bool:
        time = event(solution)
        return time is not None and time * (1 + _TAIL) <= solution.problem.duration

    return solve_until(mechanism, (spans * scale for spans in _SPANS), done, law)


Progress = Callable[[str, int, int], None]
"""Called before each part with what it is, the number of parts done and of all parts."""


class _HowRun(TypedDict, total=False):
    parameters: Spec | None  # of the models given by name; their defaults if left out
    stop_law: StopLaw | str | None
    """'release-once' or 'unilateral'; a problem's own, else 'release-once', if left out."""
    store: Store | None  # where finished runs are kept, and taken from again if asked
    isolate: bool
    """Simulate in a process of its own, so that an engine's crash costs only its run; true if left
    out."""
    timeout: float  # longest wait for one run [s]
    jobs: int | None
    """Processes at once; if left out as many as cores are idle, or 1 where times are shown."""
    cluster: Any
    """Dask cluster on which runs are made, as :func:`cluster` takes it or gives it; None: here."""
    progress: Progress | None
    """Called before each part with what it is, the number of parts done and of all parts."""


class RunOptions(_HowRun, total=False):
    """Options of runs: keywords of every function that makes some."""

    options: Mapping[str, Any] | None
    """Over each preset's: of every engine that has them, or of one, as 'mujoco.solref'."""
    timestep: float | None
    """Step of every engine [s]; each preset's own if left out."""
    duration: float | None
    """End of the compared motion [s]; a problem's own, else the launch, if left out."""
    until: str | float | None
    """The end in other words: 'launch:MARKER', 'release:STOP', or a time [s]."""


class _StudyFields(_HowRun, total=False):
    """Fields of :class:`Study` that :meth:`Study.of` hands over as they are."""

    tolerances: Mapping[str, float | str] | None
    diagnose: bool
    sweep: bool


def _named(given: Mechanism | Problem, name: str) -> Mechanism | Problem:
    """A mechanism, or a problem, whose mechanism has a name."""
    own = mechanism_of(given)
    if own.name == name:
        return given
    renamed = own.model_copy(update={"name": name})
    if isinstance(given, Problem):
        return given.model_copy(update={"mechanism": renamed})
    return renamed


@dataclass(frozen=True)
class Study:
    """Mechanisms, engines and presets, and how they are run.

    Raises:
        InputError: a name or a value is not valid, or a list is empty.
    """

    # Names of machines or of the library's problems, mechanisms, or problems. Others with a name
    # that was there get a number. A problem brings its own end and its own law.
    models: Iterable[str | Mechanism | Problem] = ("fixed", "rolling")
    engines: Iterable[str] | None = None  # names; None: every known engine, installed or not
    presets: Iterable[str] = PRESETS
    parameters: Spec | None = None  # of the named machines; None: their defaults
    # Over the presets': for all engines that have them, or for one ('mujoco.solref')
    options: Mapping[str, Any] = field(default_factory=dict[str, Any])
    stop_law: StopLaw | str | None = None  # None: a problem's own, else release-once
    # End of the compared motion, as for :meth:`Until.of`; None: a problem's, else a launch
    until: str | float | None = None
    tolerances: Mapping[str, float | str] | None = None  # as :meth:`.tolerances.Needs.of` reads
    store: Store | None = None  # where finished runs are kept; None: nowhere
    isolate: bool = True  # in a process of its own: an engine's crash costs only its row
    sweep: bool = False  # run at other time steps, for work and precision; of comparisons only
    diagnose: bool = True  # look for the causes of exceeded tolerances; of comparisons only
    timeout: float = 600.0  # longest wait for one isolated run [s]
    # Processes at once: wall times include what runs cost each other. None: 1, or as many as cores
    # are idle in a study that shows no times but those it measures one at a time.
    jobs: int | None = None
    progress: Progress | None = None
    cluster: Any = None  # as :func:`cluster` takes it; None: processes here

    @classmethod
    def of(
        cls,
        models: Models,
        engines: Engines | None = None,
        presets: Names | None = None,
        *,
        options: Mapping[str, Any] | None = None,
        timestep: float | None = None,
        duration: float | None = None,
        until: str | float | None = None,
        **fields: Unpack[_StudyFields],
    ) -> Self:
        """Study of models and engines, however given: one or several, as names or objects.

        Args:
            presets: if left out, those of engines that are objects, else all.
            options: over the presets' and over those of engines that are objects.
            timestep: of every engine [s], as the option of that name.
            duration: end of the compared motion [s], as `until`.

        Raises:
            InputError: a name or a value is not valid, the end is said twice, or a list is empty.
        """
        given = dict(options or {})
        if timestep is not None and given.setdefault("timestep", timestep) != timestep:
            raise InputError(
                f"timestep = {timestep!r} s and options = {{'timestep': {given['timestep']!r}}} "
                "differ; leave one of them out."
            )
        chosen = engines_of(engines, presets, given, PRESETS)
        return cls(
            several(models),
            chosen.names,
            chosen.presets,
            options=chosen.options,
            until=one_end(duration, until),
            **fields,
        )

    def __post_init__(self) -> None:
        if not self.timeout > 0:
            raise InputError(f"timeout = {self.timeout!r} s must be positive.")
        self._join_cluster()
        if self.jobs is not None and not 1 <= self.jobs <= _MOST_JOBS:
            raise InputError(f"jobs = {self.jobs!r} must be between 1 and {_MOST_JOBS}.")
        if self.at_once > 1 and not self.isolate:
            raise InputError(
                f"jobs = {self.jobs} needs isolated runs; in this process they are made one at "
                "a time."
            )
        for name in ("models", "engines", "presets"):
            unique: list[Any] = []
            for value in getattr(self, name) or ():  # each once; mechanisms cannot be hashed
                if value not in unique:
                    unique.append(value)
            if getattr(self, name) is not None:
                object.__setattr__(self, name, tuple(unique))
        if not self.models:
            raise InputError("no model was named; at least one is needed.")
        for name in self.engines or ():
            engine_class(name)
        for name in self.engines or ():
            self.presets_of(name)
        refuse_unknown_options(self.options, self.every_engine)
        self.needs.refuse_unknown_subjects(self.mechanisms)
        if self.every_engine:  # without one it is a file that is judged
            self.needs.refuse_what_only_files_tell()

    def _join_cluster(self) -> None:
        if self.cluster is None:
            return
        if not self.isolate:
            raise InputError("a cluster and isolate = False exclude each other.")
        joined = cluster(self.cluster)
        joined.is_of_study = joined.is_of_study or joined is not self.cluster
        object.__setattr__(self, "cluster", joined)

    def law_of(self, mechanism: Mechanism) -> StopLaw:
        """Law of a mechanism's stops: as asked for, else its problem's, else release-once.

        The limits of a model file stay where they are.
        """
        given = self._models.get(mechanism.name)
        if self.stop_law is None and isinstance(given, Problem):
            return given.stop_law
        if self.stop_law is None and mechanism.source is not None:
            return StopLaw.UNILATERAL
        try:
            return StopLaw.RELEASE_ONCE if self.stop_law is None else StopLaw(self.stop_law)
        except ValueError:
            valid = ", ".join(law.value for law in StopLaw)
            raise InputError(
                f"stop_law = {self.stop_law!r} is unknown; there are: {valid}."
            ) from None

    def end_of(self, mechanism: Mechanism) -> Until:
        """End of a mechanism's compared motion: as asked for, its problem's, or the launch."""
        given = self._models.get(mechanism.name)
        if self.until is None and isinstance(given, Problem):
            return Until.of(given.duration)
        return Until.of(self.until)

    @cached_property
    def needs(self) -> Needs:
        """The user's tolerances."""
        return Needs.of(self.tolerances)

    @property
    def mechanisms(self) -> tuple[Mechanism, ...]:
        """Mechanisms with each name once."""
        return tuple(map(mechanism_of, self._models.values()))

    @cached_property
    def _models(self) -> Mapping[str, Mechanism | Problem]:
        """The models by the names of their mechanisms, which are numbered where they recur."""
        models: dict[str, Mechanism | Problem] = {}
        for given in self.models:
            entry = given
            if isinstance(entry, str):
                problem = library_problem(entry, self.parameters)
                entry = problem or model(entry, self.parameters)
            own, k = mechanism_of(entry), 1
            name = own.name
            while name in models and mechanism_of(models[name]) != _named(own, name):
                k += 1
                name = f"{own.name} {k}"
            models[name] = _named(entry, name)
        return models

    @property
    def every_engine(self) -> tuple[str, ...]:
        """Names of all engines of the study."""
        return engine_names() if self.engines is None else tuple(self.engines)

    @property
    def compared_engines(self) -> tuple[str, ...]:
        """Names of the engines that are compared: those asked for, else all but the reference."""
        if self.engines is not None:
            return tuple(self.engines)
        return tuple(name for name in engine_names() if name != REFERENCE)

    @property
    def measured_engines(self) -> tuple[str, ...]:
        """Names of the engines whose error is measured: all but the reference.

        Raises:
            InputError: the reference was named, or no engine was.
        """
        if self.engines is not None and not self.engines:
            raise InputError("no engine was named; at least one is needed.")
        if REFERENCE in (self.engines or ()):
            raise InputError(
                f"engine {REFERENCE!r} is what the others are measured against; name another one."
            )
        return self.compared_engines

    def presets_of(self, name: str) -> tuple[str, ...]:
        """Presets of the study that an engine has.

        Raises:
            InputError: it has none of them.
        """
        found = presets_of(name, self.presets)
        if not found:
            known = ", ".join(registry.all_presets(name))
            asked = ", ".join(map(repr, self.presets))
            raise InputError(f"{name} has no preset {asked}; there are: {known}.")
        return found

    def engine(self, name: str, preset: str) -> Engine:
        """An engine with the study's options; InputError: the preset or an option is not valid."""
        return registry.engine(name, preset, **options_for(name, self.options))

    def engine_for(self, model: str, scales: Scales, made: Engine) -> Engine:
        """Engine for a mechanism; for a problem of the library a preset's step is scaled.

        It is meant for a characteristic time of 1 s. The library's problems last from hundredths
        of a second to minutes: one step for all would say little of any. No step is shorter than
        :func:`least_step`. The step of `default` is the engine's own, and is the same for every
        mechanism, as it is for who sets nothing; that of `settings` is no longer than it. A model
        file that is moved as it is has its file's.

        Args:
            scales: of the mechanism's motion.
            made: as :meth:`engine` makes it.
        """
        if isinstance(made, GivenModel):
            return made.of(mechanism_of(self._models[model]))
        in_library = isinstance(self._models.get(model), Problem) and find_benchmark(model)
        options = options_for(made.name, self.options)
        if made.timestep is None or "timestep" in options or not in_library:
            return made
        if made.preset == DEFAULT:
            return made
        step = max(made.timestep * scales.time, least_step(made, scales))
        if made.preset == SETTINGS and DEFAULT in presets_of(made.name):
            step = min(step, registry.engine(made.name, DEFAULT).timestep or step)
        return registry.engine(
            made.name, made.preset, **{**options, "timestep": float(f"{step:.2g}")}
        )

    @property
    def at_once(self) -> int:
        """Processes at once."""
        if self.jobs is not None:
            return self.jobs
        return 1 if self.cluster is None else self.cluster.jobs

    def on_idle_cores(self) -> Study:
        """The study with as many processes as cores are idle, if nothing else is asked for."""
        if self.jobs is not None or not self.isolate or self.cluster is not None:
            return self
        return replace(self, jobs=idle_cores())

    @property
    def times(self) -> dict[str, Any]:
        """Fields of a :class:`.results.ResultFile` that tell what its times are worth.

        They are the most runs at once when those were timed that were made or taken from the store,
        and whether workers of a cluster made them.
        """
        at_once = self.at_once if self.store is None else self.store.most_jobs(self.at_once)
        return {"jobs": at_once, "shared": self.cluster is not None}

    def worker(self) -> Worker:
        """The processes in which engines run; this one, unless they are isolated."""
        if self.cluster is not None:
            return self.cluster.worker(self.timeout)
        return Worker(self.timeout, self.isolate, self.at_once)


def cluster(given: Any) -> Cluster:
    """Join a Dask cluster, on which studies then make their runs (`compare(..., cluster=)`).

    Args:
        given: address of its scheduler (`tcp://HOST:PORT`), path of a scheduler file, or a
            `distributed.Client`.

    Returns:
        The cluster, to be closed where it is joined by address or file (or in a `with` statement).

    Raises:
        InputError: Dask is not installed, no scheduler answers, it has no workers, or a worker has
            other versions of trebucheck or of an engine; the sentence names host and versions.
    """
    if importlib.util.find_spec("distributed") is None:
        raise InputError(
            "a cluster needs Dask, which is not installed here; `pip install trebucheck[cluster]` "
            "brings it."
        )
    from .cluster import Cluster  # which imports Dask

    return Cluster.of(given)


def least_step(made: Engine, scales: Scales) -> float:
    """Shortest step [s] of a motion that the numbers of an engine carry.

    What a step adds to a position is at most speed * step; adding it to a position as large as the
    way makes a rounding error of eps / 2 * way. A steady motion is rounded to the same side in step
    after step. A part of the way that is tolerated by default is

        eps / 2 * way / (speed * step / additions) <= 1e-3

    with the additions that the engine makes in a step. In double precision that says nothing.
    """
    tables = engine_study(made.name)
    eps = machine_epsilon(made.name, made.settings)
    additions = tables.additions(made.settings)
    return additions * 0.5 * eps / TOLERATED * scales.way / scales.speed


def idle_cores() -> int:
    """Number of cores of this process without work in the last minute; at least 1."""
    # os.process_cpu_count, which knows of the process's own limits, is of Python 3.13.
    cores = os.cpu_count() or 1
    if hasattr(os, "sched_getaffinity"):
        cores = len(os.sched_getaffinity(0))
    busy = os.getloadavg()[0] if hasattr(os, "getloadavg") else 0.0
    return max(1, round(cores - busy))


def one_end(duration: float | None, until: str | float | None) -> str | float | None:
    """The end of a compared motion, from either way of saying it; InputError: both are given."""
    if duration is not None and until is not None:
        raise InputError(
            f"duration = {duration!r} s and until = {until!r} both name the end; "
            "leave one of them out."
        )
    return until if duration is None else duration


@dataclass
class Counter:
    """Counts the parts of a study, for its progress."""

    of: int
    progress: Progress | None
    done: int = 0
    _lock: Lock = field(default_factory=Lock, repr=False)

    def show(self, what: str) -> None:
        """Report what is under way."""
        if self.progress:
            self.progress(what, self.done, self.of)

    def start(self, what: str) -> None:
        """Report a part that starts now, and count it; from any thread."""
        with self._lock:
            self.show(what)
            self.done += 1
