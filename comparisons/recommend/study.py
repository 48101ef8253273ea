"""`recommend`: which settings reach a wanted accuracy, for every engine, by measurement."""

from __future__ import annotations

import math
import platform
from collections.abc import Callable, Generator, Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from itertools import islice
from pathlib import Path

from ...engines.registry import engine_class, engine_names
from ...models.errors import InputError, TrebucheckError
from ...models.machines.registry import model as named_model
from ...models.machines.registry import parameters_type
from ...models.mechanism import Mechanism
from ...models.spec import Spec
from ...reference.solver import natural_time
from ..runs.trials import Trial, Trials
from ..runs.worker import Worker
from . import neighbours as family
from .candidates import OptionSet, ladder, option_sets
from .obstacles import explain
from .results import Advice, Attempt, Choice, EngineAdvice, Errors, NeighbourMachine
from .search import HARDEST, Course, Follower, Place, Rung
from .snippets import snippets
from .target import Asked, refuse_what_cannot_be_judged

NEIGHBOURS = 32
_MOST_NEIGHBOURS = 200
_DRAWS = 10  # to a neighbour: some do not launch
_REFERENCE = "reference"

Progress = Callable[[str, int, int], None]
"""Called with what is done now, how many of the sets of options are done, and how many there are."""


@dataclass(frozen=True)
class _Family:
    places: tuple[Place, ...]
    """The machine asked about first."""
    neighbours: tuple[NeighbourMachine, ...]
    varied: str
    words: tuple[str, ...]
    """How the machine is named on the command line."""


def recommend(
    model: str | Mechanism,
    asked: Asked,
    engines: Iterable[str] | None = None,
    *,
    parameters: Spec | None = None,
    neighbours: int = NEIGHBOURS,
    folder: Path | None = None,
    resume: bool = False,
    isolate: bool = True,
    timeout: float = 600.0,
    progress: Progress | None = None,
) -> Advice:
    """For each engine the cheapest measured settings that reach what is asked, or what stands in the way.

    They are measured on the machine and on the worst of its neighbours, machines of the same kind with other
    parameters (:mod:`.neighbours`), so that they hold on another machine, too.

    Args:
        model: name of a machine, or a mechanism of your own (whose masses and gravity are varied).
        asked: largest errors allowed, up to the launch.
        engines: names; all but the reference if left out. Those not installed become rows that say so.
        parameters: of a named machine; its defaults if left out.
        neighbours: how many machines of the same kind are looked at; 0: only the machine itself.
        folder: where trials are kept; None: nowhere.
        resume: take kept trials again.
        isolate: simulate in a process of its own, so that an engine's crash costs only its row.
        timeout: longest wait for one run [s].
        progress: called before each set of options.

    Raises:
        InputError: a name or value is not valid, the machine does not launch, or the reference is not certain enough
            to judge what is asked. A run that fails raises nothing.
    """
    if not 0 <= neighbours <= _MOST_NEIGHBOURS:
        raise InputError(f"neighbours = {neighbours} must be between 0 and {_MOST_NEIGHBOURS}.")
    if not timeout > 0:
        raise InputError(f"timeout = {timeout!r} s must be positive.")
    if isinstance(model, Mechanism) and parameters is not None:
        raise InputError("parameters are for named machines; a mechanism holds its own values.")
    names = _checked(engines)
    with Worker(timeout) as worker:

        def trials(mechanism: Mechanism) -> Trials:
            return Trials(mechanism, folder=folder, resume=resume, isolate=isolate, worker=worker, curves=False)

        found = _family(model, parameters, neighbours, asked, trials)
        sets = {name: option_sets(name) if engine_class(name).is_installed() else () for name in names}
        count = _Count(sum(map(len, sets.values())), progress)
        advice = tuple(_advice(name, sets[name], found, count) for name in names)
    return _whole(found, asked, advice)


def _checked(engines: Iterable[str] | None) -> list[str]:
    names = [name for name in engine_names() if name != _REFERENCE] if engines is None else list(dict.fromkeys(engines))
    for name in names:
        engine_class(name)  # refuses an unknown name
        if name == _REFERENCE:
            raise InputError("engine 'reference' is what the others are measured against; name another one.")
    if not names:
        raise InputError("no engine was named; at least one is needed.")
    return names


def _family(
    model: str | Mechanism,
    parameters: Spec | None,
    count: int,
    asked: Asked,
    trials: Callable[[Mechanism], Trials],
) -> _Family:
    mechanism = named_model(model, parameters) if isinstance(model, str) else model
    own = Place(trials(mechanism), asked)
    refuse_what_cannot_be_judged(asked, own.trials.solution, own.trials.end)
    if isinstance(model, str):
        source = family.of_parameters(model, parameters)
        varied = f"lengths up to {family.LENGTH:g} times, masses up to {family.MASS:g} times (or as many times less), "
        varied += f"start angles within {family.ANGLE:g} rad"
    else:
        source = family.of_mechanism(model)
        varied = f"masses up to {family.MASS:g} times, gravity up to {family.GRAVITY:g} times (or as many times less)"
        varied += "; its geometry was not varied"
    places, rows = [own], list[NeighbourMachine]()
    for place, made_with in islice(_launching(source, asked, trials, _DRAWS * count), count):
        places.append(place)
        rows.append(NeighbourMachine(made_with=made_with, mechanism_hash=place.trials.mechanism.content_hash))
    return _Family(tuple(places), tuple(rows), varied, _words(model, parameters))


def _words(model: str | Mechanism, parameters: Spec | None) -> tuple[str, ...]:
    if isinstance(model, Mechanism):
        return ("--model", f"{model.name}.json")
    defaults = parameters_type(model)()
    base, own = defaults.model_dump(), (parameters or defaults).model_dump()
    changed = (f"{name}={value!r}" for name, value in own.items() if value != base[name])
    return ("--model", model, *(word for text in changed for word in ("--set", text)))


def _launching(
    source: Iterator[family.Neighbour], asked: Asked, trials: Callable[[Mechanism], Trials], draws: int
) -> Iterator[tuple[Place, dict[str, float]]]:
    for mechanism, made_with in islice(source, draws):
        try:
            yield Place(trials(mechanism), asked), made_with
        except TrebucheckError:
            continue  # it does not launch: then it is no trebuchet


@dataclass
class _Count:
    """How far the work is."""

    of: int
    progress: Progress | None
    done: int = 0

    @contextmanager
    def step(self, what: str) -> Generator[None]:
        if self.progress:
            self.progress(what, self.done, self.of)
        yield
        self.done += 1


def _advice(name: str, sets: tuple[OptionSet, ...], found: _Family, count: _Count) -> EngineAdvice:
    version = engine_class(name).version()
    if not sets:
        return EngineAdvice(engine=name, engine_version=version, choice=None, message=f"{name} is not installed here.")
    mechanism = found.places[0].trials.mechanism
    follower = Follower(name, found.places, ladder(natural_time(mechanism)))
    courses: list[Course] = []
    for options in reversed(sets):  # the most accurate first: what the others may cost follows from it
        with count.step(f"{name}: {options.name}"):
            courses.insert(0, follower.follow(options))
    chosen = follower.chosen(courses)
    attempts = tuple(map(_attempt, courses))
    base = EngineAdvice(engine=name, engine_version=version, choice=None, attempts=attempts)
    if chosen is None:
        verdict = explain(follower, courses)
        return base.model_copy(update={"obstacle": verdict.obstacle, "message": verdict.sentence})
    choice = _choice(found.places, *chosen)
    texts = snippets(name, mechanism, choice.preset, chosen[0].options.all_options(choice.step), found.words)
    return base.model_copy(update={"choice": choice, "snippets": texts})


def _attempt(course: Course) -> Attempt:
    reached, best = course.reached, course.best
    return Attempt(
        options=course.options.name,
        words=course.options.words,
        step=reached.step if reached else None,
        wall_time=reached.trials[0].wall_times[0] if reached else None,
        steps_tried=tuple(sorted(course.rungs, reverse=True)),
        worst=best.worst if math.isfinite(best.worst) else None,
        note=course.note,
    )


def _choice(places: tuple[Place, ...], course: Course, rung: Rung, repeated: Trial) -> Choice:
    walls = sorted(repeated.wall_times)
    others = [places[i].described(trial) for i, trial in rung.trials.items() if i != 0]
    options = course.options.all_options(rung.step)
    return Choice(
        options=course.options.name,
        words=course.options.words,
        preset=course.options.preset,
        changes={key: list(value) if isinstance(value, tuple) else value for key, value in options.items()},
        settings=repeated.settings,
        step=rung.step,
        here=places[0].described(rung.trials[0]),
        worst_neighbour=_worst(others) if others else None,
        wall_time=walls[len(walls) // 2],
        wall_times=repeated.wall_times,
    )


def _worst(found: list[Errors]) -> Errors:
    """The largest of each quantity; None if it is missing anywhere."""
    worst: dict[str, float | None] = {}
    for name in Errors.model_fields:
        values: list[float | None] = [getattr(errors, name) for errors in found]
        known = [value for value in values if value is not None]
        worst[name] = max(known) if len(known) == len(values) else None
    return Errors(**worst)


def _whole(found: _Family, asked: Asked, advice: tuple[EngineAdvice, ...]) -> Advice:
    from ...version import __version__

    mechanism, count = found.places[0].trials.mechanism, len(found.neighbours)
    return Advice(
        trebucheck_version=__version__,
        python_version=platform.python_version(),
        platform=f"{platform.system()} {platform.machine()}",
        model=mechanism.name,
        mechanism=mechanism,
        mechanism_hash=mechanism.content_hash,
        asked=asked,
        rule=_rule(found, count),
        neighbours=found.neighbours,
        measured_neighbours=min(HARDEST, count),
        engines=advice,
    )


def _rule(found: _Family, count: int) -> str:
    if not count:
        return "measured on this machine alone: nothing is said of any other"
    return (
        f"measured on this machine and the worst {min(HARDEST, count)} of {count} neighbours drawn at random "
        f"({found.varied}); one in {count + 1} machines so drawn is worse than all of these"
    )
