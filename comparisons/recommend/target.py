"""What is asked of an engine on one machine, and what a trial has of it: the largest errors up to the launch."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ...models.errors import InputError
from ...models.mechanism import Mechanism
from ...reference.certification.certificate import reference_uncertainty, refusal
from ..runs.trials import Trial, Trials
from .results import Asked, Errors

_METRICS = {"position": "position_max", "torque": "stop_torque_max", "release": "release_time"}
_SAMPLES = 2001  # of the reference, in search of the largest torque


@dataclass(frozen=True)
class Case:
    """A machine with its trials and its accuracy target."""

    trials: Trials
    asked: Asked

    @cached_property
    def largest_torque(self) -> float:
        """The largest torque of any stop up to the launch, by the reference [N m, N]."""
        times = np.linspace(0.0, self.trials.end, _SAMPLES)
        torques = self.trials.solution.motion(times).stop_torques.values()
        return max((float(torque.max()) for torque in torques), default=0.0)

    @cached_property
    def allowed(self) -> dict[str, float]:
        """Largest error allowed, by quantity, in its own unit."""
        asked = self.asked
        torque = asked.torque if asked.torque_share is None else asked.torque_share * self.largest_torque
        found = {"position": asked.position, "torque": torque, "release": asked.release}
        return {name: value for name, value in found.items() if value is not None}

    def refuse_what_cannot_be_judged(self) -> None:
        """Refuse a quantity that the machine does not have, or that its reference is not certain enough to judge.

        Raises:
            InputError: the sentence names the quantity.
        """
        mechanism = self.trials.mechanism
        if not any(stop.closed for stop in mechanism.stops) and {"torque", "release"} & set(self.allowed):
            raise InputError(
                f"{mechanism.name!r} has no stop that is closed at the start: only a position can be asked."
            )
        known = reference_uncertainty(self.trials.solution, self.trials.end)
        for quantity, value in self.allowed.items():
            refused = refusal(_METRICS[quantity], None, value, known.of(_METRICS[quantity]))
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

    def _release_error(self, trial: Trial) -> float:
        mechanism, times = self.trials.mechanism, self.trials.solution.release_times
        due = [name for name, time in times.items() if time is not None and time <= self.trials.end]
        values = [trial.metric(f"release_time ({name})") for name in due if mechanism.stop(name).closed]
        return max((math.inf if value is None else abs(value) for value in values), default=0.0)

    def ratio(self, trial: Trial) -> float:
        """The largest error over what is allowed: up to 1 it is reached."""
        errors = self.errors(trial)
        return max(errors[name] / allowed for name, allowed in self.allowed.items())

    def described(self, trial: Trial) -> Errors:
        """As the report has it."""
        found = {name: value if math.isfinite(value) else None for name, value in self.errors(trial).items()}
        torque, peak = found["torque"], self.largest_torque
        return Errors(**found, torque_share=None if torque is None or peak == 0 else torque / peak)


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
