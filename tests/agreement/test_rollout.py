"""Episodes of environments, recorded and replayed: of Gymnasium, and of dm_control's interface."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import gymnasium
import mujoco
import numpy as np
import pytest
import trebucheck as tb
from trebucheck.cli.app import main
from trebucheck.comparisons.runs.model_files import read_model_file
from trebucheck.engines.study import ModelStart

ID = "InvertedDoublePendulum-v5"
MODEL: Any = mujoco


def replayed(episode: Any, duration: float) -> Any:
    """The episode's model, moved with the recorded controls by its own engine."""
    qpos, qvel = episode.qpos.tolist(), episode.qvel.tolist()
    read: Any = read_model_file(episode.model, ModelStart(None, qpos, qvel, episode.controls))
    return read, read.moved(duration, read.options)


def test_a_replayed_episode_is_the_episode() -> None:
    """The same states, bit for bit: the record holds what was set, and when."""
    env: Any = gymnasium.make(ID)
    episode = tb.rollout(env, 0.5, seed=4)
    read, moved = replayed(episode, episode.duration)
    last = env.unwrapped.data
    assert moved.q[-1] == pytest.approx(read.coordinates(np.array(last.qpos)), abs=1e-14)
    assert moved.u[-1] == pytest.approx(read.speeds(np.array(last.qvel)), abs=1e-13)
    assert np.ptp(episode.controls.values) > 0


def test_a_seed_makes_an_episode_again_and_a_policy_chooses_its_actions() -> None:
    one, other = (tb.rollout(f"gymnasium:{ID}", 0.3, seed=2) for _ in range(2))
    assert np.array_equal(one.controls.values, other.controls.values)
    assert np.array_equal(one.qpos, other.qpos)
    held = tb.rollout(f"gymnasium:{ID}", 0.3, policy=lambda _: np.array([0.25]))
    assert np.all(held.controls.values == 0.25)


def test_an_audit_of_an_episode_starts_where_it_does(tmp_path: Path) -> None:
    episode = tb.rollout(f"gymnasium:{ID}", 0.2)
    found = tb.audit(episode, 0.2, engines=())
    assert found.source == f"an episode of gymnasium:{ID}"
    assert found.given.error is not None
    assert found.asked == min(0.2, episode.duration)
    with pytest.raises(tb.InputError, match="a start and controls of its own"):
        tb.audit(episode, 0.2, qpos=[0.0, 0.0, 0.0])


def test_the_command_keeps_the_controls(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = tmp_path / "audit"
    asked = ["--until", "0.2", "--engines", "exudyn", "--out", str(out), "--quiet"]
    assert main(["audit", "--rollout", f"gymnasium:{ID}", *asked]) == 0
    kept = np.load(out / "controls.npz")
    assert kept["ctrl"].shape == (len(kept["t"]), 1)
    assert main(["audit", "model.xml", "--rollout", f"gymnasium:{ID}"]) == 2
    assert main(["audit"]) == 2
    assert "one of them is needed" in capsys.readouterr().err


class Suite:
    """An environment with the interface of dm_control, which is not installed for tests."""

    def __init__(self) -> None:
        self.model = MODEL.MjModel.from_xml_string(
            '<mujoco><worldbody><body><joint name="j" axis="0 1 0"/><geom size="0.1" pos="0 0 -1" '
            'contype="0"/></body></worldbody><actuator><motor joint="j"/></actuator></mujoco>'
        )
        self.data = MODEL.MjData(self.model)
        self.physics = SimpleNamespace(
            model=SimpleNamespace(ptr=self.model), data=SimpleNamespace(ptr=self.data)
        )

    def action_spec(self) -> Any:
        return SimpleNamespace(minimum=np.array([-1.0]), maximum=np.array([1.0]), shape=(1,))

    def control_timestep(self) -> float:
        return 5 * float(self.model.opt.timestep)

    def reset(self) -> Any:
        MODEL.mj_resetData(self.model, self.data)
        self.data.qpos[:] = 0.7
        return SimpleNamespace(observation={})

    def step(self, action: Any) -> Any:
        self.data.ctrl[:] = action
        MODEL.mj_step(self.model, self.data, nstep=5)
        over = self.data.time > 0.4
        return SimpleNamespace(observation={}, last=lambda: over)


def test_an_episode_of_dm_control_is_replayed_up_to_its_end() -> None:
    env = Suite()
    episode = tb.rollout(env, 1.0)
    assert episode.duration == pytest.approx(env.data.time)
    assert episode.controls.times[-1] == pytest.approx(0.4, abs=0.011)
    _, moved = replayed(episode, float(env.data.time))
    assert moved.q[-1, 0] == pytest.approx(float(env.data.qpos[0]), abs=1e-14)


@pytest.mark.parametrize(
    "name", ["", "Hopper-v5", "gymnasium:", "gymnasium:Nothing-v0", "gymnasium:CartPole-v1", "a:b"]
)
def test_what_is_no_environment_of_mujoco_is_refused(name: str) -> None:
    with pytest.raises(tb.InputError) as raised:
        tb.rollout(name)
    assert name in str(raised.value) or "CartPole" in str(raised.value)


def test_a_package_that_is_missing_is_named() -> None:
    with pytest.raises(tb.EngineNotInstalledError, match="dm_control"):
        tb.rollout("dm_control:acrobot-swingup")


@pytest.mark.parametrize("duration", [0.0, -1.0, float("nan"), float("inf")])
def test_a_duration_that_is_none_is_refused(duration: float) -> None:
    with pytest.raises(tb.InputError, match="duration"):
        tb.rollout(Suite(), duration)
