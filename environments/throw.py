"""When to let go: a trebuchet swings in MuJoCo, and the one action that counts is the release."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any, ClassVar

import gymnasium
import numpy as np
from gymnasium.error import ResetNeeded
from numpy.typing import NDArray

from ..models.arrays import FloatArray
from ..models.errors import InputError
from ..models.kinematics import Kinematics
from ..models.mechanism import Mechanism
from ..reference.solver import characteristic_time
from ..reference.throw.flight import Release, fly
from .machines import Machine, Machines
from .motion import LARGEST_PICTURE, Camera, Motion

HOLD, RELEASE = 0, 1
"""The two actions."""

Observation = NDArray[np.float32]
_BOUND = 100.0  # of observed speeds and slides, which have no unit; most are of order one to thirty
_PROJECTILE = "projectile"
_OPTIONS = ("parameters", "spread")


class ThrowEnv(gymnasium.Env[Observation, np.int64]):
    """Release the projectile so that it flies far: `trebucheck/Throw-v0`.

    Each episode has another machine, drawn around a named one: all its lengths and masses (with which its best release
    moves by some tenths of a second). It starts at rest on its stops and is moved by plain steps of MuJoCo.

    **Actions**: :data:`HOLD` (0) moves on by a control step; :data:`RELEASE` (1) lets go at once and ends the episode.

    **Observation**: what :attr:`observation_names` lists. Cosine and sine of each angle (from +x, clockwise), slides,
    the speeds of all of these, and the projectile's velocity, x and y. With T = sqrt(L / g), L the sum of the links'
    lengths, slides are in units of L, speeds in 1 / T, L / T; they are cut at 100.

    **Reward**: the range over the longest one of this machine's first sweep, by the certified reference; it is 0 while
    holding and where the projectile never comes up to the landing's height. The flight is a parabola, the landing as
    high as the fulcrum at the start, and the range is measured from there (as :func:`trebucheck.throw` has it).

    **End**: terminated at the release, truncated when the first sweep is over: what follows is chaotic.

    `info` has `time` [s]; after a reset `best_range` [m], `best_time` [s] and the machine's `parameters`; after a
    release that lands `range` [m] and `flight_time` [s].

    Args:
        model: name of a machine, or a mechanism with a marker "projectile" (which needs `spread=0`).
        parameters: of the named machine; their defaults where left out.
        spread: lengths and masses are drawn evenly between 1 - spread and 1 + spread of their values.
        control_step: time between two actions [s].
        substeps: of MuJoCo in a control step.
        render_mode: "rgb_array" or none.
        width, height: of the picture [pixels].

    Raises:
        InputError: one of them is not valid, or the machine throws nothing.
        EngineNotInstalledError: MuJoCo is not installed.
        SimulationError: reference or MuJoCo cannot move the machine.
        UnsupportedProblemError: it cannot be written as MJCF.
    """

    metadata: ClassVar[dict[str, Any]] = {"render_modes": ["rgb_array"], "render_fps": 100}  # type: ignore[misc]

    def __init__(
        self,
        model: str | Mechanism = "rolling",
        *,
        parameters: Mapping[str, float] | None = None,
        spread: float = 0.1,
        control_step: float = 0.01,
        substeps: int = 10,
        render_mode: str | None = None,
        width: int = 640,
        height: int = 480,
    ) -> None:
        self._machines = Machines(model, dict(parameters or {}), spread)
        self.control_step, self.substeps = _checked_steps(control_step, substeps)
        self.render_mode, self._size = _checked_picture(render_mode, width, height)
        self.metadata = {**self.metadata, "render_fps": 1 / self.control_step}  # type: ignore[misc]
        self._machine: Machine | None = None
        self._motion: Motion | None = None
        self._camera: Camera | None = None
        self._take(self._machines.nominal())
        bounds = np.array([1.0 if name.startswith(("cos", "sin")) else _BOUND for name in self.observation_names])
        self._bounds = bounds.astype(np.float32)
        self.observation_space = gymnasium.spaces.Box(-self._bounds, self._bounds)
        self.action_space = gymnasium.spaces.Discrete(2)
        self._steps, self._over = 0, True

    @property
    def machine(self) -> Machine:
        """That of this episode."""
        assert self._machine is not None
        return self._machine

    @property
    def motion(self) -> Motion:
        """Its motion in MuJoCo."""
        assert self._motion is not None
        return self._motion

    @property
    def observation_names(self) -> tuple[str, ...]:
        """What the observation's components are."""
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
            InputError: another option, a value that is not valid, or no machine drawn throws anything.
        """
        super().reset(seed=seed)
        self._take(self._drawn_from(dict(options or {})).draw(self.np_random))
        self.motion.reset()
        self._steps, self._over = 0, False
        best = self.machine.best
        known = {"best_range": best.range, "best_time": best.time, "parameters": dict(self.machine.parameters)}
        return self._observation(), {**self._info(), **known}

    def step(self, action: Any) -> tuple[Observation, float, bool, bool, dict[str, Any]]:
        """Hold for a control step, or release.

        Raises:
            InputError: the action is neither.
            ResetNeeded: the episode is over, or none has begun.
            SimulationError: the simulation diverged.
        """
        if self._over:
            raise ResetNeeded("the episode is over, or none has begun: call reset() first.")
        if not self.action_space.contains(action):
            raise InputError(f"action = {action!r} must be {HOLD} (hold) or {RELEASE} (release).")
        if action == RELEASE:
            return self._let_go()
        self.motion.advance(self.substeps)
        self._steps += 1
        self._over = self.time >= self.machine.best.sweep_end
        return self._observation(), 0.0, False, self._over, self._info()

    @property
    def time(self) -> float:
        """Since the start of the episode [s]."""
        return self._steps * self.control_step

    def render(self) -> Any:
        """The machine as it stands, shape (height, width, 3); None without a render mode.

        Raises:
            SimulationError: MuJoCo cannot draw here.
        """
        if self.render_mode is None:
            return None
        if self._camera is None:
            self._camera = self.motion.camera(self.machine.best.motion, *self._size)
        return self.motion.show(self._camera)

    def close(self) -> None:
        """Give the graphics memory back."""
        if self._camera is not None:
            self._camera.close()
            self._camera = None

    def _drawn_from(self, options: dict[str, Any]) -> Machines:
        if unknown := options.keys() - set(_OPTIONS):
            raise InputError(f"options has {sorted(unknown)}; reset() takes {' and '.join(_OPTIONS)}.")
        own = self._machines
        parameters = {**own.parameters, **options.get("parameters", {})}
        return Machines(own.given, parameters, options.get("spread", own.spread))

    def _take(self, machine: Machine) -> None:
        """Play with a machine; a model and a camera of the same one are kept."""
        if machine.best.sweep_end <= 2 * self.control_step:
            raise InputError(
                f"control_step = {self.control_step!r} s is too long: the first sweep of "
                f"{machine.mechanism.name!r} ends at {machine.best.sweep_end:.4g} s."
            )
        if self._machine is not None and self._machine.mechanism == machine.mechanism:
            return
        self.close()
        self._machine, mechanism = machine, machine.mechanism
        self._motion = Motion(mechanism, self.control_step / self.substeps)
        self._kinematics = Kinematics(mechanism)
        marker = next(marker for marker in mechanism.markers if marker.name == _PROJECTILE)
        self._projectile = self._kinematics.point(marker.body, marker.point)
        self._scales = _scales(mechanism)

    def _thrown(self, q: FloatArray, u: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Position [m] and velocity [m/s] of the projectile."""
        row = self._projectile
        return self._kinematics.position(row, q), self._kinematics.velocity(row, q, u)

    def _observation(self) -> Observation:
        q, u = self.motion.state
        angles, slides = np.split(q, [len(self.machine.mechanism.angles)])
        plain = np.concatenate([np.cos(angles), np.sin(angles), slides, u, self._thrown(q, u)[1]])
        return np.clip((plain / self._scales).astype(np.float32), -self._bounds, self._bounds)

    def _info(self) -> dict[str, Any]:
        return {"time": self.time}

    def _let_go(self) -> tuple[Observation, float, bool, bool, dict[str, Any]]:
        self._over = True
        (x, y), (vx, vy) = (values.tolist() for values in self._thrown(*self.motion.state))
        best, info, reward = self.machine.best, self._info(), 0.0
        try:
            flight = fly(Release(self.time, (x, y), (vx, vy)), best.surroundings)
        except InputError:  # it never comes up to the landing's height
            pass
        else:
            reward = flight.range / best.range
            info |= {"range": flight.range, "flight_time": flight.time}
        return self._observation(), reward, True, False, info


def _scales(mechanism: Mechanism) -> FloatArray:
    """Units of the observation's components."""
    time = characteristic_time(mechanism)
    length, turning = mechanism.gravity * time**2, len(mechanism.angles)
    sliding = len(mechanism.coordinates) - turning
    own = [1.0] * 2 * turning + [length] * sliding
    return np.array([*own, *[1 / time] * turning, *[length / time] * (sliding + 2)])


def _checked_steps(control_step: float, substeps: int) -> tuple[float, int]:
    if not (math.isfinite(control_step) and control_step > 0):
        raise InputError(f"control_step = {control_step!r} s must be positive and finite.")
    if isinstance(substeps, bool) or int(substeps) != substeps or substeps < 1:
        raise InputError(f"substeps = {substeps!r} must be a whole number, at least 1.")
    return float(control_step), int(substeps)


def _checked_picture(mode: str | None, width: int, height: int) -> tuple[str | None, tuple[int, int]]:
    if mode not in (None, "rgb_array"):
        raise InputError(f"render_mode = {mode!r} must be 'rgb_array' or None.")
    for name, size, most in zip(("width", "height"), (width, height), LARGEST_PICTURE, strict=True):
        if int(size) != size or not 1 <= size <= most:
            raise InputError(f"{name} = {size!r} must be a whole number of pixels from 1 to {most}.")
    return mode, (int(width), int(height))
