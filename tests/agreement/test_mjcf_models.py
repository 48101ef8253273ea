"""The MJCF of machines and problems in MuJoCo.

Events as keyframes, one line to a file, two of them in one scene.
"""

from __future__ import annotations

import importlib
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trebucheck as tb
import xarray as xr
from PIL import Image
from trebucheck.comparisons.data.certified import content
from trebucheck.models import mjcf as descriptions
from trebucheck.models.library.registry import models, parameters_type
from trebucheck.models.mjcf.scene import event_names, stored_motion
from trebucheck.models.mjcf.variants import POINT_INERTIA, released, throw
from trebucheck.models.mjcf.writer import mjcf
from trebucheck.reference.solution import Solution
from trebucheck.reference.solver import solve

mujoco: Any = pytest.importorskip("mujoco")
mass_matrix: Any = importlib.import_module("trebucheck.engines.mujoco.compat").mass_matrix

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
        for stop, time in (
            zip(data.stop.values, data.release_time.values, strict=True) if "stop" in data else ()
        ):
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
        assert [key.name for key in motion.keyframes] == [
            "hanger_release",
            "sling_release",
            "launch",
        ]


def test_names_of_events_are_each_there_once() -> None:
    rests = [
        ("hanger rest", "release"),
        ("hanger stop", "release"),
        ("a b", "impact"),
        ("", "launch"),
    ]
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
    assert [model.key(i).name for i in range(model.nkey)] == [
        "home",
        "hanger_release",
        "sling_release",
        "launch",
    ]
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
    own = importlib.import_module(f"trebucheck.models.mjcf.{name.replace('-', '_')}")
    assert getattr(descriptions, name.replace("-", "_")) is own
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


# --- The files in MuJoCo
# ------------------------------------------------------------------------------------------

EXACT = 1e-12
WARNINGS = int(mujoco.mjtWarning.mjNWARNING)
every_file = pytest.mark.parametrize("scene", [False, True], ids=["model", "scene"])


@every_model
@every_file
def test_compiled_masses_inertias_and_limits_are_the_mechanisms(name: str, scene: bool) -> None:
    mechanism, model = tb.model(name), mujoco.MjModel.from_xml_path(tb.mjcf_path(name, scene=scene))
    names = tb.mjcf_names(mechanism)
    for body in mechanism.bodies:
        found, joint = model.body(names[body.name]), mechanism.joint_of(body.name)
        assert float(found.mass[0]) == pytest.approx(body.mass, rel=EXACT)
        assert found.inertia == pytest.approx(max(body.inertia, POINT_INERTIA), rel=EXACT)
        arm = np.subtract(body.centre, joint.child_point)
        assert found.ipos == pytest.approx([arm[0], 0.0, arm[1]], rel=EXACT, abs=EXACT)
    assert float(model.body_mass.sum()) == pytest.approx(
        sum(body.mass for body in mechanism.bodies), rel=EXACT
    )
    start = mechanism.tree.configuration(mechanism.start).angles
    for stop in mechanism.angle_stops:  # of the named machines each is an end of a joint's range
        joint = model.joint(names[mechanism.joint_of(stop.body).name])
        turned = stop.sense * stop.limit - (start[stop.body] - start[stop.relative_to])
        assert joint.range[0 if stop.sense > 0 else 1] == pytest.approx(
            turned, rel=EXACT, abs=EXACT
        )
        assert model.jnt_limited[joint.id]


@pytest.mark.slow
@every_model
def test_ten_seconds_bring_no_warning(name: str) -> None:
    model = mujoco.MjModel.from_xml_path(tb.mjcf_path(name, scene=True))
    data = mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, data, 0)
    mujoco.mj_step(model, data, 10_000)
    assert data.time == pytest.approx(10.0)
    assert [data.warning[kind].number for kind in range(WARNINGS)] == [0] * WARNINGS


@every_model
def test_a_second_with_noise_brings_no_warning(name: str) -> None:
    """As MuJoCo Menagerie tests its models.

    They have no controls here, so that forces on the joints are the noise.
    """
    model = mujoco.MjModel.from_xml_path(tb.mjcf_path(name))
    data, rng = mujoco.MjData(model), np.random.default_rng(12345)
    mujoco.mj_resetDataKeyframe(model, data, 0)
    for _ in range(1000):
        data.qfrc_applied[:] = 1000.0 * rng.normal(size=model.nv)
        mujoco.mj_step(model, data)
    assert [data.warning[kind].number for kind in range(WARNINGS)] == [0] * WARNINGS


@every_model
def test_what_is_drawn_weighs_nothing_and_touches_nothing(name: str) -> None:
    model = mujoco.MjModel.from_xml_path(tb.mjcf_path(name, scene=True))
    drawn = [i for i in range(model.ngeom) if model.geom_group[i] != 4]
    assert len(drawn) > 5
    assert not model.geom_contype[drawn].any() and not model.geom_conaffinity[drawn].any()
    paired = {*model.pair_geom1.tolist(), *model.pair_geom2.tolist()}
    assert not paired & set(drawn)


@every_model
def test_pictures_are_small(name: str) -> None:
    folder = Path(tb.mjcf_path(name)).parent
    with Image.open(folder / f"{name}.png") as still, Image.open(folder / f"{name}.gif") as moving:
        assert still.size == (640, 480) and moving.n_frames > 40
    assert (folder / f"{name}.gif").stat().st_size < 400_000


@every_model
def test_the_readme_is_of_this_model(name: str) -> None:
    """Its names, parameters and times; the figures are measured when it is written."""
    text = (Path(tb.mjcf_path(name)).parent / "README.md").read_text()
    model = mujoco.MjModel.from_xml_path(tb.mjcf_path(name))
    for key in (model.key(i) for i in range(1, model.nkey)):
        assert f"| `{key.name}` | {key.time[0]:.9f} |" in text
    assert ", ".join(model.joint(i).name for i in range(model.njnt)) in text
    for parameter, field in parameters_type(name).model_fields.items():
        assert f"| `{parameter}` | {field.default:.6g} |" in text


# --- Steps
# --------------------------------------------------------------------------------------------------


@pytest.mark.slow
def test_the_step_of_a_fast_problem_is_one_that_it_bears() -> None:
    """At 1 ms the squeezer, whose characteristic time is 2.3 ms, is unstable at 0.134 s."""
    model = mujoco.MjModel.from_xml_string(tb.mjcf("squeezer", keyframes=False))
    data, noise = mujoco.MjData(model), np.random.default_rng(0)
    mujoco.mj_resetDataKeyframe(model, data, 0)
    while data.time < 0.14 and not any(warning.number for warning in data.warning):
        data.ctrl[:] = noise.normal(size=model.nu)
        mujoco.mj_step(model, data, 10)
    assert data.time >= 0.14
    asked = mujoco.MjModel.from_xml_string(tb.mjcf("squeezer", keyframes=False, timestep=1e-4))
    assert asked.opt.timestep == 1e-4 and model.opt.timestep == pytest.approx(2.3e-5, rel=1e-6)


@pytest.mark.parametrize("keyframes", [True, False])
def test_a_step_is_a_hundredth_of_the_characteristic_time_and_a_millisecond_at_most(
    keyframes: bool,
) -> None:
    rod = tb.mjcf("falling-rod", keyframes=keyframes)  # its characteristic time is 0.0786 s
    assert 'timestep="0.00079"' in rod
    assert 'timestep="0.001"' in tb.mjcf("incline", keyframes=keyframes)  # 0.888 s
    assert 'timestep="0.001"' in tb.mjcf("rolling", l1=9.5, keyframes=keyframes)


# --- Variants
# --------------------------------------------------------------------------------------------------


def dynamics(text: str, states: Any) -> Any:
    """Mass matrices and accelerations without limits in states."""
    model = mujoco.MjModel.from_xml_string(text)
    model.opt.disableflags |= (
        mujoco.mjtDisableBit.mjDSBL_LIMIT | mujoco.mjtDisableBit.mjDSBL_CONTACT
    )
    data = mujoco.MjData(model)
    for qpos, qvel in states:
        data.qpos, data.qvel = qpos, qvel
        mujoco.mj_forward(model, data)
        yield mass_matrix(model, data), data.qacc.copy()


@pytest.mark.parametrize("name", [*models(), "double-pendulum", "pendulum"])
def test_finite_inertia_leaves_the_equations_of_motion(name: str) -> None:
    model = mujoco.MjModel.from_xml_string(tb.mjcf(name, keyframes=False, finite_inertia=True))
    assert model.body_inertia[model.body_mass > 0].min() > 1e-4
    n, rng = model.nv, np.random.default_rng(3)
    states = [(rng.uniform(-3, 3, n), rng.uniform(-3, 3, n)) for _ in range(5)]
    texts = (tb.mjcf(name, keyframes=False, finite_inertia=finite) for finite in (False, True))
    for (mass, acceleration), (other, others) in zip(
        *(dynamics(text, states) for text in texts), strict=True
    ):
        assert other == pytest.approx(mass, rel=1e-12, abs=1e-12 * np.abs(mass).max())
        assert others == pytest.approx(
            acceleration, rel=1e-9, abs=1e-9 * np.abs(acceleration).max()
        )


@pytest.mark.parametrize(
    ("name", "timestep"), [*((name, 1e-3) for name in models()), ("hinged", 2.5e-4)]
)
def test_a_thrown_projectile_moves_as_in_the_model_until_its_release(
    name: str, timestep: float
) -> None:
    """The machine as well, where plain steps lose its contacts and find them again."""
    texts = (tb.mjcf(name, timestep=timestep, throw=throws) for throws in (False, True))
    alone, thrown = (mujoco.MjModel.from_xml_string(text) for text in texts)
    assert thrown.body_mass.sum() == pytest.approx(alone.body_mass.sum(), rel=EXACT)
    sites = [alone.site(i).name for i in range(alone.nsite)]
    runs = [(model, mujoco.MjData(model)) for model in (alone, thrown)]
    for model, data in runs:
        mujoco.mj_resetDataKeyframe(model, data, 0)
    for _ in range(20):
        for model, data in runs:
            mujoco.mj_step(model, data, int(alone.key("launch").time[0] / timestep) // 20)
            mujoco.mj_kinematics(model, data)
        (_, there), (_, found) = runs
        for name_ in sites:
            assert found.site(name_).xpos == pytest.approx(there.site(name_).xpos, abs=1e-6)
        assert found.body("thrown_projectile").xpos == pytest.approx(
            there.site("projectile").xpos, abs=1e-6
        )


@pytest.mark.parametrize("name", ["fixed", "catapult"])
def test_a_released_projectile_has_its_mass_and_the_machine_has_it_no_longer(name: str) -> None:
    model = mujoco.MjModel.from_xml_string(tb.mjcf(name, throw=True))
    data, machine = mujoco.MjData(model), tb.model(name)
    mujoco.mj_resetDataKeyframe(model, data, model.key("launch").id)
    mujoco.mj_forward(model, data)
    energies, before = [], model.body_mass.copy()
    for each in (model, released(model, data)):
        mujoco.mj_forward(each, data)
        energies.append(data.qvel @ mass_matrix(each, data) @ data.qvel)
    # Mass that changes hands between two points that move together changes neither the total nor
    # the energy.
    assert energies[1] == pytest.approx(energies[0], rel=1e-9)
    assert each.body_mass.sum() == pytest.approx(before.sum(), rel=EXACT)
    assert (model.body_mass == before).all()
    marker = machine.marker("projectile")
    assert marker is not None
    mass, whole = machine.thrown_mass(marker), machine.body(marker.body).mass
    kept = 0.1 * whole if mass == whole else 0.0  # a sling that has no other mass
    assert each.body("thrown_projectile").mass == pytest.approx(mass - kept, rel=1e-12)
    # Nothing but its weight acts on it.
    jacobian, rate = np.zeros((3, model.nv)), np.zeros((3, model.nv))
    ball = each.body("thrown_projectile").id
    mujoco.mj_jacBody(each, data, jacobian, None, ball)
    mujoco.mj_jacDot(each, data, rate, None, data.xpos[ball], ball)
    assert jacobian @ data.qacc + rate @ data.qvel == pytest.approx(
        [0, 0, -machine.gravity], abs=1e-8
    )


@pytest.mark.slow
def test_a_thrown_projectile_lands_where_its_parabola_ends() -> None:
    model = mujoco.MjModel.from_xml_string(tb.mjcf("catapult", timestep=2.5e-4, throw=True))
    thrown, end = mujoco.MjData(model), float(model.key("launch").time[0])
    mujoco.mj_resetDataKeyframe(model, thrown, model.key("launch").id)
    mujoco.mj_forward(model, thrown)
    jacobian, (x, _, z) = np.zeros((3, model.nv)), thrown.body("thrown_projectile").xpos.copy()
    mujoco.mj_jacBody(model, thrown, jacobian, None, model.body("thrown_projectile").id)
    vx, _, vz = jacobian @ thrown.qvel
    level = float(model.geom("landing_ground").pos[2] + model.geom("thrown_projectile").size[0])
    flight = (vz + np.sqrt(vz**2 + 2 * 9.81 * (z - level))) / 9.81
    landed = throw(model, thrown, release_time=end)
    assert landed == pytest.approx(
        x + vx * flight, abs=4 * abs(vx) * 2.5e-4
    )  # what a step or two moves it by
    assert not thrown.eq_active[model.equality("hold_projectile").id]


def test_what_throws_nothing_is_refused() -> None:
    with pytest.raises(tb.UnsupportedProblemError, match="projectile"):
        tb.mjcf("double-pendulum", keyframes=False, throw=True)


def test_without_sensors_the_model_is_the_same() -> None:
    with_them, without = tb.mjcf("floating-arm"), tb.mjcf("floating-arm", sensors=False)
    assert "<sensor>" not in without
    assert (
        with_them.replace(
            with_them[with_them.index("  <sensor>") : with_them.index("  <keyframe>")], ""
        )
        == without
    )
