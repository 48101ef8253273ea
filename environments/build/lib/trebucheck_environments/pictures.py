"""Pictures of an episode, drawn by MuJoCo off screen or in its viewer, with the flight."""

from __future__ import annotations

import importlib
import math
import os
import sys
import time
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np
from trebucheck.api.mechanics import (
    EngineNotInstalledError,
    Flight,
    FloatArray,
    Mechanism,
    SimulationError,
)
from trebucheck.api.mjcf import (
    AZIMUTH,
    ELEVATION,
    FIELD,
    HOLD,
    PROJECTILE,
    RecordedMotion,
    Thrown,
    Variant,
    corners,
    joint_values,
    line_of_sight,
    mjcf,
    model_file,
    released,
    scene,
    viewpoint,
)

from .motion import State

LARGEST_PICTURE = (1280, 960)
"""Width and height that the scene allows."""
_LONGEST_STEP = 1e-3  # [s] of MuJoCo, after the release
_FAR = 40.0  # of the ground, in parts of the longest range
_PATH = 80  # pieces that a flight is drawn in
_LEAST_RADIUS = 0.006  # of the projectile in flight, in parts of its distance: some five pixels
_ROOM = 0.03  # around a projectile in flight, in parts of the whole
_AROUND = np.array([[-1.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
_PATH_COLOUR, _BALL_COLOUR = (0.85, 0.12, 0.10, 1.0), (0.25, 0.24, 0.23, 1.0)
_NO_DISPLAY = (
    "render_mode = 'human' needs a display, and none is to be had here; 'rgb_array' draws without "
    "one"
)


def mujoco() -> Any:
    """The library.

    Raises:
        EngineNotInstalledError: it cannot be imported.
    """
    try:
        return importlib.import_module("mujoco")
    except ImportError as error:
        raise EngineNotInstalledError(f"pictures of an environment need MuJoCo: {error}") from error


@dataclass(frozen=True)
class Instant:
    """Contents of a picture."""

    state: State
    """State of the machine: at the release, once that is over."""
    flight: Flight | None = None
    """Flight of the released projectile."""
    aloft: float = 0.0
    """Time since the release [s]."""


class Stage:
    """A machine and its projectile in their scene, as a model of MuJoCo.

    Until the release both stand where the motion has them. Then the projectile flies on its
    parabola, and MuJoCo moves on the machine without it, by plain steps.

    Args:
        mechanism: with a marker "projectile".
        path: that the scene is fitted to.
        timestep: of MuJoCo, at most [s].
        farthest: range that can be thrown [m]; the ground is drawn far enough for it.

    Raises:
        EngineNotInstalledError: MuJoCo is not installed.
        SimulationError: MuJoCo refuses the model.
        UnsupportedProblemError: it cannot be written as MJCF.
    """

    def __init__(
        self, mechanism: Mechanism, path: RecordedMotion, timestep: float, farthest: float
    ) -> None:
        self._library, self._mechanism = mujoco(), mechanism
        self._timestep = timestep / math.ceil(timestep / _LONGEST_STEP)
        marker = mechanism.marker("projectile")
        # Without a mass of its own the projectile cannot leave the body that carries it: only its
        # path is drawn then.
        self._leaves = marker is not None and mechanism.thrown_mass(marker) is not None
        text = mjcf(mechanism, self._timestep, path, Variant(sensors=False, throw=self._leaves))
        file = model_file(mechanism)
        try:
            self.model = self._library.MjModel.from_xml_string(
                scene(mechanism, file, path), {file: text.encode()}
            )
        except ValueError as error:
            raise SimulationError(
                f"MuJoCo refuses the model of {mechanism.name!r}: {error}"
            ) from error
        # Without this flag MuJoCo resets a diverged simulation to the start and goes on.
        self.model.opt.disableflags |= self._library.mjtDisableBit.mjDSBL_AUTORESET
        self.model.vis.global_.fovy = FIELD
        self.model.vis.map.zfar = max(
            self.model.vis.map.zfar, _FAR * farthest / self.model.stat.extent
        )
        self.data = self._library.MjData(self.model)
        self._corners = corners(mechanism, path)
        self._stepped: int | None = None
        self._without = self.model
        """Model of the machine without its projectile."""

    def set(self, instant: Instant) -> None:
        """Place everything as it is at an instant."""
        if instant.flight is None or self._stepped is None:
            self._stepped = None
            self._place(instant.state)
        if instant.flight is not None:
            self._move_on(instant.flight, instant.aloft)
        self._library.mj_forward(self.model, self.data)

    def look(self, instant: Instant, camera: Any, aspect: float) -> None:
        """Point a free camera so that it shows the machine and the flight so far."""
        points = self._corners
        if instant.flight is not None:
            points = np.concatenate([points, _upright(self._flown(instant))])
            points = np.concatenate(
                [points, points[-1] + _ROOM * np.ptp(points, axis=0).max() * _AROUND]
            )
        at, view = viewpoint(points, aspect), line_of_sight()[0]
        distance = float((points @ view).mean() - at @ view)
        camera.type = self._library.mjtCamera.mjCAMERA_FREE
        camera.lookat[:] = at + distance * view
        camera.distance, camera.azimuth, camera.elevation = distance, 90.0 - AZIMUTH, -ELEVATION

    def draw_flight(self, instant: Instant, camera: Any, drawn: Any) -> None:
        """Add the path and a projectile that can be seen from far to a scene of MuJoCo's."""
        if instant.flight is None:
            return
        places = _upright(self._flown(instant))
        none, kinds = np.zeros(3), self._library.mjtGeom
        for a, b in pairwise(places):
            self._add(drawn, kinds.mjGEOM_LINE, none, none, _PATH_COLOUR)
            self._library.mjv_connector(drawn.geoms[drawn.ngeom - 1], kinds.mjGEOM_LINE, 2.0, a, b)
        self._add(
            drawn,
            kinds.mjGEOM_SPHERE,
            np.full(3, _LEAST_RADIUS * camera.distance),
            places[-1],
            _BALL_COLOUR,
        )

    def _add(
        self, drawn: Any, kind: Any, size: FloatArray, place: FloatArray, colour: tuple[float, ...]
    ) -> None:
        geom = drawn.geoms[drawn.ngeom]
        self._library.mjv_initGeom(
            geom, kind, size, place, np.eye(3).ravel(), np.array(colour, dtype=np.float32)
        )
        drawn.ngeom += 1

    def _flown(self, instant: Instant) -> FloatArray:
        """Places since the release [m], shape (n, 2)."""
        assert instant.flight is not None
        return instant.flight.state(np.linspace(0.0, instant.aloft, _PATH + 1))[:, :2]

    def _place(self, state: State) -> None:
        """Set the joints; the projectile, if it is a body, to its point."""
        moved = (state.q - np.array(self._mechanism.start)).tolist()
        places, speeds = (
            joint_values(self._mechanism, values) for values in (moved, state.u.tolist())
        )
        if self._leaves:
            thrown = Thrown(self._mechanism, self._timestep)
            places, speeds = thrown.with_its_own(places), thrown.with_its_own(speeds)
            self.data.eq_active[self.model.equality(HOLD).id] = 1
        self.data.qpos[:], self.data.qvel[:] = places, speeds

    def _put(self, place: FloatArray, velocity: FloatArray) -> None:
        """Set the projectile to a position and velocity [m, m/s] in the world; its slides turn."""
        joints = [self.data.joint(f"{PROJECTILE}_{axis}") for axis in "xz"]
        for joint in joints:
            joint.qpos[0] = joint.qvel[0] = 0.0
        self._library.mj_forward(self.model, self.data)
        ball = self.data.body(PROJECTILE)
        for joint, way in zip(
            joints, np.array([joint.xaxis[[0, 2]] for joint in joints]), strict=True
        ):
            joint.qpos[0] = way @ (place - ball.xpos[[0, 2]])
        self._library.mj_forward(self.model, self.data)
        jacobian = np.zeros((3, self.model.nv))
        self._library.mj_jacBody(self.model, self.data, jacobian, None, ball.id)
        own = [self.model.joint(joint.id).dofadr[0] for joint in joints]
        to_come = velocity - (jacobian @ self.data.qvel)[[0, 2]]
        self.data.qvel[own] = np.linalg.solve(jacobian[np.ix_([0, 2], own)], to_come)

    def _move_on(self, flight: Flight, aloft: float) -> None:
        """Step the machine on without its projectile; where MuJoCo diverges, it stands still."""
        steps, done = round(aloft / self._timestep), self._stepped or 0
        if self._leaves and self._stepped is None:
            self._without = released(self.model, self.data)
        kept = self.data.qpos.copy(), self.data.qvel.copy()
        if steps > done:
            self._library.mj_step(self._without, self.data, nstep=steps - done)
        if not (np.isfinite(self.data.qpos).all() and np.isfinite(self.data.qvel).all()):
            self.data.qpos[:], self.data.qvel[:] = kept
        self._stepped = max(steps, done)
        if self._leaves:
            state = flight.state(np.array([aloft]))[0]
            self._put(state[:2], state[2:])


class Picture:
    """A stage drawn off screen.

    Raises:
        SimulationError: nothing can be drawn here.
    """

    def __init__(self, stage: Stage, size: tuple[int, int]) -> None:
        self._stage, self._aspect, library = stage, size[0] / size[1], mujoco()
        self._camera = library.MjvCamera()
        try:
            self._renderer = library.Renderer(stage.model, size[1], size[0])
        except Exception as error:  # whatever the graphics libraries raise
            raise SimulationError(
                f"MuJoCo cannot draw here: {error}; without a display it needs MUJOCO_GL=egl or "
                "MUJOCO_GL=osmesa."
            ) from error

    def show(self, instant: Instant) -> FloatArray:
        """A picture, shape (height, width, 3), of bytes."""
        self._stage.set(instant)
        self._stage.look(instant, self._camera, self._aspect)
        self._renderer.update_scene(self._stage.data, self._camera)
        self._stage.draw_flight(instant, self._camera, self._renderer.scene)
        return self._renderer.render().copy()

    def close(self) -> None:
        """Give the graphics memory back."""
        self._renderer.close()


class Window:
    """A stage in MuJoCo's viewer, in real time; once its user has closed it, it stays closed.

    Raises:
        SimulationError: no window can be opened.
    """

    def __init__(self, stage: Stage, frame: float) -> None:
        self._stage, self._frame, self._next = stage, frame, time.monotonic()
        self._viewer = _viewer(stage)
        self._followed = False

    def show(self, instant: Instant) -> None:
        """Show an instant, a frame after the last one."""
        if not self._viewer.is_running():
            return
        with self._viewer.lock():
            self._stage.set(instant)
            self._viewer.user_scn.ngeom = 0
            if (
                not self._followed or instant.flight is not None
            ):  # before the release the user may look around
                self._stage.look(instant, self._viewer.cam, 4 / 3)
                self._followed = True
            self._stage.draw_flight(instant, self._viewer.cam, self._viewer.user_scn)
        self._viewer.sync()
        time.sleep(max(0.0, self._next - time.monotonic()))
        self._next = max(self._next, time.monotonic()) + self._frame

    def close(self) -> None:
        """Close it."""
        self._viewer.close()


def may_have_display() -> bool:
    """Tell whether a window may open; without these variables Linux has none."""
    return sys.platform != "linux" or bool(
        os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY")
    )


def _viewer(stage: Stage) -> Any:
    """MuJoCo's viewer; without a display it would wait for ever."""
    if not may_have_display():
        raise SimulationError(f"{_NO_DISPLAY}: neither DISPLAY nor WAYLAND_DISPLAY is set.")
    try:
        glfw, viewer = (importlib.import_module(name) for name in ("glfw", "mujoco.viewer"))
        if sys.platform != "darwin" and not glfw.init():
            raise RuntimeError("GLFW cannot be initialised.")
        return viewer.launch_passive(
            stage.model, stage.data, show_left_ui=False, show_right_ui=False
        )
    except (ImportError, RuntimeError) as error:
        raise SimulationError(f"{_NO_DISPLAY}: {error}") from error


def _upright(places: FloatArray) -> FloatArray:
    """Places in the plane of motion, in MuJoCo's axes, shape (n, 3)."""
    return np.stack([places[:, 0], np.zeros(len(places)), places[:, 1]], axis=1)
