"""Task of letting go: a trebuchet swings, and the one action that counts is the release."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, ClassVar, cast

import gymnasium
import numpy as np
from gymnasium.error import ResetNeeded
from trebucheck.api.mechanics import Flight, InputError, Mechanism

from .machines import Machine, Machines, checked_mapping, is_number
from .motion import BOUND, Motion, Observation
from .pictures import LARGEST_PICTURE, Instant, Picture, Stage, Window, may_have_display

HOLD, RELEASE = 0, 1
"""The two actions."""

Result = tuple[Observation, float, bool, bool, dict[str, Any]]
_OPTIONS = ("parameters", "spread")


class ThrowEnv(gymnasium.Env[Observation, np.int64]):
    """Release the projectile so that it flies far: `trebucheck/Throw-v0`.

    Each episode has another machine, drawn around a named one: all its lengths and masses (with
    which its best release moves by some tenths of a second). It starts at rest on its stops and
    moves as the reference has it: before the release no action changes the motion, and MuJoCo's
    limits give back some of an impact's speed, however short its steps are, which would shift
    rewards by a hundredth behind an impact. MuJoCo draws.

    **Actions**: :data:`HOLD` (0) moves on by a control step; :data:`RELEASE` (1) lets go at once
    and ends the episode. With `flight`, it goes on to the landing, whatever the actions, for those
    who want to see it.

    **Observation**: what :attr:`observation_names` lists. Cosine and sine of each angle (from +x,
    clockwise), slides, the speeds of all of these, and the projectile's velocity, x and y. With T =
    sqrt(L / g), L the sum of the links' lengths, slides are in units of L, speeds in 1 / T, L / T;
    they are cut at 100. In flight it is that of the release.

    **Reward**: the range over the longest one of this machine's first sweep, both by the reference;
    it is 0 while holding, in flight, and where the projectile never comes up to the landing's
    height. The flight is a parabola, the landing as high as the fulcrum at the start, and the range
    is measured from there (as :func:`trebucheck.throw` has it).

    **End**: terminated at the release (with `flight`, at the landing), truncated when the first
    sweep is over: what follows is chaotic.

    `info` has `time` [s] since the start of the episode; after a reset `best_range` [m],
    `best_time` [s] and the machine's `parameters`; with a landing `range` [m] and `flight_time`
    [s].

    **Pictures**: "rgb_array" draws off screen; "human" opens MuJoCo's viewer, in real time, and a
    new one for each new machine (an environment's own `metadata` leaves it out where there is no
    display). After the release the machine is moved on by plain steps of MuJoCo, for the picture
    only.

    Args:
        model: name of a machine, or a mechanism with a marker "projectile" (which needs
        `spread=0`).
        parameters: of the named machine; their defaults where left out.
        spread: lengths and masses are drawn evenly between 1 - spread and 1 + spread of their
        values.
        control_step: time between two actions [s].
        substeps: of MuJoCo in a control step after the release, at least; no step is longer than 1
        ms.
        flight: whether the episode goes on until the projectile lands.
        render_mode: "rgb_array", "human" or none.
        width, height: of the picture [pixels].

    Raises:
        InputError: one of them is not valid, or the machine throws nothing.
        SimulationError: the reference cannot move the machine.
        EngineNotInstalledError: MuJoCo is not installed, for pictures.
        UnsupportedProblemError: the machine cannot be written as MJCF, for pictures.
    """

    metadata: ClassVar[dict[str, Any]] = {  # type: ignore[misc]
        "render_modes": ["human", "rgb_array"],
        "render_fps": 100,
    }

    def __init__(
        self,
        model: str | Mechanism = "rolling",
        *,
        parameters: Mapping[str, float] | None = None,
        spread: float = 0.1,
        control_step: float = 0.01,
        substeps: int = 10,
        flight: bool = False,
        render_mode: str | None = None,
        width: int = 640,
        height: int = 480,
    ) -> None:
        self._machines = Machines(model, checked_mapping("parameters", parameters), spread)
        self.control_step, self.substeps = _checked_steps(control_step, substeps)
        self.render_mode, self._size = _checked_picture(render_mode, width, height)
        modes = [
            mode for mode in self.metadata["render_modes"] if mode != "human" or may_have_display()
        ]
        self.metadata = {  # type: ignore[misc]
            "render_modes": modes,
            "render_fps": 1 / self.control_step,
        }
        self.flight = bool(flight)
        self._machine: Machine | None = None
        self._shown: Picture | Window | None = None
        self._steps, self._flight, self._aloft, self._over = (
            0,
            cast("Flight | None", None),
            0.0,
            True,
        )
        self._take(self._machines.nominal())
        bounds = np.array(
            [1.0 if name.startswith(("cos", "sin")) else BOUND for name in self.observation_names]
        )
        self.observation_space = gymnasium.spaces.Box(
            -bounds.astype(np.float32), bounds.astype(np.float32)
        )
        self.action_space = gymnasium.spaces.Discrete(2)

    @property
    def machine(self) -> Machine:
        """Machine of this episode."""
        assert self._machine is not None
        return self._machine

    @property
    def observation_names(self) -> tuple[str, ...]:
        """Names of the observation's components."""
        mechanism = self.machine.mechanism
        angles, slides = mechanism.angles, mechanism.coordinates[len(mechanism.angles) :]
        turned = [f"{function} {name}" for function in ("cos", "sin") for name in angles]
        rates = [f"d/dt {name}" for name in mechanism.coordinates]
        return (*turned, *slides, *rates, "velocity x", "velocity y")

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Observation, dict[str, Any]]:
        """Draw a machine, and set it on its stops.

        Args:
            seed: the same one draws the same machines, bit for bit.
            options: `parameters` and `spread` in place of the environment's own, in this episode.

        Raises:
            InputError: another option, a value that is not valid, or no machine drawn throws
                anything.
        """
        super().reset(seed=seed)
        self._take(self._drawn_from(checked_mapping("options", options)).draw(self.np_random))
        self._steps, self._flight, self._aloft = 0, None, 0.0
        best = self.machine.best
        known = {
            "best_range": best.range,
            "best_time": best.time,
            "parameters": dict(self.machine.parameters),
        }
        observation, *_, info = self._result(0.0, False)
        return observation, {**info, **known}

    def step(self, action: Any) -> Result:
        """Hold for a control step, or release.

        Raises:
            InputError: the action is neither.
            ResetNeeded: the episode is over, or none has begun.
        """
        if self._over:
            raise ResetNeeded("the episode is over, or none has begun: call reset() first.")
        if not self.action_space.contains(action):
            raise InputError(f"action = {action!r} must be {HOLD} (hold) or {RELEASE} (release).")
        if self._flight is not None:
            return self._fly_on()
        if action == RELEASE:
            return self._let_go()
        self._steps += 1
        return self._result(0.0, False)

    @property
    def time(self) -> float:
        """Since the start of the episode [s]."""
        return self._motion.time(self._steps) + self._aloft

    def render(self) -> Any:
        """Draw the present picture, shape (height, width, 3); None but for "rgb_array".

        After the release the camera draws back so far that it shows the machine and the flight up
        to now; after an episode that ended with its release, the whole flight.

        Raises:
            SimulationError: MuJoCo cannot draw here.
        """
        return self._picture().show(self.instant()) if self.render_mode == "rgb_array" else None

    def close(self) -> None:
        """Give the graphics memory back, or close the window."""
        if self._shown is not None:
            self._shown.close()
            self._shown = None

    def __getstate__(self) -> dict[str, Any]:
        """Copy all but the flight and the graphics library's parts, which are made again."""
        return {**self.__dict__, "_shown": None, "_flight": self._flight is not None}

    def __setstate__(self, state: dict[str, Any]) -> None:
        """Restore what :meth:`__getstate__` left."""
        self.__dict__.update(state)
        self._flight = self._motion.thrown(self._steps) if state["_flight"] else None

    def _drawn_from(self, options: dict[str, Any]) -> Machines:
        if unknown := options.keys() - set(_OPTIONS):
            raise InputError(
                f"options has {sorted(map(str, unknown))}; reset() takes {' and '.join(_OPTIONS)}."
            )
        own = self._machines
        parameters = {**own.parameters, **checked_mapping("parameters", options.get("parameters"))}
        return Machines(own.given, parameters, options.get("spread", own.spread))

    def _take(self, machine: Machine) -> None:
        """Play with a machine; the model of the same one is kept for its pictures."""
        if machine.best.sweep_end <= 2 * self.control_step:
            raise InputError(
                f"control_step = {self.control_step!r} s is too long: the first sweep of "
                f"{machine.mechanism.name!r} ends at {machine.best.sweep_end:.4g} s."
            )
        if self._machine is not None and self._machine.mechanism == machine.mechanism:
            return
        self.close()
        self._machine = machine
        self._motion = Motion(machine.best, self.control_step)

    def _observation(self) -> Observation:
        return self._motion.observation(self._steps)

    def _result(self, reward: float, terminated: bool, **more: float) -> Result:
        self._over = terminated or (self._flight is None and self._steps >= self._motion.steps)
        if self.render_mode == "human":
            self._window().show(self.instant())
        return (
            self._observation(),
            reward,
            terminated,
            self._over and not terminated,
            {"time": self.time, **more},
        )

    def _let_go(self) -> Result:
        self._flight = self._motion.thrown(self._steps)
        if self._flight is None:
            return self._result(0.0, True)
        return self._result(0.0, False) if self.flight else self._landed()

    def _fly_on(self) -> Result:
        assert self._flight is not None
        self._aloft = min(self._aloft + self.control_step, self._flight.time)
        return self._landed() if self._aloft == self._flight.time else self._result(0.0, False)

    def _landed(self) -> Result:
        assert self._flight is not None
        flown = self._flight
        more = {"range": flown.range, "flight_time": flown.time}
        return self._result(flown.range / self.machine.best.range, True, **more)

    def instant(self) -> Instant:
        """Contents of a picture of the present state."""
        aloft = self._flight.time if self._flight and self._over else self._aloft
        return Instant(self._motion.state(self._steps), self._flight, aloft)

    def stage(self) -> Stage:
        """A scene of MuJoCo's with this episode's machine."""
        best = self.machine.best
        return Stage(
            self.machine.mechanism, best.motion, self.control_step / self.substeps, best.range
        )

    def _picture(self) -> Picture:
        if not isinstance(self._shown, Picture):
            self._shown = Picture(self.stage(), self._size)
        return self._shown

    def _window(self) -> Window:
        if not isinstance(self._shown, Window):
            self._shown = Window(self.stage(), self.control_step)
        return self._shown


def _checked_steps(control_step: float, substeps: int) -> tuple[float, int]:
    if not (is_number(control_step) and control_step > 0):
        raise InputError(f"control_step = {control_step!r} s must be positive and finite.")
    if not (is_number(substeps) and int(substeps) == substeps >= 1):
        raise InputError(f"substeps = {substeps!r} must be a whole number, at least 1.")
    return float(control_step), int(substeps)


def _checked_picture(
    mode: str | None, width: int, height: int
) -> tuple[str | None, tuple[int, int]]:
    if mode not in (None, "rgb_array", "human"):
        raise InputError(f"render_mode = {mode!r} must be 'rgb_array', 'human' or None.")
    for name, size, most in zip(("width", "height"), (width, height), LARGEST_PICTURE, strict=True):
        if not (is_number(size) and int(size) == size and 1 <= size <= most):
            raise InputError(
                f"{name} = {size!r} must be a whole number of pixels from 1 to {most}."
            )
    return mode, (int(width), int(height))
