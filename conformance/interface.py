"""How an engine describes itself and answers: what no motion tells."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from itertools import chain
from typing import Any

import numpy as np

from ..comparisons.runs.validity import refuse_invalid
from ..comparisons.runs.worker import Worker, simulate
from ..engines.protocol import Capabilities, Engine
from ..engines.registry import EngineClass, capabilities_of, engine, engine_class
from ..models.errors import InputError, SimulationError, TrebucheckError, UnsupportedProblemError
from ..models.problem import Problem
from ..models.trajectory import Trajectory
from .problems import STANDARD, given, missing
from .verdicts import State

Found = tuple[State, str]
_SHORT = 200  # steps of a run that is only made to see whether it is made
_SPAN = 0.1  # [s] of an engine that has no step


class _BrokenError(TrebucheckError):
    """A check's sentence."""


@dataclass(frozen=True)
class _Subject:
    """What the checks look at."""

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
    """Runs of several problems in one process; what those between come to is said by checks of their own."""
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
    """What is missing of an engine that is not installed, in its own words where it has any."""
    own = getattr(cls, "absence", None)
    return str(own() if own is not None else f"engine {cls.name!r} is not installed here.")


def checked(name: str, preset: str, problems: Sequence[str], worker: Worker) -> dict[str, Found]:
    """Every check of the interface."""
    subject = _Subject(name, preset, problems, worker)
    return {check: _found(_CHECKS[check], subject) for check in CHECKS}


def _found(check: Callable[[_Subject], str], subject: _Subject) -> Found:
    """What a check finds; its text is why it is skipped, if it has one."""
    try:
        skipped = check(subject)
    except TrebucheckError as error:
        return State.BROKEN, str(error)
    except Exception as error:
        return State.BROKEN, f"{type(error).__name__}: {error}"
    return (State.SKIPPED, skipped) if skipped else (State.KEPT, "")


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
            f"made again from its settings, its {changed} is {again.settings.get(changed)!r} instead of "
            f"{first.settings[changed]!r}"
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
    """The second run comes after one of another problem, so that what is kept from run to run shows."""
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
                f"{fit[0]}: {label} has the shape {other.shape} in a second run, {one.shape} in the first"
            )
        if not np.array_equal(one, other):
            apart = float(np.abs(one - other).max())
            raise _BrokenError(
                f"{fit[0]}: {label} differs by up to {apart:.3g} between two runs of the same problem"
            )
    return ""


def _sampled(one: Trajectory, other: Trajectory) -> Iterator[tuple[str, np.ndarray, np.ndarray]]:
    for label in ("t", "q", "u", "kinetic_energy", "potential_energy"):
        yield label, getattr(one, label), getattr(other, label)
    for name, motion in one.markers.items():
        yield f"the position of {name!r}", motion.position, other.marker(name).position
    both = ("joint_reactions", "stop_torques")
    for field, (name, values) in chain.from_iterable(
        ((f, p) for p in getattr(one, f).items()) for f in both
    ):
        yield f"{field} of {name!r}", values, getattr(other, field)[name]


def _refuses_the_rest(s: _Subject) -> str:
    """What it does not declare it must refuse, by UnsupportedProblemError, rather than move something else."""
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
CHECKS = tuple(_CHECKS)
"""In the order in which they are made."""
