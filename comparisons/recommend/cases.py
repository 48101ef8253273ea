"""The machines on which settings are measured: the one asked about, and neighbours, on which they are to hold, too.

Of each, what is asked of an engine and what a trial has of it: the largest errors over the compared
time. Neighbours are machines of the same kind, drawn at random, each independently of the others.
Of n machines so drawn and one more, each is as likely as any other to be the worst; so a fresh one
from the same ranges is worse than the worst of n in one case of n + 1, whatever the distribution of
their errors.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ...models.errors import InputError, TrebucheckError
from ...models.machines.registry import model, parameters_type
from ...models.mechanism import Mechanism
from ...models.spec import Spec
from ...reference.certification.certificate import refusal
from ..runs.trials import Trial, Trials
from .results import Asked, Errors

_METRICS = {"position": "position_max", "torque": "stop_torque_max", "release": "release_time"}
_SAMPLES = 2001  # of the reference, in search of the largest torque


@dataclass(frozen=True)
class Case:
    """A machine with its trials and its accuracy target."""

    trials: Trials
    target: Asked

    @cached_property
    def largest_torque(self) -> float:
        """The largest torque of any stop over the compared time, by the reference [N m, N]."""
        times = np.linspace(0.0, self.trials.end, _SAMPLES)
        torques = self.trials.solution.motion(times).stop_torques.values()
        return max((float(torque.max()) for torque in torques), default=0.0)

    @cached_property
    def allowed(self) -> dict[str, float]:
        """Largest error allowed, by quantity, in its own unit."""
        target = self.target
        torque = (
            target.torque
            if target.torque_share is None
            else target.torque_share * self.largest_torque
        )
        limits = {"position": target.position, "torque": torque, "release": target.release}
        return {name: value for name, value in limits.items() if value is not None}

    def refuse_what_cannot_be_judged(self) -> None:
        """Refuse a quantity that the machine does not have, or that its reference is not certain enough to judge.

        Raises:
            InputError: the sentence names the quantity.
        """
        mechanism = self.trials.mechanism
        if not any(stop.closed for stop in mechanism.stops) and {"torque", "release"} & set(
            self.allowed
        ):
            raise InputError(
                f"{mechanism.name!r} has no stop that is closed at the start: only a position can be asked."
            )
        if "release" in self.allowed and not self._due:
            raise InputError(
                f"no stop of {mechanism.name!r} releases within the compared {self.trials.end:.6g} s: no error of a "
                "release can be asked."
            )
        if self.target.torque_share is not None and self.largest_torque == 0:
            raise InputError(
                f"no stop of {mechanism.name!r} pushes: its torque can only be asked in {self.unit('torque')}."
            )
        for quantity, value in self.allowed.items():
            refused = refusal(
                _METRICS[quantity], None, value, self.trials.uncertainty(_METRICS[quantity])
            )
            if refused is not None:
                raise InputError(f"{quantity} = {value:g} {self.unit(quantity)}: {refused}.")

    def unit(self, quantity: str) -> str:
        """Of a quantity, on this machine."""
        return unit_of(quantity, self.trials.mechanism)

    def errors(self, trial: Trial) -> dict[str, float]:
        """By quantity; infinite where the run failed or a release did not come."""
        if trial.deviation is None:
            return dict.fromkeys(_METRICS, math.inf)
        position, torque = trial.position, trial.torque
        return {
            "position": math.inf if position is None else position,
            "torque": math.inf if torque is None else torque,
            "release": self._release_error(trial),
        }

    @property
    def _due(self) -> list[str]:
        """Stops closed at the start that the reference releases within the compared time."""
        mechanism, times = self.trials.mechanism, self.trials.solution.release_times
        due = [name for name, time in times.items() if time is not None and time <= self.trials.end]
        return [name for name in due if mechanism.stop(name).closed]

    def _release_error(self, trial: Trial) -> float:
        values = [trial.metric(f"release_time ({name})") for name in self._due]
        return max((math.inf if value is None else abs(value) for value in values), default=0.0)

    def ratio(self, trial: Trial) -> float:
        """The largest error over what is allowed: up to 1 it is reached."""
        errors = self.errors(trial)
        return max(
            errors[name] / allowed if allowed else math.inf
            for name, allowed in self.allowed.items()
        )

    def described(self, trial: Trial) -> Errors:
        """As the report has it."""
        errors = {
            name: value if math.isfinite(value) else None
            for name, value in self.errors(trial).items()
        }
        if not self._due:
            errors["release"] = None
        torque, peak = errors["torque"], self.largest_torque
        return Errors(**errors, torque_share=None if torque is None or peak == 0 else torque / peak)


def unit_of(quantity: str, mechanism: Mechanism) -> str:
    """Of a quantity that can be asked for."""
    return {"position": "m", "torque": mechanism.force_unit, "release": "s"}[quantity]


def read_torque(text: str) -> dict[str, float]:
    """'1e-3' as N m (or N), '0.1%' as a share of the largest: the field of :class:`Asked` and its value.

    Raises:
        InputError: it is no number.
    """
    number = text.strip()
    share = number.endswith("%")
    try:
        value = float(number.removesuffix("%"))
    except ValueError:
        raise InputError(
            f"--torque {text!r} is not a number of N m, or N (1e-3), nor a share of the largest stop torque (0.1%)."
        ) from None
    return {"torque_share": value / 100} if share else {"torque": value}


LENGTH, MASS, ANGLE, GRAVITY = 1.4, 2.5, 0.3, 1.4
"""Lengths, masses and gravity are varied up to these factors, up and down; start angles by that much [rad]."""

_LENGTHS, _MASSES, _ANGLES = (
    ("l1", "l2", "r", "h"),
    ("m_b", "m_cw", "m_a"),
    ("theta0", "phi0", "alpha0"),
)
_SEED = 1  # the family is the same in every run

Neighbour = tuple[Mechanism, dict[str, float]]
"""A machine, and the parameters (or factors) it was made with."""


def of_parameters(name: str, parameters: Spec | None) -> Iterator[Neighbour]:
    """Endless neighbours of a named machine: lengths, masses and start angles varied; gravity kept."""
    kind = parameters_type(name)
    base = (parameters or kind()).model_dump()
    random = np.random.default_rng(_SEED)
    while True:
        own = {key: base[key] * _factor(random, LENGTH) for key in _LENGTHS if key in base}
        own |= {key: base[key] * _factor(random, MASS) for key in _MASSES if key in base}
        own |= {
            key: base[key] + float(random.uniform(-ANGLE, ANGLE)) for key in _ANGLES if key in base
        }
        yield from _built(lambda own=own: model(name, kind(**(base | own))), own)


def of_mechanism(mechanism: Mechanism) -> Iterator[Neighbour]:
    """Endless neighbours of any mechanism: masses (inertia with them) and gravity; its geometry is its own."""
    random = np.random.default_rng(_SEED)
    while True:
        factors = {f"mass of {body.name}": _factor(random, MASS) for body in mechanism.bodies}
        gravity = _factor(random, GRAVITY)
        yield from _built(
            lambda factors=factors, gravity=gravity: _scaled(
                mechanism, list(factors.values()), gravity
            ),
            factors | {"gravity": gravity},
        )


def _factor(random: np.random.Generator, largest: float) -> float:
    return float(math.exp(random.uniform(-1.0, 1.0) * math.log(largest)))


def _scaled(mechanism: Mechanism, factors: list[float], gravity: float) -> Mechanism:
    bodies = tuple(
        body.model_copy(update={"mass": body.mass * factor, "inertia": body.inertia * factor})
        for body, factor in zip(mechanism.bodies, factors, strict=True)
    )
    return mechanism.model_copy(update={"bodies": bodies, "gravity": mechanism.gravity * gravity})


def _built(make: Callable[[], Mechanism], own: dict[str, float]) -> Iterator[Neighbour]:
    try:
        yield make(), own
    except TrebucheckError:
        return  # outside what a machine can be: the next draw will do
