"""The MJCF of machines and problems in MuJoCo: events as keyframes, one line to a file, two of them in one scene."""

from __future__ import annotations

from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trebucheck as tb
import xarray as xr
from trebucheck.comparisons.data.files import content
from trebucheck.models import mjcf as descriptions
from trebucheck.models.machines.registry import models
from trebucheck.models.mjcf.recorded import event_names, stored_motion
from trebucheck.models.mjcf.writer import mjcf
from trebucheck.reference.solution import Solution
from trebucheck.reference.solver import solve

mujoco: Any = pytest.importorskip("mujoco")

CERTIFIED = 1e-7
every_model = pytest.mark.parametrize("name", models())


@cache
def coarser(name: str) -> Solution:
    """The motion at thirty times the tolerance that it was recorded with."""
    return solve(tb.Problem(tb.model(name), duration=3.0), 1e-12, 1e-12)


def published(name: str, tmp_path: Any) -> dict[str, float]:
    (tmp_path / "motion.nc").write_bytes(content(name))
    with xr.open_dataset(tmp_path / "motion.nc") as data:
        times = {"launch": float(data.launch_time)}
        for stop, time in zip(data.stop.values, data.release_time.values, strict=True) if "stop" in data else ():
            times[event_names([(str(stop), "release")])[0]] = float(time)
    return {event: time for event, time in times.items() if np.isfinite(time)}


@every_model
def test_keyframes_are_the_certified_instants(name: str, tmp_path: Any) -> None:
    model = mujoco.MjModel.from_xml_path(tb.mjcf_path(name))
    keys = {model.key(i).name: model.key(i) for i in range(model.nkey)}
    assert keys.pop("home").time == 0.0
    times = {event: float(key.time[0]) for event, key in keys.items()}
    assert times == pytest.approx(published(name, tmp_path), abs=CERTIFIED)
    data, mechanism = mujoco.MjData(model), tb.model(name)
    for event, key in keys.items():
        mujoco.mj_resetDataKeyframe(model, data, key.id)
        mujoco.mj_forward(model, data)
        motion = coarser(name).trajectory(np.array([times[event]]))
        for marker in mechanism.markers:
            exact, names = motion.marker(marker.name), tb.mjcf_names(mechanism)
            velocity = data.sensor(names[f"{marker.name}/velocity"]).data
            found = data.site(names[marker.name]).xpos[[0, 2]], velocity[[0, 2]]
            assert found[0] == pytest.approx(exact.position[0], abs=CERTIFIED)
            assert found[1] == pytest.approx(exact.velocity[0], abs=CERTIFIED)


def test_the_events_of_the_papers_machines_are_named_after_their_rests() -> None:
    for name in ("fixed", "rolling"):
        motion = stored_motion(tb.model(name))
        assert motion is not None
        assert [key.name for key in motion.keyframes] == ["hanger_release", "sling_release", "launch"]


def test_names_of_events_are_each_there_once() -> None:
    rests = [("hanger rest", "release"), ("hanger stop", "release"), ("a b", "impact"), ("", "launch")]
    assert event_names(rests) == ["hanger_release", "hanger_release_2", "a_b_impact", "launch"]


def test_a_motion_is_stored_of_one_mechanism_only() -> None:
    other = tb.rolling(tb.TrebuchetParameters(l1=9.5))
    assert stored_motion(other) is None
    with pytest.raises(tb.InputError, match="another mechanism"):
        mjcf(other, motion=stored_motion(tb.rolling()))


def test_one_line_gives_the_file_the_text_or_a_spec() -> None:
    assert Path(tb.mjcf_path("rolling")).read_text() == tb.mjcf("rolling") == tb.mjcf(tb.rolling())
    model = tb.mjcf("rolling", l1=9.5, as_spec=True).compile()
    assert model.body("sling").pos[0] == 9.5
    assert [model.key(i).name for i in range(model.nkey)] == ["home", "hanger_release", "sling_release", "launch"]
    assert mujoco.MjModel.from_xml_string(tb.mjcf("squeezer", keyframes=False)).nkey == 1
    assert "floor_impact_2" in tb.mjcf("bouncing")
    with pytest.raises(tb.InputError, match="l7"):
        tb.mjcf("rolling", l7=1.0)
    with pytest.raises(tb.InputError, match="l1"):
        tb.mjcf(tb.rolling(), l1=9.5)
    with pytest.raises(tb.InputError, match="squeezer"):
        tb.mjcf_path("squeezer")


@every_model
def test_paths_are_constants_of_a_module(name: str) -> None:
    own = getattr(descriptions, name.replace("-", "_"))
    assert tb.mjcf_path(name) == own.MJCF_PATH and own.MJCF_PATH.startswith(own.PACKAGE_PATH)
    mujoco.MjModel.from_xml_path(own.MJCF_PATH_SCENE)
    with pytest.raises(AttributeError):
        _ = descriptions.no_machine


@every_model
def test_two_of_one_model_in_one_scene_move_as_it_does_alone(name: str) -> None:
    alone = mujoco.MjModel.from_xml_path(tb.mjcf_path(name))
    scene = mujoco.MjSpec()
    options = tb.mjcf(name, as_spec=True).option  # those of what is attached are not taken over
    for option in ("timestep", "integrator", "tolerance", "disableflags"):
        setattr(scene.option, option, getattr(options, option))
    for prefix, place in (("left_", (-30, 5, 0)), ("right_", (30, -5, 2))):
        frame = scene.worldbody.add_frame(pos=place)
        scene.attach(tb.mjcf(name, as_spec=True), prefix=prefix, frame=frame)
    both = scene.compile()
    one, two = mujoco.MjData(alone), mujoco.MjData(both)
    for data, model in ((one, alone), (two, both)):
        mujoco.mj_resetDataKeyframe(model, data, 0)
        mujoco.mj_step(model, data, 1500)
    site = tb.mjcf_names(tb.model(name))["projectile"]
    for prefix, place in (("left_", (-30, 5, 0)), ("right_", (30, -5, 2))):
        assert two.site(prefix + site).xpos - place == pytest.approx(one.site(site).xpos, abs=1e-9)
