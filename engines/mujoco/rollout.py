"""Controls of an environment of Gymnasium or dm_control, recorded while it runs."""

from __future__ import annotations

from typing import Any

import numpy as np

from ...models.arrays import FloatArray
from ...models.controls import ControlRecord
from ...models.errors import EngineNotInstalledError, InputError, shortened
from ..study import Episode, Policy

_LARGEST = 1e3  # random action of an actuator without limits


def record_episode(
    environment: str | Any, duration: float, seed: int, policy: Policy | None
) -> Episode:
    """Run an episode of an environment that moves a model of MuJoCo; see `tb.rollout`."""
    if not 0.0 < duration < np.inf:
        raise InputError(f"duration = {duration!r} s must be a positive number.")
    made = _made(environment, seed) if isinstance(environment, str) else environment
    env = _Suite(made, policy) if hasattr(made, "physics") else _Gymnasium(made, policy)
    env.reset(seed)
    qpos, qvel = np.array(env.data.qpos), np.array(env.data.qvel)
    controls, goes_on = list[FloatArray](), True
    while goes_on and len(controls) < max(1, round(duration / env.period)):
        goes_on = env.step()
        controls.append(np.array(env.data.ctrl, dtype=np.float64))
    times = env.period * np.arange(len(controls), dtype=np.float64)
    record = ControlRecord(times, np.array(controls), source="the rollout")
    name = environment if isinstance(environment, str) else type(made).__name__
    return Episode(name, env.model, qpos, qvel, record, env.period * len(controls))


def _made(name: str, seed: int) -> Any:
    package, _, rest = name.partition(":")
    try:
        match package:
            case "gymnasium":
                import gymnasium

                return gymnasium.make(rest)
            case "dm_control":
                # Not installed for tests: what it needs has no wheel for every platform
                from dm_control import suite  # pyright: ignore[reportMissingImports]

                domain, _, task = rest.partition("-")
                return suite.load(domain, task, task_kwargs={"random": seed})
            case _:
                raise InputError(
                    f"rollout = {name!r} must be gymnasium:ID or dm_control:DOMAIN-TASK, such as "
                    "gymnasium:Hopper-v5."
                )
    except ImportError as error:
        raise EngineNotInstalledError(f"{name!r} cannot be made: {error}.") from None
    except InputError:
        raise
    except Exception as error:  # of packages of others, each with errors of its own
        raise InputError(f"{name!r} cannot be made: {shortened(str(error).rstrip('.'))}.") from None


class _Gymnasium:
    """An environment with Gymnasium's interface, and what was observed last."""

    def __init__(self, env: Any, policy: Policy | None) -> None:
        inner = getattr(env, "unwrapped", env)
        for name in ("model", "data", "dt"):
            if not hasattr(inner, name):
                raise InputError(
                    f"the environment {type(inner).__name__} has no {name!r}: it moves no model of "
                    "MuJoCo."
                )
        self._env, self._observed = env, None
        self._policy: Policy = policy or (lambda _: env.action_space.sample())
        self.model, self.data, self.period = inner.model, inner.data, float(inner.dt)

    def reset(self, seed: int) -> None:
        """Begin an episode."""
        self._observed, _ = self._env.reset(seed=seed)
        self._env.action_space.seed(seed)

    def step(self) -> bool:
        """Choose an action and take a step; whether the episode goes on."""
        action = self._policy(self._observed)
        self._observed, _, terminated, truncated, _ = self._env.step(action)
        return not (terminated or truncated)


class _Suite:
    """An environment with dm_control's interface, and what was observed last."""

    def __init__(self, env: Any, policy: Policy | None) -> None:
        self._env, self._observed = env, None
        self._policy: Policy = policy or self._sample
        self._random = np.random.default_rng()
        self.model, self.data = env.physics.model.ptr, env.physics.data.ptr
        self.period = float(env.control_timestep())

    def reset(self, seed: int) -> None:
        """Begin an episode."""
        self._random = np.random.default_rng(seed)
        self._observed = self._env.reset().observation

    def step(self) -> bool:
        """Choose an action and take a step; whether the episode goes on."""
        made = self._env.step(self._policy(self._observed))
        self._observed = made.observation
        return not made.last()

    def _sample(self, _: Any) -> FloatArray:
        spec = self._env.action_spec()
        low, high = np.maximum(spec.minimum, -_LARGEST), np.minimum(spec.maximum, _LARGEST)
        return self._random.uniform(low, high, spec.shape)
