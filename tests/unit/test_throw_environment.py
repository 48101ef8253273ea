"""`trebucheck/Throw-v0`: Gymnasium's own checks, seeds, rewards against the reference, and what it refuses."""

from __future__ import annotations

import importlib
import os
import subprocess
import sys
from typing import Any

import numpy as np
import pytest
import trebucheck as tb

gymnasium = pytest.importorskip("gymnasium", reason="Gymnasium is not installed: pip install trebucheck[gym]")
pytest.importorskip("mujoco", reason="MuJoCo is not installed")

from gymnasium.utils.env_checker import check_env  # noqa: E402
from trebucheck.environments import HOLD, RELEASE, ThrowEnv  # noqa: E402
from trebucheck.models.problem import StopLaw  # noqa: E402
from trebucheck.reference.solver import characteristic_time  # noqa: E402
from trebucheck.reference.throw.flight import Air, fly  # noqa: E402
from trebucheck.reference.throw.release import swing  # noqa: E402
from trebucheck.reference.throw.throw import surroundings_of  # noqa: E402

NAME = "trebucheck.environments:trebucheck/Throw-v0"


def held(env: ThrowEnv, steps: int, **reset: Any) -> list[Any]:
    """What holding for some steps gives."""
    return [env.reset(**reset), *(env.step(HOLD) for _ in range(steps))]


def test_gymnasium_has_nothing_to_complain_of() -> None:
    check_env(gymnasium.make(NAME, model="catapult").unwrapped, skip_render_check=True)  # warnings are errors here


@pytest.mark.slow
def test_a_process_that_never_imported_the_package_makes_it_and_draws_it() -> None:
    code = f"""
import gymnasium
env = gymnasium.make({NAME!r}, model="catapult", render_mode="rgb_array", width=160, height=120)
env.reset(seed=1)
try:
    first = env.render()
except Exception as error:
    print("SKIP", error)
    raise SystemExit
for _ in range(100):
    env.step(0)
last = env.render()
print(last.shape, last.dtype, float(last.std()) > 10, int((first != last).any(axis=2).sum()) > 50)
env.close()
"""
    run = [sys.executable, "-W", "error::UserWarning", "-c", code]
    said = subprocess.run(run, capture_output=True, text=True, check=True, env={**os.environ, "MUJOCO_GL": "egl"})
    if said.stdout.startswith("SKIP"):
        pytest.skip(said.stdout.strip())
    assert said.stdout.strip() == "(120, 160, 3) uint8 True True"


def test_the_same_seed_plays_the_same_episode() -> None:
    one, other = ThrowEnv("catapult"), ThrowEnv("catapult")
    first = held(one, 60, seed=3)
    held(other, 5, seed=4)
    again = held(other, 60, seed=3)
    for (a, *rest), (b, *other_rest) in zip(first, again, strict=True):
        assert a.tobytes() == b.tobytes()
        assert rest == other_rest
    assert one.step(RELEASE)[1] == other.step(RELEASE)[1]
    assert one.reset()[1]["parameters"] != first[0][1]["parameters"]  # the next episode has another machine
    assert other.reset(seed=4)[1]["parameters"] != first[0][1]["parameters"]


@pytest.mark.parametrize("name", ["fixed", "rolling", "catapult"])
def test_a_release_flies_as_far_as_the_references(name: str) -> None:
    """To twice what a halved step changes: the error falls at least in proportion to the step."""
    projectile = swing(tb.model(name))
    surroundings = surroundings_of(projectile, Air(), 0.0)
    best = projectile.best_release(surroundings)
    assert best is not None
    steps, ranges = round(best.time / 0.01), list[float]()
    for substeps in (10, 20):
        env = ThrowEnv(name, spread=0, substeps=substeps)
        _, info = held(env, steps)[0]
        *_, ended, truncated, thrown = env.step(RELEASE)
        assert (ended, truncated) == (True, False)
        ranges.append(thrown["range"])
    expected = fly(projectile.release_at(0.01 * steps), surroundings).range
    assert ranges[0] == pytest.approx(expected, abs=2 * abs(ranges[0] - ranges[1]) + 1e-9)
    longest = fly(best, surroundings).range
    assert info["best_range"] == pytest.approx(longest, rel=1e-9)
    assert info["best_time"] == pytest.approx(best.time, abs=1e-5)  # where the range is flat to 1e-9


def test_reward_is_the_share_of_the_longest_range() -> None:
    env = ThrowEnv("catapult")
    _, info = env.reset(seed=5)
    for _ in range(round(info["best_time"] / env.control_step)):
        assert env.step(HOLD)[1] == 0.0
    _, reward, *_, thrown = env.step(RELEASE)
    assert reward == thrown["range"] / info["best_range"]
    assert 0.99 < reward <= 1 + 1e-9  # half a control step beside the peak; the catapult's steps err by 1e-12


@pytest.mark.parametrize("name", ["rolling", "floating-arm"])
def test_observations_are_the_references_motion(name: str) -> None:
    """Slides, a loop, a trough: to twice what a halved step changes, and the rounding of a float32."""
    steps, mechanism = 60, tb.model(name)
    envs = [ThrowEnv(name, spread=0, substeps=substeps) for substeps in (10, 20)]
    observed, halved = (held(env, steps)[-1][0] for env in envs)
    projectile = swing(mechanism, stop_law=StopLaw.UNILATERAL)
    instant = np.array([0.01 * steps])
    motion = projectile.solution.motion(instant)
    (q,), (u,), (velocity,) = motion.q, motion.u, projectile.states(instant)[1]
    time = characteristic_time(mechanism)
    length, turning = mechanism.gravity * time**2, len(mechanism.angles)
    expected = [np.cos(q[:turning]), np.sin(q[:turning]), q[turning:] / length]
    expected += [u[:turning] * time, u[turning:] * time / length, velocity * time / length]
    assert envs[0].observation_names[-4:-2] == tuple(f"d/dt {name}" for name in mechanism.coordinates[-2:])
    tolerance = 2 * float(np.abs(observed - halved).max()) + 1e-6
    assert tolerance < 2e-3
    assert observed == pytest.approx(np.concatenate(expected), abs=tolerance)


def test_the_end_of_the_first_sweep_truncates() -> None:
    env = ThrowEnv("catapult", spread=0, control_step=0.1)
    results = held(env, 34)
    assert [result[3] for result in results[1:]] == [False] * 33 + [True]  # the sweep ends at 3.317 s
    with pytest.raises(gymnasium.error.ResetNeeded):
        env.step(HOLD)


def test_what_never_comes_up_to_the_landing_earns_nothing() -> None:
    env = ThrowEnv("hinged", spread=0)  # its projectile starts in a trough below the fulcrum
    env.reset()
    _, reward, terminated, _, info = env.step(RELEASE)
    assert (reward, terminated, "range" in info) == (0.0, True, False)


def test_options_of_a_reset_are_those_of_its_episode() -> None:
    env = ThrowEnv("catapult")
    _, info = env.reset(seed=1, options={"parameters": {"l1": 9.0}, "spread": 0})
    assert info["parameters"] == {**dict(tb.CatapultParameters(l1=9.0))}
    assert env.reset()[1]["parameters"]["l1"] != 9.0


def test_lengths_and_masses_are_drawn_within_the_spread() -> None:
    env = ThrowEnv("catapult", spread=0.2)
    nominal = dict(tb.CatapultParameters())
    ratios = np.array([[env.reset()[1]["parameters"][key] / value for key, value in nominal.items()] for _ in range(3)])
    fixed = [list(nominal).index(key) for key in ("g", "theta0")]
    assert (ratios[:, fixed] == 1).all()
    drawn = np.delete(ratios, fixed, axis=1)
    assert (np.abs(drawn - 1) <= 0.2).all()
    assert (np.abs(drawn - 1).max(axis=0) > 0.005).all()


def test_a_mechanism_of_ones_own() -> None:
    mechanism = tb.catapult(tb.CatapultParameters(l1=8.0))
    env = ThrowEnv(mechanism, spread=0)
    assert env.reset()[1]["parameters"] == {}
    assert env.machine.mechanism == mechanism


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"model": "rollin"}, "did you mean 'rolling'"),
        ({"model": 3}, "model = 3"),
        ({"model": "pendulum", "spread": 0}, "'projectile'"),
        ({"parameters": {"l1": -1.0}}, "l1"),
        ({"parameters": {"length": 1.0}}, "length"),
        ({"spread": 1.0}, "spread = 1.0"),
        ({"spread": float("nan")}, "spread = nan"),
        ({"control_step": 0.0}, "control_step = 0.0 s"),
        ({"control_step": 2.0}, "ends at"),
        ({"substeps": 2.5}, "substeps = 2.5"),
        ({"render_mode": "human"}, "'rgb_array'"),
        ({"width": 4000}, "width = 4000"),
        ({"parameters": {"m_cw": 1.0}, "spread": 0}, "throws nothing"),
    ],
)
def test_bad_input_is_one_sentence(options: dict[str, Any], words: str) -> None:
    with pytest.raises(tb.InputError) as caught:
        ThrowEnv(**{"model": "catapult", **options})
    text = str(caught.value)
    assert words in text
    assert "\n" not in text


def test_bad_actions_and_options_are_one_sentence() -> None:
    env = ThrowEnv("catapult")
    with pytest.raises(gymnasium.error.ResetNeeded):
        env.step(HOLD)
    env.reset()
    with pytest.raises(tb.InputError, match=r"action = 2 must be 0 \(hold\) or 1 \(release\)"):
        env.step(2)
    with pytest.raises(tb.InputError, match="sprad"):
        env.reset(options={"sprad": 0})
    with pytest.raises(tb.InputError, match="spread = 0 and no parameters"):
        ThrowEnv(tb.catapult())


def test_without_gymnasium_one_sentence_says_what_to_install(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "gymnasium", None)
    for name in [name for name in sys.modules if name.startswith("trebucheck.environments")]:
        monkeypatch.delitem(sys.modules, name)
    with pytest.raises(tb.EngineNotInstalledError, match=r"trebucheck\[gym\]"):
        importlib.import_module("trebucheck.environments")
