"""Learn when to release: cross-entropy search over two thresholds on machines that vary."""

from __future__ import annotations

from collections.abc import Callable

import gymnasium
import numpy as np

Policy = Callable[[np.ndarray, float], bool]
"""Decision to let go, from an observation and the time [s]."""

env = gymnasium.make(
    "trebucheck_environments:trebucheck/Throw-v0", model="hinged", control_step=0.02
)
# Seeds: each is a machine with other lengths and masses.
training, others = (range(4), range(100, 112))


def score(lets_go: Policy, seeds: range) -> float:
    """Mean reward: the range in parts of what each machine can do at best."""
    rewards = list[float]()
    for seed in seeds:
        observation, info = env.reset(seed=seed)
        over, reward = False, 0.0
        while not over:
            observation, reward, terminated, truncated, info = env.step(
                int(lets_go(observation, info["time"]))
            )
            over = terminated or truncated
        rewards.append(float(reward))
    return float(np.mean(rewards))


def thresholds(angle: float, speed: float) -> Policy:
    """Let go once the velocity points below an angle [rad] and its scaled size is large enough."""
    return lambda observation, _: bool(
        np.arctan2(observation[-1], observation[-2]) < angle and np.hypot(*observation[-2:]) > speed
    )


def at_time(instant: float) -> Policy:
    """Let go at an instant [s], whatever the machine does."""
    return lambda _, time: time >= instant


instant = max(np.arange(1.75, 2.15, 0.05), key=lambda time: score(at_time(time), training))
print(f"one instant for all, {instant:.2f} s: {score(at_time(instant), others):.3f}")
print(f"velocity at 45 degrees:      {score(thresholds(np.pi / 4, 1.0), others):.3f}")

random = np.random.default_rng(0)
mean, spread = np.array([0.0, 2.0]), np.array([1.0, 1.0])
for trial in range(5):
    tried = mean + spread * random.standard_normal((12, 2))
    scores = np.array([score(thresholds(*values), training) for values in tried])
    best = tried[np.argsort(-scores)[:3]]
    mean, spread = best.mean(axis=0), best.std(axis=0) + 0.02
    print(f"round {trial + 1}: mean {scores.mean():.3f}, best {scores.max():.3f}")
print(
    f"learned:                     {score(thresholds(*mean), others):.3f}, at "
    f"{np.degrees(mean[0]):.0f} degrees"
)
