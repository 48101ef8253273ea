"""Controls of an environment of Gymnasium or dm_control, recorded while it runs."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np

from ...models.arrays import FloatArray
from ...models.controls import ControlRecord
from ...models.errors import EngineNotInstalledError, InputError, shortened
from ..study import Episode, Policy


def record_episode(
    environment: str | Any, duration: float, seed: int, policy: Policy | None
) -> Episode:
    """Run an episode of an environment that moves a model of MuJoCo; see `tb.rollout`."""
    if not 0.0 < duration < np.inf:
        raise InputError(f"duration = {duration!r} s must be a positive number.")
    made = _made(environment, seed) if isinstance(environment, str) else environment
    episode = _of_dm_control(made, policy) if hasattr(made, "physics") else _of_gym(made, policy)
    model, data, period = episode.model, episode.data, episode.period
    episode.reset(seed)
    qpos, qvel = np.array(data.qpos), np.array(data.qvel)
    steps, controls = max(1, round(duration / period)), list[FloatArray]()
    for _ in range(steps):
        goes_on = episode.step()
        controls.append(np.array(data.ctrl, dtype=np.float64))
        if not goes_on:
            break
    times = period * np.arange(len(controls), dtype=np.float64)
    record = ControlRecord(times, np.array(controls), source="the rollout")
    name = environment if isinstance(environment, str) else type(made).__name__
    return Episode(name, model, qpos, qvel, record, period * len(controls))


@dataclass(frozen=True)
class _Steps:
    model: Any
    data: Any
    period: float
    """Time between two actions [s]."""
    reset: Callable[[int], None]
    step: Callable[[], bool]
    """Chooses an action and makes a step; whether the episode goes on."""


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
        raise InputError(f"there is no environment {name!r}: {shortened(str(error))}.") from None


def _of_gym(env: Any, policy: Policy | None) -> _Steps:
    inner, observed = getattr(env, "unwrapped", env), list[Any]()
    lacking = [name for name in ("model", "data", "dt") if not hasattr(inner, name)]
    if lacking:
        raise InputError(
            f"the environment {type(inner).__name__} has no {lacking[0]!r}: it moves no model of "
            "MuJoCo."
        )

    def reset(seed: int) -> None:
        observed[:] = [env.reset(seed=seed)[0]]
        env.action_space.seed(seed)

    def step() -> bool:
        action = env.action_space.sample() if policy is None else policy(observed[0])
        observed[0], _, terminated, truncated, _ = env.step(action)
        return not (terminated or truncated)

    return _Steps(inner.model, inner.data, float(inner.dt), reset, step)


def _of_dm_control(env: Any, policy: Policy | None) -> _Steps:
    observed, spec = list[Any](), env.action_spec()
    actions = list[Iterator[Any]]()

    def random_actions(seed: int) -> Iterator[Any]:
        random = np.random.default_rng(seed)
        while True:
            low, high = np.maximum(spec.minimum, -1e3), np.minimum(spec.maximum, 1e3)
            yield random.uniform(low, high, spec.shape)

    def reset(seed: int) -> None:
        observed[:] = [env.reset().observation]
        actions[:] = [random_actions(seed)]

    def step() -> bool:
        action = next(actions[0]) if policy is None else policy(observed[0])
        made = env.step(action)
        observed[0] = made.observation
        return not made.last()

    physics = env.physics
    period = float(env.control_timestep())
    return _Steps(physics.model.ptr, physics.data.ptr, period, reset, step)
