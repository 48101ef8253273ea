"""The MJX model of a mechanism, and its functions compiled by JAX."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import lru_cache, partial
from typing import Any

from trebucheck_toolkit.jax_on_cpu import keep_compiled, without_words_on_warp  # isort: split

import jax
import mujoco
import numpy as np

with without_words_on_warp():
    from mujoco import mjx
from trebucheck.models.arrays import FloatArray
from trebucheck.models.mechanism import Mechanism
from trebucheck.models.mjcf.writer import mjcf
from trebucheck_toolkit.mujoco_models import CompiledModel, Seen

_NOT_IN_MJX = (
    mujoco.mjtSensor.mjSENS_E_POTENTIAL,
    mujoco.mjtSensor.mjSENS_E_KINETIC,
    mujoco.mjtSensor.mjSENS_JOINTLIMITFRC,
    mujoco.mjtSensor.mjSENS_TENDONLIMITFRC,
    mujoco.mjtSensor.mjSENS_CONTACT,
)


KEPT = 2
"""Models of which what is compiled is kept: a run's, and one of its readings or of another run."""


keep_compiled()


def use_precision(*, double: bool) -> None:
    """Have JAX compute in double or single precision from now on.

    Where the other one was used before, JAX would take constants of what it has traced then: MJX's
    RK4 fails so.
    """
    if jax.config.jax_enable_x64 is not double:
        jax.clear_caches()
        jax.config.update("jax_enable_x64", double)


@dataclass(frozen=True)
class Given:
    """A model that JAX compiles functions of; equal to another one of the same text."""

    text: str
    """MJCF."""
    double: bool
    """Whether in double precision."""
    mechanism: Mechanism = field(compare=False)
    """What it is a model of, for messages."""


class Built(CompiledModel):
    """A mechanism's model with MuJoCo's bookkeeping, and MJX's functions of it."""

    def __init__(self, mechanism: Mechanism, timestep: float, *, double: bool) -> None:
        """Build and compile; in single precision unless `double`."""
        use_precision(double=double)
        found = _functions(Given(mjcf(mechanism, timestep), double, mechanism))
        super().__init__(mechanism, found.model)
        self.first = found.data.qpos, found.data.qvel
        self._dynamics, self._forward, self._step = found.dynamics, found.forward, found.step
        self._warm: Any = found.data.qacc_warmstart

    def dynamics(
        self, q: FloatArray, u: FloatArray, generalized: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        """Accelerations of MJX's joints and mass matrix in a state, under forces, nothing held."""
        j, v = self.joint_state(q, u)
        a, mass = self._dynamics(j, v, self.sums.T @ generalized)
        return np.asarray(a, dtype=np.float64), np.asarray(mass, dtype=np.float64)

    def forward(self, q: FloatArray, u: FloatArray, generalized: FloatArray) -> Seen:
        """Readings in a state, under generalized forces on mechanism coordinates [N m, N]."""
        j, v = self.joint_state(q, u)
        found = self._forward(j, v, self.sums.T @ generalized, self._warm)
        return Seen(*(np.asarray(each, dtype=np.float64) for each in found))

    def stepped(self, q: FloatArray, u: FloatArray, step: float) -> tuple[FloatArray, FloatArray]:
        """The state a step [s] later by MJX's RK4."""
        j, v = self.joint_state(q, u)
        positions, speeds, self._warm = self._step(j, v, np.zeros_like(v), self._warm, step)
        return self.coordinates_of(positions, speeds)


@dataclass(frozen=True)
class _Functions:
    """MJX's functions of a model, compiled when they are called first."""

    model: Any
    data: Any
    dynamics: Any
    forward: Any
    step: Any


@lru_cache(KEPT)
def _functions(given: Given) -> _Functions:
    """Functions of a model, or those that were kept."""
    model = without_sensors(given.text)
    model.opt.integrator = mujoco.mjtIntegrator.mjINT_RK4
    both = on_device(model)
    # The model is a constant of what is compiled: to pass its hundreds of arrays takes longer than
    # a step.
    compiled = (jax.jit(partial(each, *both)) for each in (_dynamics, _forward, _step))
    return _Functions(model, both[1], *compiled)


def without_sensors(text: str) -> Any:
    """MuJoCo's model of an MJCF text without the sensors that MJX has not."""
    spec = mujoco.MjSpec.from_string(text)
    for sensor in [each for each in spec.sensors if each.type in _NOT_IN_MJX]:
        spec.delete(sensor)
    return spec.compile()


def on_device(model: Any, start: Any = None) -> tuple[Any, Any]:
    """MJX's model and its data at a start, or at the first keyframe.

    Raises:
        NotImplementedError: MJX has not what the model needs; its own words.
    """
    if start is None:
        start = mujoco.MjData(model)
        mujoco.mj_resetDataKeyframe(model, start, 0)
    return mjx.put_model(model), mjx.put_data(model, start)


def of_a_step(model: Any, data: Any) -> Any:
    """Data with the types of what a step gives back, as a scan over steps needs them.

    In double precision a step makes some indices 64 bits long.
    """
    if not jax.config.jax_enable_x64:
        return data
    after = jax.eval_shape(lambda data: mjx.step(model, data), data)
    return jax.tree.map(lambda a, like: jax.numpy.asarray(a, like.dtype), data, after)


def _placed(data: Any, positions: Any, speeds: Any, forces: Any) -> Any:
    as_number = partial(jax.numpy.asarray, dtype=data.qpos.dtype)
    return data.replace(
        qpos=as_number(positions), qvel=as_number(speeds), qfrc_applied=as_number(forces)
    )


def _dynamics(model: Any, data: Any, positions: Any, speeds: Any, forces: Any) -> tuple[Any, Any]:
    seen = mjx.forward(model, _placed(data, positions, speeds, forces))
    return seen.qacc_smooth, mjx.full_m(model, seen)


def _forward(
    model: Any, data: Any, positions: Any, speeds: Any, forces: Any, warm: Any
) -> tuple[Any, ...]:
    data = _placed(data, positions, speeds, forces).replace(qacc_warmstart=warm)
    seen = mjx.forward(model, data)
    # `forward` leaves internal forces, and with them force sensors, at zero.
    internal = mjx.rne_postconstraint(model, seen)._impl.cfrc_int[:, 3:]
    return mjx.full_m(model, seen), seen.sensordata, seen.xipos, internal, seen.qacc_smooth


def _step(
    model: Any, data: Any, positions: Any, speeds: Any, forces: Any, warm: Any, step: Any
) -> tuple[Any, ...]:
    model = model.replace(
        opt=model.opt.replace(timestep=jax.numpy.asarray(step, dtype=data.qpos.dtype))
    )
    after = mjx.step(model, _placed(data, positions, speeds, forces).replace(qacc_warmstart=warm))
    return after.qpos, after.qvel, after.qacc_warmstart
