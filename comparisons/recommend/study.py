"""`recommend`: which settings reach a wanted accuracy, for every engine, by measurement."""

from __future__ import annotations

import json
import math
import shlex
from collections.abc import Callable, Mapping, Sequence
from contextlib import closing
from dataclasses import dataclass, replace
from functools import partial
from itertools import islice
from typing import Any, Unpack

from ...engines.given import Engines
from ...engines.registry import engine, engine_class, engine_study
from ...engines.study import OptionSet
from ...models.errors import InputError, TrebucheckError
from ...models.library.registry import Model, models, parameters_type
from ...models.mechanism import Mechanism
from ...models.problem import Problem, mechanism_of
from ...models.spec import Spec
from ...reference.solver import characteristic_time
from ..runs.process import in_order
from ..runs.record import EngineRuns, RunRecord
from ..runs.runner import Runner
from ..runs.study import Counter, RunOptions, Study, Until
from .results import Advice, Asked, Attempt, Choice, EngineAdvice, Errors, NeighbourMachine
from .search import (
    ANGLE,
    GRAVITY,
    HARDEST,
    LENGTH,
    MASS,
    RefinementLevel,
    Search,
    Sweep,
    TargetedRuns,
    explain,
    ladder,
    of_mechanism,
    of_parameters,
    option_sets,
    read_torque,
)

NEIGHBOURS = 32
_MOST_NEIGHBOURS = 200
_DRAWS = 10  # to a neighbour: some do not come to the same end


@dataclass(frozen=True)
class _Family:
    cases: tuple[TargetedRuns, ...]
    """The machine asked about first."""
    neighbours: tuple[NeighbourMachine, ...]
    varied: str
    words: tuple[str, ...]
    """How the machine is named on the command line."""


_MakeCase = Callable[[Mechanism, Until, bool], TargetedRuns]
"""End of a mechanism's motion, and whether it is known to be predictable up to there.
"""


def recommend(
    model: Model = "fixed",
    engines: Engines | None = None,
    *,
    position: float | None = None,
    torque: float | str | None = None,
    release: float | None = None,
    neighbours: int = NEIGHBOURS,
    **how: Unpack[RunOptions],
) -> Advice:
    """Find each engine's cheapest measured settings that reach an accuracy, or what bars it.

        >>> import trebucheck as tb
        >>> advice = tb.recommend("rolling", "mujoco", position=1e-3)  # doctest: +SKIP
        >>> print(advice.engine("mujoco").snippets["trebucheck in Python"])  # doctest: +SKIP

    Args:
        model: name of a machine or of a problem of the library, path of a mechanism's .json file, a
            mechanism, or a problem.
        engines: one or several names; all but the reference if left out.
        position: largest distance of any marker from the reference that is allowed [m].
        torque: largest error of any stop's torque [N m, or N on points], or a share of the largest:
            '0.1%'.
        release: largest error of any stop's release [s].
        neighbours: machines of the same kind that the settings must hold on, too; 0: only the
            machine itself.
        how: runs are made; see :class:`..runs.study.RunOptions`. Settings are what is looked for:
            options of engines are not used.

    Raises:
        InputError: nothing is asked, or a name or value is not valid. A run that fails raises
            nothing.
    """
    if position is None and torque is None and release is None:
        raise InputError("nothing is asked; give at least one of position, torque and release.")
    text = torque if isinstance(torque, str | None) else repr(float(torque))
    asked = Asked(position=position, release=release, **(read_torque(text) if text else {}))
    return recommend_study(Study.of(model, engines, **how), asked, neighbours)


def recommend_study(study: Study, asked: Asked, neighbours: int = NEIGHBOURS) -> Advice:
    """Search settings for a study of one model; see :func:`recommend`.

    They are measured on the machine and on the worst of its neighbours, machines of the same kind
    with other parameters (:mod:`.cases`), so that they hold on another machine, too.

    Args:
        study: one machine, by name or a mechanism of your own (whose masses and gravity are
            varied), engines (all known ones but the reference if None; those not installed become
            rows that say so), how they are run, and the end of the compared motion. Its presets and
            options are not used.
        asked: largest errors allowed, up to that end.
        neighbours: how many machines of the same kind are looked at; 0: only the machine itself.

    Raises:
        InputError: a name or value is not valid, the end does not come, or the reference is not
            certain enough to judge the target. A run that fails raises nothing.
    """
    (model,) = study.models
    if not 0 <= neighbours <= _MOST_NEIGHBOURS:
        raise InputError(f"neighbours = {neighbours} must be between 0 and {_MOST_NEIGHBOURS}.")
    if not isinstance(model, str) and study.parameters is not None:
        raise InputError("parameters are for named machines; a mechanism holds its own values.")
    names = study.measured_engines
    with study.worker() as worker:

        def case(mechanism: Mechanism, until: Until, predictable: bool) -> TargetedRuns:
            law = study.law_of(study.mechanisms[0])
            runner = Runner(mechanism, worker, until, law, predictable=predictable)
            return TargetedRuns(EngineRuns(runner, study.store, curves=False), asked)

        family = _family(model, study, neighbours, case)
        sets = {
            name: option_sets(name) if engine_class(name).is_installed() else () for name in names
        }
        count = Counter(sum(map(len, sets.values())), study.progress)
        advice = tuple(_advice(name, sets[name], family, count, study.jobs) for name in names)
    return _whole(family, asked, advice).model_copy(update={"jobs": study.timed_at_once})


def _family(model: str | Mechanism | Problem, study: Study, count: int, case: _MakeCase) -> _Family:
    end = study.end_of(study.mechanisms[0])
    own = case(study.mechanisms[0], end, False)
    own.refuse_what_cannot_be_judged()
    if isinstance(model, str) and model in models():
        source = of_parameters(model, study.parameters)
        varied = (
            f"lengths up to {LENGTH:g} times, masses up to {MASS:g} times (or as many times less), "
        )
        varied += f"start angles within {ANGLE:g} rad"
    else:
        source = of_mechanism(study.mechanisms[0])
        varied = (
            f"masses up to {MASS:g} times, gravity up to {GRAVITY:g} times (or as many times less)"
        )
        varied += "; its geometry was not varied"
    cases, rows = [own], list[NeighbourMachine]()
    # What launches has neighbours that launch: another one is no trebuchet.
    until = replace(end, required=own.trials.runner.launch_time is not None or end.required)
    predictable = own.trials.end == own.trials.runner.end  # then so are its neighbours
    tried = (
        (partial(case, mechanism, until, predictable), made)
        for mechanism, made in islice(source, _DRAWS * count)
    )
    with closing(in_order(_tried, tried, study.jobs, ahead=2 * study.jobs)) as found:
        for neighbour, changes in islice((each for each in found if each is not None), count):
            cases.append(neighbour)
            rows.append(
                NeighbourMachine(
                    made_with=changes, mechanism_hash=neighbour.trials.mechanism.content_hash
                )
            )
    words = _words(model, study.parameters)
    words += () if study.until is None else ("--until", str(study.until))
    return _Family(tuple(cases), tuple(rows), varied, words)


def _tried(
    neighbour: tuple[Callable[[], TargetedRuns], dict[str, float]],
) -> tuple[TargetedRuns, dict[str, float]] | None:
    """None where its motion has not the same end, or cannot be solved."""
    case, changes = neighbour
    try:
        return case(), changes
    except TrebucheckError:
        return None


def _words(model: str | Mechanism | Problem, parameters: Spec | None) -> tuple[str, ...]:
    if not isinstance(model, str):
        return ("--model", f"{mechanism_of(model).name}.json")
    defaults = parameters_type(model)()
    base, own = defaults.model_dump(), (parameters or defaults).model_dump()
    changed = (f"{name}={value!r}" for name, value in own.items() if value != base[name])
    return ("--model", model, *(word for text in changed for word in ("--set", text)))


def _advice(
    name: str, sets: tuple[OptionSet, ...], family: _Family, count: Counter, jobs: int
) -> EngineAdvice:
    version = engine_class(name).version()
    if not sets:
        return EngineAdvice(
            engine=name,
            engine_version=version,
            choice=None,
            message=f"{name} is not installed here.",
        )
    trials = family.cases[0].trials
    search = Search(name, family.cases, ladder(trials.time_scale), jobs)
    sweeps: list[Sweep] = []
    for options in reversed(
        sets
    ):  # the most accurate first: what the others may cost follows from it
        count.start(f"{name}: {options.name}")
        sweeps.insert(0, search.sweep(options))
    chosen = search.chosen(sweeps)
    attempts = tuple(map(_attempt, sweeps))
    base = EngineAdvice(engine=name, engine_version=version, choice=None, attempts=attempts)
    if chosen is None:
        verdict = explain(search, sweeps)
        return base.model_copy(update={"obstacle": verdict.obstacle, "message": verdict.sentence})
    choice = _choice(family.cases, *chosen)
    changes, end = chosen[0].options.all_options(choice.step), trials.runner.end
    duration = _TO_A_LAUNCH * trials.time_scale if trials.runner.launch_time else end
    texts = snippets(name, trials.mechanism, choice.preset, changes, family.words, duration)
    return base.model_copy(update={"choice": choice, "snippets": texts})


def _attempt(sweep: Sweep) -> Attempt:
    reached, best = sweep.reached, sweep.best
    return Attempt(
        options=sweep.options.name,
        words=sweep.options.description,
        step=reached.step if reached else None,
        wall_time=reached.trials[0].wall_times[0] if reached else None,
        steps_tried=tuple(sorted(sweep.levels, reverse=True)),
        worst=best.worst if math.isfinite(best.worst) else None,
        note=sweep.note,
    )


def _choice(
    cases: tuple[TargetedRuns, ...], sweep: Sweep, level: RefinementLevel, repeated: RunRecord
) -> Choice:
    walls = sorted(repeated.wall_times)
    others = [cases[i].described(trial) for i, trial in level.trials.items() if i != 0]
    options = sweep.options.all_options(level.step)
    return Choice(
        options=sweep.options.name,
        words=sweep.options.description,
        preset=sweep.options.preset,
        changes={
            key: list(value) if isinstance(value, tuple) else value
            for key, value in options.items()
        },
        settings=repeated.settings,
        step=level.step,
        here=cases[0].described(level.trials[0]),
        worst_neighbour=_worst(others) if others else None,
        wall_time=walls[len(walls) // 2],
        wall_times=repeated.wall_times,
    )


def _worst(measured: list[Errors]) -> Errors:
    """The largest of each quantity; None if it is missing anywhere."""
    worst: dict[str, float | None] = {}
    for name in Errors.model_fields:
        values: list[float | None] = [getattr(errors, name) for errors in measured]
        known = [value for value in values if value is not None]
        worst[name] = max(known) if len(known) == len(values) else None
    return Errors(**worst)


def _whole(family: _Family, target: Asked, advice: tuple[EngineAdvice, ...]) -> Advice:
    trials, count = family.cases[0].trials, len(family.neighbours)
    mechanism, runner = trials.mechanism, trials.runner
    return Advice.made_here(
        model=mechanism.name,
        mechanism=mechanism,
        mechanism_hash=mechanism.content_hash,
        launch_time=runner.launch_time,
        compared_to=runner.end,
        judged_to=trials.end,
        asked=target,
        rule=_rule(family, count),
        neighbours=family.neighbours,
        measured_neighbours=min(HARDEST, count),
        engines=advice,
    )


def _rule(family: _Family, count: int) -> str:
    if not count:
        return "measured on this machine alone: nothing is said of any other"
    return (
        f"measured on this machine and the worst {min(HARDEST, count)} of {count} neighbours "
        f"drawn at random "
        f"({family.varied}); one in {count + 1} machines so drawn is worse than all of these"
    )


COMMAND, PYTHON = "trebucheck on the command line", "trebucheck in Python"
_TO_A_LAUNCH = 2.0  # characteristic times: most launches come by then


def snippets(
    name: str,
    mechanism: Mechanism,
    preset: str,
    changes: Mapping[str, Any],
    words: Sequence[str] = (),
    duration: float | None = None,
) -> dict[str, str]:
    """Texts to paste, by what they are for; the trebucheck ones last.

    Args:
        name: of the engine.
        mechanism: the machine they are for.
        preset: the settings start from.
        changes: options set over the preset, the time step included.
        words: how the machine is named on the command line; by its name if left out.
        duration: that is simulated [s]; two characteristic times if left out.
    """
    settings = engine(name, preset, **changes)
    if duration is None:
        duration = _TO_A_LAUNCH * characteristic_time(mechanism)
    return {
        **engine_study(name).snippets(settings, mechanism, float(f"{duration:.3g}")),
        COMMAND: _command(name, words or ("--model", mechanism.name), preset, changes),
        PYTHON: _python(name, preset, changes),
    }


def _command(name: str, machine: Sequence[str], preset: str, changes: Mapping[str, Any]) -> str:
    words = ["trebucheck", "run", "--engine", name, *map(shlex.quote, machine), "--preset", preset]
    for key, value in changes.items():
        if key == "timestep":
            words += ["--timestep", repr(value)]
        else:
            text = value if isinstance(value, str) else json.dumps(value, separators=(",", ":"))
            words += ["--option", shlex.quote(f"{key}={text}")]
    return " ".join(words)


def _python(name: str, preset: str, changes: Mapping[str, Any]) -> str:
    options = "".join(f", {key}={value!r}" for key, value in changes.items())
    return f'import trebucheck as tb\n\nengine = tb.engine("{name}", "{preset}"{options})'
