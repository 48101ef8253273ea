"""`trebucheck/Throw-v0`.

Gymnasium's own checks, seeds, rewards against MuJoCo, pictures, and what it refuses.
"""

from __future__ import annotations

import importlib
import os
import pickle
import subprocess
import sys
from typing import Any

import numpy as np
import pytest
import trebucheck as tb

gymnasium = pytest.importorskip(
    "gymnasium", reason="Gymnasium is not installed: pip install trebucheck[gym]"
)
pytest.importorskip("mujoco", reason="MuJoCo is not installed")

from gymnasium.utils.env_checker import check_env  # noqa: E402
from trebucheck.models.errors import SimulationError  # noqa: E402
from trebucheck.models.mjcf.variants import PROJECTILE  # noqa: E402
from trebucheck.models.problem import StopLaw  # noqa: E402
from trebucheck.reference.solver import characteristic_time  # noqa: E402
from trebucheck.reference.throw.flight import (  # noqa: E402
    Air,
    Release,
    fly,
    swing,
)
from trebucheck.reference.throw.throw import surroundings_of  # noqa: E402
from trebucheck_environments import HOLD, RELEASE, ThrowEnv  # noqa: E402
from trebucheck_environments.motion import Motion  # noqa: E402

NAME = "trebucheck_environments:trebucheck/Throw-v0"


def held(env: ThrowEnv, steps: int, **reset: Any) -> list[Any]:
    """What holding for some steps gives."""
    return [env.reset(**reset), *(env.step(HOLD) for _ in range(steps))]


def test_gymnasium_has_nothing_to_complain_of() -> None:
    check_env(
        gymnasium.make(NAME, model="catapult").unwrapped, skip_render_check=True
    )  # warnings are errors here


@pytest.mark.parametrize(
    "before",
    [
        f"name = {NAME!r}",
        "import trebucheck_environments; name = 'trebucheck/Throw-v0'",
        "import trebucheck_environments; gymnasium.register_envs(trebucheck_environments); "
        "name = 'trebucheck/Throw-v0'",
    ],
    ids=["the module before the colon", "imported", "registered"],
)
def test_gymnasium_finds_the_task(before: str) -> None:
    """In a process of its own: Gymnasium reads no entry points since 1.0, but imports a module."""
    code = f"""
import gymnasium
{before}
env, two = gymnasium.make(name, model="catapult"), gymnasium.make_vec(name, 2, model="catapult")
print(env.spec.id, env.reset(seed=1)[0].shape, two.reset(seed=1)[0].shape)
"""
    command = [sys.executable, "-c", code]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.stdout.split(maxsplit=1) == ["trebucheck/Throw-v0", "(5,) (2, 5)\n"], done.stderr


@pytest.mark.slow
def test_a_process_that_never_imported_the_package_makes_it_and_draws_it() -> None:
    """The machine before and after its release, and the whole flight.

    And the same seed is the same episode there.
    """
    code = f"""
import gymnasium
env = gymnasium.make({NAME!r}, model="catapult", render_mode="rgb_array", width=160, height=120)
seen = env.reset(seed=1)[0]
for _ in range(100):
    seen = env.step(0)[0]
print(seen.tobytes().hex())
try:
    last = env.render()
except Exception as error:
    print("SKIP", error)
    raise SystemExit
env.step(1)
landed = env.render()
red = ((landed[..., 0] > 150) & (landed[..., 1] < 90)).sum()
moved = int((landed != last).any(axis=2).sum())
print(last.shape, last.dtype, float(last.std()) > 10, moved > 50, int(red) > 50)
env.close()
"""
    run = [sys.executable, "-W", "error::UserWarning", "-c", code]
    said = subprocess.run(
        run, capture_output=True, text=True, check=True, env={**os.environ, "MUJOCO_GL": "egl"}
    )
    seen, drawn = said.stdout.splitlines()
    assert seen == held(ThrowEnv("catapult"), 100, seed=1)[-1][0].tobytes().hex()
    if drawn.startswith("SKIP"):
        pytest.skip(drawn)
    assert drawn == "(120, 160, 3) uint8 True True True"


def test_the_same_seed_plays_the_same_episode() -> None:
    one, other = ThrowEnv("catapult"), ThrowEnv("catapult")
    first = held(one, 60, seed=3)
    held(other, 5, seed=4)
    again = held(other, 60, seed=3)
    for (a, *rest), (b, *other_rest) in zip(first, again, strict=True):
        assert a.tobytes() == b.tobytes()
        assert rest == other_rest
    assert one.step(RELEASE)[1] == other.step(RELEASE)[1]
    assert (
        one.reset()[1]["parameters"] != first[0][1]["parameters"]
    )  # the next episode has another machine
    assert other.reset(seed=4)[1]["parameters"] != first[0][1]["parameters"]


@pytest.mark.parametrize("name", ["fixed", "rolling", "catapult"])
def test_a_release_flies_as_far_as_the_references(name: str) -> None:
    """As `tb.throw` has it, whose stops open once.

    To the reference's tolerance of 1e-13 times some amplification.
    """
    projectile = swing(tb.model(name))
    surroundings = surroundings_of(projectile, Air(), 0.0)
    best = projectile.best_release(surroundings)
    assert best is not None
    steps = round(best.time / 0.01)
    env = ThrowEnv(name, spread=0)
    _, info = held(env, steps)[0]
    *_, ended, truncated, thrown = env.step(RELEASE)
    assert (ended, truncated) == (True, False)
    expected = fly(projectile.release_at(0.01 * steps), surroundings).range
    assert thrown["range"] == pytest.approx(expected, rel=1e-10)
    longest = fly(best, surroundings).range
    assert info["best_range"] == pytest.approx(longest, rel=1e-9)
    assert info["best_time"] == pytest.approx(
        best.time, abs=1e-5
    )  # where the range is flat to 1e-9


@pytest.mark.parametrize(
    ("name", "seeds", "least_impacts"), [("rolling", (0, 1), 2), ("fixed", (3,), 0)]
)
def test_rewards_are_those_of_mujoco_with_its_events_located(
    name: str, seeds: tuple[int, ...], least_impacts: int
) -> None:
    """Random machines and release times, those around an arm's impact among them.

    To twice what a halved step changes: MuJoCo's error falls at least in proportion to its step.
    """
    env, struck = ThrowEnv(name, spread=0.2), 0
    for seed in seeds:
        best_range = env.reset(seed=seed)[1]["best_range"]
        mechanism, best = env.machine.mechanism, env.machine.best
        problem = tb.Problem(mechanism, duration=best.sweep_end, stop_law=StopLaw.UNILATERAL)
        runs = [tb.engine("mujoco", timestep=step).simulate(problem) for step in (2e-3, 1e-3)]
        impacts = np.array([time for time, _ in runs[1].impacts if time < 0.999 * best.sweep_end])
        struck += len(impacts)
        chosen = np.random.default_rng(seed).uniform(0.7, 0.99, 6) * best.sweep_end
        around = impacts[:, None] + [-4e-3, -1e-3, 3e-3, 5e-3]
        for time in 2e-3 * np.rint(np.append(chosen, around) / 2e-3):
            coarse, fine = (_range(env, run, float(time)) for run in runs)
            assert abs(coarse - fine) < 1e-6 * best_range
            flight = Motion(best, float(time)).thrown(1)
            mine = 0.0 if flight is None else flight.range
            assert mine == pytest.approx(fine, abs=2 * abs(coarse - fine) + 1e-10 * best_range)
    assert struck >= least_impacts


def _range(env: ThrowEnv, run: tb.Trajectory, time: float) -> float:
    """Range of a release of a run's projectile at one of its samples [m]; 0 where none lands."""
    sample = int(np.argmin(np.abs(run.t - time)))
    assert abs(run.t[sample] - time) < 1e-12
    point = run.markers["projectile"]
    place, velocity = (
        tuple(values[sample].tolist()) for values in (point.position, point.velocity)
    )
    try:
        return fly(Release(time, place, velocity), env.machine.best.surroundings).range
    except tb.InputError:
        return 0.0


def test_no_release_earns_more_than_one() -> None:
    """Nor just before an impact, where the range of this machine has its largest value and jumps.

    But for rounding.
    """
    env = ThrowEnv("rolling", spread=0.2)
    env.reset(seed=6)
    best = env.machine.best
    impact = min(
        (time for time, _ in best.projectile.solution.impacts),
        key=lambda time: abs(time - best.time),
    )
    times = [
        *np.linspace(best.projectile.opened, best.sweep_end, 200),
        np.nextafter(impact, 0.0),
        impact,
    ]
    flights = [Motion(best, float(time)).thrown(1) for time in times[1:]]
    rewards = np.array([0.0 if flight is None else flight.range / best.range for flight in flights])
    assert rewards.max() <= 1 + 1e-12
    assert rewards[-2] > 0.999
    assert rewards[-1] != pytest.approx(rewards[-2], abs=1e-6)


def test_reward_is_the_share_of_the_longest_range() -> None:
    env = ThrowEnv("catapult")
    _, info = env.reset(seed=5)
    for _ in range(round(info["best_time"] / env.control_step)):
        assert env.step(HOLD)[1] == 0.0
    _, reward, *_, thrown = env.step(RELEASE)
    assert reward == thrown["range"] / info["best_range"]
    assert (
        0.99 < reward <= 1 + 1e-9
    )  # half a control step beside the peak; the catapult's steps err by 1e-12


@pytest.mark.parametrize("name", ["rolling", "floating-arm"])
def test_observations_are_the_references_motion(name: str) -> None:
    """Slides, a loop, a trough: to the rounding of a float32."""
    steps, mechanism = 60, tb.model(name)
    env = ThrowEnv(name, spread=0)
    observed = held(env, steps)[-1][0]
    projectile = swing(mechanism, stop_law=StopLaw.UNILATERAL)
    instant = np.array([0.01 * steps])
    motion = projectile.solution.motion(instant)
    (q,), (u,), (velocity,) = motion.q, motion.u, projectile.states(instant)[1]
    time = characteristic_time(mechanism)
    length, turning = mechanism.gravity * time**2, len(mechanism.angles)
    expected = [np.cos(q[:turning]), np.sin(q[:turning]), q[turning:] / length]
    expected += [u[:turning] * time, u[turning:] * time / length, velocity * time / length]
    assert env.observation_names[-4:-2] == tuple(
        f"d/dt {name}" for name in mechanism.coordinates[-2:]
    )
    assert observed == pytest.approx(np.concatenate(expected), rel=1e-6, abs=1e-6)


def test_the_end_of_the_first_sweep_truncates() -> None:
    env = ThrowEnv("catapult", spread=0, control_step=0.1)
    results = held(env, 34)
    assert [result[3] for result in results[1:]] == [False] * 33 + [
        True
    ]  # the sweep ends at 3.317 s
    with pytest.raises(gymnasium.error.ResetNeeded):
        env.step(HOLD)


def test_with_flight_an_episode_goes_on_to_the_landing() -> None:
    short, env = (
        ThrowEnv("catapult", spread=0, control_step=0.1),
        ThrowEnv("catapult", spread=0, control_step=0.1, flight=True),
    )
    held(short, 20), held(env, 20)
    *_, reward, ended, _, thrown = short.step(RELEASE)
    results = [env.step(RELEASE)]
    while not results[-1][2]:
        assert results[-1][1:4] == (0.0, False, False)
        results.append(env.step(RELEASE))
    assert ended
    assert (results[-1][1], results[-1][4]["range"]) == (reward, thrown["range"])
    assert len(results) == 1 + np.ceil(thrown["flight_time"] / 0.1)
    assert results[-1][4]["time"] == pytest.approx(2.0 + thrown["flight_time"], abs=1e-12)


def test_a_pickled_episode_goes_on_as_the_original_does() -> None:
    env = ThrowEnv("catapult", flight=True, control_step=0.5)
    held(env, 4, seed=2)
    for action in (HOLD, RELEASE, HOLD, HOLD):  # copied in flight, too
        copy = pickle.loads(pickle.dumps(env))
        one, other = env.step(action), copy.step(action)
        assert one[0].tobytes() == other[0].tobytes()
        assert one[1:] == other[1:]
    assert env.reset()[1]["parameters"] == copy.reset()[1]["parameters"]


@pytest.mark.parametrize("mode", ["sync", "async"])
def test_several_at_once(mode: str) -> None:
    envs = gymnasium.make_vec(NAME, 2, mode, model="catapult", spread=0, control_step=0.25)
    try:
        first, info = envs.reset(seed=5)
        assert first.shape == (2, 5)
        assert (info["best_time"] > 0).all()
        _, rewards, ended, _, info = envs.step(np.array([HOLD, RELEASE]))
        assert (rewards[0], list(ended)) == (0.0, [False, True])
        assert list(envs.step(np.array([HOLD, HOLD]))[4]["time"]) == [
            0.5,
            0.0,
        ]  # the other one begins again
    finally:
        envs.close()


def test_a_window_needs_a_display(monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ("DISPLAY", "WAYLAND_DISPLAY"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setattr(sys, "platform", "linux")
    env = ThrowEnv("catapult", spread=0, render_mode="human")
    assert (env.metadata["render_modes"], "human" in ThrowEnv.metadata["render_modes"]) == (
        ["rgb_array"],
        True,
    )
    with pytest.raises(
        SimulationError, match=r"^render_mode = 'human' needs a display.*DISPLAY.* is set\.$"
    ):
        env.reset()


def test_pictures_have_the_projectile_where_the_flight_has_it() -> None:
    """And the machine where the motion has it; after the release MuJoCo moves it on."""
    env = ThrowEnv("rolling", spread=0, flight=True)
    held(env, 240)
    stage, instants = env.stage(), [env.instant()]
    for action in (RELEASE, HOLD, HOLD):
        env.step(action)
        instants.append(env.instant())
    arm = list[float]()
    for instant in instants:
        stage.set(instant)
        arm.append(float(stage.data.joint("fulcrum").qpos[0]))
        place = stage.data.body(PROJECTILE).xpos[[0, 2]]
        release = env.machine.best.projectile.release_at(2.4)
        expected = np.array(release.position) + np.array(release.velocity) * instant.aloft
        expected[1] -= 0.5 * env.machine.mechanism.gravity * instant.aloft**2
        assert place == pytest.approx(expected, abs=1e-9)
    assert arm[0] == pytest.approx(
        instants[0].state.q[0] - env.machine.mechanism.start[0], abs=1e-12
    )
    assert arm[0] == arm[1]
    speed = instants[0].state.u[0]
    assert np.diff(arm[1:]) == pytest.approx(
        0.01 * speed, rel=0.1
    )  # it goes on with the speed that it had


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
    ratios = np.array(
        [
            [env.reset()[1]["parameters"][key] / value for key, value in nominal.items()]
            for _ in range(3)
        ]
    )
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
        ({"substeps": "many"}, "substeps = 'many'"),
        ({"control_step": "fast"}, "control_step = 'fast' s"),
        ({"spread": "wide"}, "spread = 'wide'"),
        ({"parameters": 9.0}, "parameters = 9.0"),
        ({"render_mode": "ansi"}, "'rgb_array'"),
        ({"width": None}, "width = None"),
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
    for action in (2, -1, float("nan"), 1.0, np.array([0, 1]), None):
        with pytest.raises(tb.InputError, match=r"action = .* must be 0 \(hold\) or 1 \(release\)"):
            env.step(action)
    for options in ([1], {"parameters": 9.0}, {"spread": "wide"}, {"parameters": {"l1": "long"}}):
        with pytest.raises(tb.InputError) as caught:
            env.reset(options=options)  # type: ignore[arg-type]
        assert "\n" not in str(caught.value)
    with pytest.raises(tb.InputError, match="sprad"):
        env.reset(options={"sprad": 0})
    with pytest.raises(tb.InputError, match="spread = 0 and no parameters"):
        ThrowEnv(tb.catapult())


def test_without_gymnasium_one_sentence_says_what_to_install(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setitem(sys.modules, "gymnasium", None)
    for name in [name for name in sys.modules if name.startswith("trebucheck_environments")]:
        monkeypatch.delitem(sys.modules, name)
    with pytest.raises(tb.EngineNotInstalledError, match=r"trebucheck\[gym\]"):
        importlib.import_module("trebucheck_environments")
