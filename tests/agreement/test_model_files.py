"""Model files read into mechanisms: random ones, wrong readings, and bad files."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pytest
import trebucheck as tb
from mechanisms import geared
from model_files import RandomModel
from trebucheck.cli.app import main
from trebucheck.comparisons.runs.model_files import largest_difference, read_model_file
from trebucheck.engines.study import ModelStart
from trebucheck.models.controls import ControlRecord
from trebucheck.models.elements import SlideSpringDamper
from trebucheck.models.kinematics import Kinematics
from trebucheck.models.problem import mechanism_of
from trebucheck.reference.certification.redundant import RedundantSystem
from trebucheck.reference.equations import Equations
from trebucheck.reference.solver import solve

MACHINES = ("fixed", "rolling", "hinged", "catapult", "floating-arm")


PLANES = ("xz", "xy", "yz", "any")
MODEL: Any = mujoco
CART = """
<mujoco model="cart and pole">
  <compiler angle="radian"/>
  <option timestep="0.01" integrator="RK4" gravity="0.5 0 -9.81"/>
  <worldbody>
    <body name="cart" pos="0 0 1">
      <inertial pos="0.05 0 0.02" mass="1.5" diaginertia="0.1 0.2 0.15"/>
      <joint name="slider" type="slide" axis="-1 0 0" range="-1.8 1.9" limited="true" damping="0.4"
             stiffness="3" springref="0.3" ref="0.2"/>
      <body name="pole" pos="0.1 0 0.05">
        <inertial pos="0.1 0 0.5" mass="0.6" diaginertia="0.03 0.05 0.02" quat="1 0.2 0.1 0.3"/>
        <joint name="hinge" type="hinge" axis="0 -1 0" pos="0.02 0 0.01" damping="0.3" stiffness="2"
               springref="0.4" ref="0.1" armature="0.07" range="-1 1.2" limited="true"/>
        <site name="tip" pos="0 0 1"/>
        <body name="weight" pos="0.2 0 1">
          <inertial pos="0 0 0.1" mass="0.3" diaginertia="0.01 0.02 0.01"/>
        </body>
      </body>
    </body>
    <body name="wheel" pos="2 0 1">
      <inertial pos="0.1 0 0" mass="2" diaginertia="0.2 0.2 0.3"/>
      <joint name="axle" type="hinge" axis="0 1 0"/>
    </body>
  </worldbody>
  <actuator>
    <motor name="push" joint="slider" gear="-3"/>
    <position name="servo" joint="hinge" gear="1.5" kp="4"/>
  </actuator>
  <equality><connect name="rod" body1="pole" body2="wheel" anchor="0.3 0 0.4"/></equality>
  <keyframe><key name="leaning" qpos="0.4 0.3 0.1" qvel="0.1 0.2 0" ctrl="0.7 -0.2"/></keyframe>
</mujoco>
"""


@pytest.mark.parametrize("seed", range(24))
def test_random_models_are_read_as_they_are(seed: int) -> None:
    """Reading itself holds accelerations, gaps, places and loops against MuJoCo's to 1e-9."""
    random = RandomModel(seed, PLANES[seed % 4], loop=seed % 3 == 0)
    text = random.text()
    read: Any = read_model_file(text, ModelStart(ctrl=random.controls()))
    kinematics, data = Kinematics(read.mechanism), MODEL.MjData(read.model)
    rng = np.random.default_rng(seed)
    data.qpos[:], data.qvel[:] = rng.uniform(-2, 2, (2, read.model.nv))
    MODEL.mj_forward(read.model, data)
    MODEL.mj_energyVel(read.model, data)
    q, u = read.coordinates(np.array(data.qpos)), read.speeds(np.array(data.qvel))
    assert float(kinematics.kinetic_energy(q, u)) == pytest.approx(data.energy[1], rel=1e-10)


@pytest.mark.parametrize("seed", range(200, 212))
def test_random_models_of_coupled_joints_are_read_as_they_are(seed: int) -> None:
    """Reading holds what the couplers hold against MuJoCo; the two formulations are independent."""
    random = RandomModel(seed, PLANES[seed % 4], loop=seed % 4 == 0, coupled=True)
    text = random.text(2 + seed % 5)
    read: Any = read_model_file(text, ModelStart(ctrl=random.controls()))
    mechanism = read.mechanism
    assert len(mechanism.couplers) == text.count("<joint joint1") + text.count("<tendon tendon1")
    q, u = np.array(mechanism.start), np.zeros(len(mechanism.start))
    one, other = Equations(mechanism).solve(q, u, ())[0], RedundantSystem(mechanism)
    assert other.accelerations(other.start, ()) == pytest.approx(one, rel=1e-9, abs=1e-9)


@pytest.mark.parametrize("seed", range(100, 106))
def test_random_models_move_as_they_do(seed: int) -> None:
    """The limit of RK4 at short steps, without constraints, is the reference."""
    random = RandomModel(seed, PLANES[seed % 4])
    text, duration = random.text(4), 0.25
    read: Any = read_model_file(text, ModelStart(ctrl=random.controls(), without=("limits",)))
    model = read.model
    model.opt.integrator, model.opt.timestep = MODEL.mjtIntegrator.mjINT_RK4, 2.5e-4
    data = MODEL.MjData(model)
    data.qpos[:], data.ctrl[:] = model.qpos0, read.controls.values[0]
    for _ in range(1000):
        MODEL.mj_step(model, data)
    solution = solve(tb.Problem(read.mechanism, duration=duration))
    moved = solution.motion(np.array([duration])).q[0]
    # h^4 of RK4, with rates of change up to some 100 /s in motions of some radians
    assert read.coordinates(np.array(data.qpos)) == pytest.approx(moved, abs=1e-7, rel=1e-7)


def changed_bodies(mechanism: tb.Mechanism, change: Callable[[tb.Body], Any]) -> tb.Mechanism:
    """Change bodies."""
    bodies = tuple(body.model_copy(update=change(body)) for body in mechanism.bodies)
    return mechanism.model_copy(update={"bodies": bodies})


def changed(kind: type, **factors: float) -> Callable[[tb.Mechanism], tb.Mechanism]:
    """Multiply numbers of the force elements of a class."""

    def change(mechanism: tb.Mechanism) -> tb.Mechanism:
        elements = tuple(
            each.model_copy(update={n: getattr(each, n) * f for n, f in factors.items()})
            if type(each) is kind
            else each
            for each in mechanism.force_elements
        )
        assert elements != mechanism.force_elements
        return mechanism.model_copy(update={"force_elements": elements})

    return change


def without(kind: type) -> Callable[[tb.Mechanism], tb.Mechanism]:
    """Remove the force elements of a class."""
    return lambda m: m.model_copy(
        update={"force_elements": tuple(e for e in m.force_elements if type(e) is not kind)}
    )


def changed_parts(group: str, **fields: Any) -> Callable[[tb.Mechanism], tb.Mechanism]:
    """Change fields of all of a group, as functions of what they were."""

    def change(mechanism: tb.Mechanism) -> tb.Mechanism:
        parts = [
            part.model_copy(
                update={n: f(getattr(part, n)) for n, f in fields.items() if hasattr(part, n)}
            )
            for part in getattr(mechanism, group)
        ]
        return mechanism.model_copy(update={group: tuple(parts)})

    return change


def shifted(by: float) -> Callable[[Any], Any]:
    """A number, or the first of a pair, moved."""
    return lambda old: (old[0] + by, old[1]) if isinstance(old, tuple) else old + by


MISTAKES: dict[str, Callable[[tb.Mechanism], tb.Mechanism]] = {
    "masses doubled": lambda m: changed_bodies(m, lambda b: {"mass": 2 * b.mass}),
    "inertia about the joint": lambda m: changed_bodies(
        m, lambda b: {"inertia": b.inertia + b.mass * math.hypot(*b.centre) ** 2}
    ),
    "inertia about another axis": lambda m: changed_bodies(
        m, lambda b: {"inertia": 1.3 * b.inertia}
    ),
    "centre at the joint": lambda m: changed_bodies(m, lambda b: {"centre": (0.0, 0.0)}),
    "centre mirrored": lambda m: changed_bodies(
        m, lambda b: {"centre": (-b.centre[0], b.centre[1])}
    ),
    "a body without joints left out": lambda m: changed_bodies(
        m, lambda b: {"mass": b.mass * (1e-6 if b.name == "weight" else 1.0)}
    ),
    "gravity downwards": lambda m: m.model_copy(update={"gravity_direction": (0.0, -1.0)}),
    "no gravity": lambda m: m.model_copy(update={"gravity": 0.0}),
    "armature dropped": without(tb.RotorInertia),
    "armature doubled": changed(tb.RotorInertia, inertia=2.0),
    "damping of the hinge dropped": changed(tb.RotationalSpringDamper, damping=0.0),
    "spring of the hinge doubled": changed(tb.RotationalSpringDamper, stiffness=2.0),
    "springref of the hinge ignored": changed(tb.RotationalSpringDamper, rest_angle=0.0),
    "sign of springref": changed(tb.RotationalSpringDamper, rest_angle=-1.0),
    "damping of the slide dropped": changed(SlideSpringDamper, damping=0.0),
    "spring of the slide dropped": changed(SlideSpringDamper, stiffness=0.0),
    "springref of the slide ignored": changed(SlideSpringDamper, rest_position=0.0),
    "sign of the motor": changed(SlideSpringDamper, force=-1.0),
    "gear squared": changed(SlideSpringDamper, force=3.0),
    "servo without its target": without(tb.ConstantTorque),
    "sign of the servo's target": changed(tb.ConstantTorque, torque=-1.0),
    "actuators dropped": without(SlideSpringDamper),
    "pins elsewhere": changed_parts("joints", child_point=shifted(0.01)),
    "sense of the slide": changed_parts("joints", axis=lambda axis: (-axis[0], -axis[1])),
    "limits of the hinge without ref": changed_parts("stops", limit=shifted(0.1)),
    "limits the other way round": changed_parts("stops", sense=lambda sense: -sense),
    "limits of the slide without ref": changed_parts("stops", offset=shifted(-0.2)),
    "sites elsewhere": changed_parts("markers", point=shifted(0.1)),
}


@pytest.mark.parametrize("mistake", MISTAKES)
def test_a_wrong_reading_is_refused(mistake: str) -> None:
    read: Any = read_model_file(CART, ModelStart(keyframe="leaning"))
    assert largest_difference(read)[0] < 1e-12
    wrong = dataclasses.replace(read, mechanism=MISTAKES[mistake](read.mechanism))
    with pytest.raises(tb.SimulationError, match="was not read rightly"):
        largest_difference(wrong)


@pytest.mark.parametrize("factor", [2.0, 1.0 + 1e-8])
def test_a_mass_that_changes_no_acceleration_is_refused(factor: float) -> None:
    """Gravity alone moves a pendulum of any mass alike."""
    text = (
        '<mujoco><worldbody><body><joint type="hinge" axis="0 1 0"/>'
        '<geom type="capsule" fromto="0 0 0 1 0 0" size=".05"/></body></worldbody></mujoco>'
    )
    read: Any = read_model_file(text)
    heavier = changed_bodies(
        read.mechanism, lambda b: {"mass": factor * b.mass, "inertia": factor * b.inertia}
    )
    with pytest.raises(tb.SimulationError, match="the mass matrix"):
        largest_difference(dataclasses.replace(read, mechanism=heavier))


@pytest.mark.parametrize("margin", [0.0, 0.05])
def test_a_limit_holds_a_joint_at_its_margin(margin: float) -> None:
    """A mass that is pushed onto a limit comes to rest where MuJoCo's comes to rest."""
    text = (
        '<mujoco><option integrator="RK4" timestep="1e-3" gravity="3 0 0"/><worldbody><body>'
        f'<joint name="s" type="slide" axis="1 0 0" range="-1 0.4" limited="true" margin="{margin}"'
        ' solimplimit="0.9999 0.9999 0.001 0.5 2"/>'
        '<geom size="0.1" mass="1"/></body></worldbody></mujoco>'
    )
    model = MODEL.MjModel.from_xml_string(text)
    data = MODEL.MjData(model)
    MODEL.mj_step(model, data, nstep=3000)
    read = tb.from_mjcf(text)
    rests = solve(tb.Problem(read, duration=3.0, stop_law="unilateral")).motion(np.array([3.0]))
    # The impedance lets through 1e-4 of the push: 3e-4 m/s^2 at a time constant of 0.02 s
    assert float(rests.q[0, 0]) == pytest.approx(float(data.qpos[0]), abs=1e-6)


def test_a_loop_that_closes_elsewhere_is_refused() -> None:
    read: Any = read_model_file(CART, ModelStart(keyframe="leaning"))
    (rod,) = read.mechanism.loop_joints
    others = tuple(joint for joint in read.mechanism.joints if joint.name != rod.name)
    moved = rod.model_copy(update={"parent_point": (rod.parent_point[0], 0.0)})
    wrong = read.mechanism.model_copy(update={"joints": (*others, moved)})
    with pytest.raises(tb.SimulationError, match="rod"):
        largest_difference(dataclasses.replace(read, mechanism=wrong))


def test_a_keyframe_and_what_is_given_beside_it() -> None:
    at_key = tb.from_mjcf(CART, keyframe="leaning")
    assert at_key == tb.from_mjcf(CART, keyframe=0)
    assert at_key == tb.from_mjcf(
        CART, qpos=[0.4, 0.3, 0.1], qvel=[0.1, 0.2, 0.0], ctrl=[0.7, -0.2]
    )
    start = dict(zip(at_key.coordinates, at_key.start, strict=True))
    assert start["slider"] == 0.4
    # The pole's axis is against the plane's normal: clockwise is negative; `ref` is its zero.
    assert start["hinge"] == pytest.approx(-(0.3 - 0.1))
    still = tb.from_mjcf(CART, keyframe="leaning", qvel=[0.0, 0.0, 0.0])
    assert still.start == at_key.start
    assert not any(still.start_speeds)


def test_a_compiled_model_is_read_and_stays_as_it_is() -> None:
    model = MODEL.MjModel.from_xml_string(CART)
    flags, limited = int(model.opt.disableflags), model.jnt_limited.tolist()
    read = tb.from_mjcf(model, without=("limits",))
    assert not read.stops
    assert (int(model.opt.disableflags), model.jnt_limited.tolist()) == (flags, limited)


def coordinates_of(mechanism: tb.Mechanism) -> list[tuple[str, int]]:
    """The body that each coordinate moves, as MJCF names it, and its slide; -1: its angle."""
    turning = [(body.name, -1) for body in mechanism.bodies if body.angle is not None]
    sliding = [(j.child, k) for j in mechanism.tree_joints for k in range(len(j.slides))]
    return [(name.replace(" ", "_"), k) for name, k in turning + sliding]


# Written with contacts of geoms, which are left out when they are read
WITH_CONTACTS = {
    "slider-crank", "singular-slider-crank", "trammel", "quick-return", "bouncing", "falling-rod",
    "hinged", "floating-arm",
}  # fmt: skip


@pytest.mark.parametrize("name", sorted({*MACHINES, *tb.problems()}))
def test_what_is_written_is_read_again(name: str, tmp_path: Path) -> None:
    """The same mass matrix, loops and accelerations, but for what contacts stand for."""
    mechanism = mechanism_of(tb.problem(name) if name in tb.problems() else tb.model(name))
    path = tmp_path / "written.xml"
    path.write_text(tb.mjcf(name))
    read: Any = read_model_file(path)
    assert bool(read.left_out) is (name in WITH_CONTACTS)
    again = read.mechanism
    assert again.coordinates and len(again.coordinates) == len(mechanism.coordinates)
    # The written model's zero is the start; its bodies stand branch by branch.
    order = [coordinates_of(again).index(each) for each in coordinates_of(mechanism)]
    turned = np.random.default_rng(5).uniform(-1, 1, len(mechanism.coordinates))
    moved = np.empty_like(turned)
    moved[order] = turned
    free, free_again = (
        Equations(m.model_copy(update={"joints": m.tree_joints, "stops": ()}))
        for m in (mechanism, again)
    )
    q, q_again = np.array(mechanism.start) + turned, np.array(again.start) + moved
    for ours, expected in (
        (free_again.mass_matrix(q_again)[np.ix_(order, order)], free.mass_matrix(q)),
        (free_again.solve(q_again, moved, ())[0][order], free.solve(q, turned, ())[0]),
    ):
        assert ours == pytest.approx(expected, rel=1e-10, abs=1e-11 * np.abs(expected).max())
    if name not in WITH_CONTACTS:
        assert len(again.loop_joints) == len(mechanism.loop_joints)


def test_a_file_is_a_model_wherever_one_is_taken(tmp_path: Path) -> None:
    path = tmp_path / "arm.xml"
    path.write_text(RandomModel(2, "xz").text(2))
    found = tb.compare(path, engines="mujoco", presets="settings", duration=0.1)
    assert len(found.to_dataframe()) > 0
    assert tb.prove(str(path), digits=5, until=0.05).digits == 5


@pytest.mark.parametrize("command", ["compare", "run", "prove"])
def test_a_command_starts_a_file_as_it_is_told(
    command: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path, out = tmp_path / "gears.xml", tmp_path / "out"
    path.write_text(GEARS)
    start, quick = ["--qpos", "0.23,0.1,0.1575"], ["--until", "0.02", "--quiet"]
    words = {
        "compare": ["--models", str(path), "--engines", "mujoco", "--no-diagnose", *quick],
        "run": ["--engine", "mujoco", "--model", str(path), *quick],
        "prove": [str(path), "--digits", "5", *quick],
    }[command]
    arguments = [command, *words, "--out", str(out)]
    assert main([*arguments, *start]) in (0, 1)
    capsys.readouterr()
    # Its own start is not on its equalities.
    assert main(arguments) == 2
    assert "gear" in capsys.readouterr().err


def test_a_start_is_refused_for_what_has_its_own(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["compare", "--models", "fixed", "--qpos", "0,1"]) == 2
    assert "0,1" in capsys.readouterr().err


def inline(body: str, extra: str = "") -> str:
    """A file with a body."""
    return (
        '<mujoco model="m"><compiler angle="radian" autolimits="true"/>'
        f'<worldbody><body name="b">{body}<geom size="0.1"/></body></worldbody>{extra}</mujoco>'
    )


HINGE = '<joint name="j" type="hinge" axis="0 1 0"/>'


def two_hinges(equality: str, tendons: str = "") -> str:
    """A double pendulum with an equality."""
    hinge = HINGE.replace('"j"', '"k"')
    inner = f'<body name="c">{hinge}<geom size="0.1"/><site name="on c" pos="1 0 0"/></body>'
    return inline(f'{HINGE}<site name="on b"/>{inner}', f"{tendons}<equality>{equality}</equality>")


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (inline("<freejoint/>"), "free joint"),
        (inline('<joint type="ball"/>'), "ball joint"),
        (inline(HINGE + '<joint name="k" type="hinge" axis="1 0 0"/>'), "'k'"),
        (inline(HINGE + '<joint name="k" type="slide" axis="0 1 0"/>'), "'k'"),
        (inline(""), "no joint"),
        (inline(HINGE.replace("/>", ' frictionloss="1"/>')), "--without friction-loss"),
        (inline(HINGE, '<option density="1"/>'), "--without fluid"),
        (
            inline(
                HINGE.replace("/>", ' actuatorfrcrange="-1 1"/>'),
                '<actuator><position joint="j"/></actuator>',
            ),
            "limits the force of its actuators.*--without actuators",
        ),
        (inline(HINGE + HINGE.replace('"j"', '"k"')), "'k'"),
        (
            inline(HINGE, '<actuator><general joint="j" dyntype="integrator"/></actuator>'),
            "activation",
        ),
        (
            two_hinges('<joint name="e" joint1="j" joint2="k" polycoef="0 1 0.5 0 0"/>'),
            "'e' is not linear",
        ),
        (
            two_hinges(
                '<tendon name="e" tendon1="t"/>',
                '<tendon><fixed name="t"><joint joint="j" coef="0"/></fixed></tendon>',
            ),
            "'e' holds nothing that moves",
        ),
        (
            two_hinges(
                '<tendon name="e" tendon1="t"/>',
                '<tendon><spatial name="t"><site site="on b"/><site site="on c"/></spatial>'
                "</tendon>",
            ),
            "'e' is of a tendon between sites",
        ),
    ],
)
def test_what_no_mechanism_has_is_refused_by_name(text: str, message: str) -> None:
    with pytest.raises(tb.UnsupportedProblemError, match=message):
        tb.from_mjcf(text)


@pytest.mark.parametrize(
    ("how", "message"),
    [
        ({"qpos": [0.0, 0.0]}, "2 values"),
        ({"qpos": [math.nan]}, "finite"),
        ({"ctrl": [1.0]}, "ctrl"),
        ({"keyframe": "home"}, "no keyframe"),
        ({"without": ("gravity",)}, "'gravity'"),
        ({"qpos": [2.0]}, "beyond a limit"),
    ],
)
def test_a_start_that_is_not_valid_is_refused(how: dict[str, Any], message: str) -> None:
    text = inline(HINGE.replace("/>", ' range="-1 1"/>'))
    with pytest.raises(tb.InputError, match=message):
        tb.from_mjcf(text, **how)


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b"", "empty|cannot read"),
        (b"<mujoco><worldbody>", "cannot read"),
        (b'<mujoco><include file="bad.xml"/></mujoco>', "cannot read"),
        (b'<mujoco><asset><mesh file="no.stl"/></asset></mujoco>', "cannot read"),
        (b"<svg/>", "cannot read"),
        (b"\0" * 21_000_000, "at most 20 MB"),
    ],
)
def test_a_file_that_is_none_is_refused(content: bytes, message: str, tmp_path: Path) -> None:
    path = tmp_path / "bad.xml"
    path.write_bytes(content)
    with pytest.raises(tb.InputError, match=message):
        tb.from_mjcf(path)
    with pytest.raises(tb.InputError):
        tb.from_mjcf(tmp_path / "missing.xml")


def test_a_urdf_is_read(tmp_path: Path) -> None:
    path = tmp_path / "arm.urdf"
    path.write_text(
        '<robot name="arm"><link name="base"/><link name="upper"><inertial>'
        '<origin xyz="0 0 -0.3"/><mass value="2"/>'
        '<inertia ixx="0.1" iyy="0.1" izz="0.02" ixy="0" ixz="0" iyz="0"/></inertial></link>'
        '<joint name="shoulder" type="continuous"><parent link="base"/><child link="upper"/>'
        '<axis xyz="1 0 0"/><dynamics damping="0.3"/></joint></robot>'
    )
    mechanism = tb.from_mjcf(path)
    assert mechanism.coordinates == ("shoulder",)
    assert mechanism.bodies[0].mass == 2.0


def test_a_joint_of_a_urdf_that_mimics_another_is_coupled(tmp_path: Path) -> None:
    """shoulder = a and elbow = 0.1 - 2 a, relative to the upper link: absolutely 0.1 - a."""
    link = (
        '<inertial><origin xyz="0 0 -0.3"/><mass value="2"/>'
        '<inertia ixx="0.1" iyy="0.1" izz="0.02" ixy="0" ixz="0" iyz="0"/></inertial>'
    )
    text = (
        f'<robot name="arm"><link name="base"/><link name="upper">{link}</link>'
        f'<link name="lower">{link}</link><joint name="shoulder" type="continuous">'
        '<parent link="base"/><child link="upper"/><axis xyz="1 0 0"/></joint>'
        '<joint name="elbow" type="continuous"><origin xyz="0 0 -0.6"/><parent link="upper"/>'
        '<child link="lower"/><axis xyz="1 0 0"/>'
        '<mimic joint="shoulder" multiplier="-2" offset="0.1"/></joint></robot>'
    )
    path = tmp_path / "arm.urdf"
    path.write_text(text)
    compiled = MODEL.MjModel.from_xml_string(text)
    if not compiled.neq:  # older versions of MuJoCo
        with pytest.raises(tb.UnsupportedProblemError, match="mimic"):
            tb.from_mjcf(path)
        return
    mechanism = tb.from_mjcf(path, qpos=[0.3, 0.1 - 0.6])
    (coupler,) = mechanism.couplers
    assert coupler.coordinates == ("elbow", "shoulder")
    sense = 1.0 if mechanism.start[0] > 0 else -1.0
    assert coupler.terms[0].ratio == pytest.approx(-1.0, rel=1e-12)
    assert coupler.offset == pytest.approx(sense * 0.1, rel=1e-12)


ARM = """
<mujoco model="arm">
  <option timestep="0.01" integrator="RK4"/>
  <worldbody>
    <body name="cart">
      <joint name="rail" type="slide" axis="-1 0 0" damping="0.2"/>
      <geom type="sphere" size="0.1" mass="1" contype="0" conaffinity="0"/>
      <body name="rod" pos="0 0 0.1">
        <joint name="hinge" axis="0 -1 0" damping="0.05" ref="0.2"/>
        <geom type="capsule" fromto="0 0 0 0.2 0 0.7" size="0.03" mass="0.5" contype="0"
              conaffinity="0"/>
      </body>
    </body>
  </worldbody>
  <tendon>
    <fixed name="both"><joint joint="rail" coef="0.5"/><joint joint="hinge" coef="-2"/></fixed>
  </tendon>
  <actuator>
    <motor name="push" joint="rail" gear="-3" ctrllimited="true" ctrlrange="-1 1"/>
    <position name="servo" joint="hinge" gear="1.5" kp="4" kv="0.3"/>
    <motor name="pull" tendon="both" gear="0.8" forcelimited="true" forcerange="-0.4 0.4"/>
  </actuator>
</mujoco>
"""


def recorded(seed: int = 3) -> ControlRecord:
    """Controls of the arm, some beyond their ranges, at unequal times."""
    rng = np.random.default_rng(seed)
    times = np.concatenate([[0.0], 0.02 * np.sort(rng.choice(np.arange(1, 50), 20, replace=False))])
    return ControlRecord(times, rng.uniform(-1.5, 1.5, (21, 3)))


def test_recorded_controls_move_the_mechanism_as_they_move_the_file() -> None:
    """RK4's error falls by 2^4 with half the step, and its limit is the reference."""
    start = ModelStart(ctrl=recorded(), qpos=[0.1, 0.5])
    read: Any = read_model_file(ARM, start)
    reference = tb.solve(read.mechanism, 1.0, stop_law="unilateral").q(np.linspace(0, 1, 101))
    found = list[Any]()
    for every in (2, 4, 8):
        options = dataclasses.replace(read.options, timestep=0.01 / every)
        found.append(read.moved(1.0, options).q[::every] - reference)
    coarse, middle, fine = (float(np.abs(error).max()) for error in found)
    assert coarse / middle == pytest.approx(16, rel=0.2)
    assert middle / fine == pytest.approx(16, rel=0.2)
    assert float(np.abs(found[2] + (found[2] - found[1]) / 15).max()) < 1e-9


def test_controls_are_read_from_files_by_the_names_of_their_actuators(tmp_path: Path) -> None:
    record = recorded()
    record.save(tmp_path / "controls.npz")
    lines = ["t,pull,push,servo"]
    for t, (push, servo, pull) in zip(record.times.tolist(), record.values.tolist(), strict=True):
        lines.append(f"{t!r},{pull!r},{push!r},{servo!r}")
    (tmp_path / "controls.csv").write_text("\n".join(lines))
    expected = tb.from_mjcf(ARM, ctrl=record)
    for name in ("controls.npz", "controls.csv"):
        assert tb.from_mjcf(ARM, ctrl=tmp_path / name) == expected


def _late(times: tuple[float, ...], values: tuple[float, ...]) -> tuple[float, ...]:
    return (values[0], *values[:-1])


def _smooth(times: tuple[float, ...], values: tuple[float, ...]) -> tuple[float, ...]:
    return tuple((a + b) / 2 for a, b in zip(values, (*values[1:], values[-1]), strict=True))


RECORD_MISTAKES: dict[str, Callable[[Any, Any], tuple[float, ...]]] = {
    "one period late": _late,
    "interpolated": _smooth,
    "turned round": lambda _, values: tuple(-value for value in values),
    "gear squared": lambda _, values: tuple(3 * value for value in values),
    "one value lost": lambda _, values: (*values[:7], values[6], *values[8:]),
    "the first value throughout": lambda _, values: (values[0],) * len(values),
}


@pytest.mark.parametrize("kind", [tb.RecordedTorque, tb.RecordedForce])
@pytest.mark.parametrize("mistake", RECORD_MISTAKES)
def test_a_record_that_was_read_wrongly_is_refused(mistake: str, kind: type) -> None:
    read: Any = read_model_file(ARM, ModelStart(ctrl=recorded()))
    elements = list[Any]()
    for each in read.mechanism.force_elements:
        wrong = each
        if type(each) is kind:
            values = RECORD_MISTAKES[mistake](each.times, each.efforts)
            wrong = each.model_copy(update={each.values: values})
        elements.append(wrong)
    mechanism = read.mechanism.model_copy(update={"force_elements": tuple(elements)})
    with pytest.raises(tb.SimulationError, match="was not read rightly"):
        largest_difference(dataclasses.replace(read, mechanism=mechanism))


def test_actuators_without_a_name_are_numbered(tmp_path: Path) -> None:
    nameless = ARM.replace('name="push" ', "").replace('name="servo" ', "")
    path = tmp_path / "controls.csv"
    path.write_text("t,pull,actuator 1,actuator 0\n0,0.1,0.2,0.3\n0.5,0.4,0.5,0.6\n")
    expected = ControlRecord([0.0, 0.5], [[0.3, 0.2, 0.1], [0.6, 0.5, 0.4]])
    assert tb.from_mjcf(nameless, ctrl=path) == tb.from_mjcf(nameless, ctrl=expected)


def test_a_record_that_never_changes_is_a_constant_control() -> None:
    held = ControlRecord(np.array([0.0, 0.5]), np.full((2, 3), 0.3))
    constant = tb.from_mjcf(ARM, ctrl=[0.3, 0.3, 0.3])
    assert tb.from_mjcf(ARM, ctrl=held).content_hash == constant.content_hash


def test_an_audit_replays_controls(tmp_path: Path) -> None:
    recorded().save(tmp_path / "controls.npz")
    found = tb.audit(ARM, 0.5, ctrl=tmp_path / "controls.npz", engines=("exudyn",))
    assert found.given.error is not None and found.given.error < 1e-4
    (other,) = found.engines  # late by half a step of 0.1 ms, at some 1 m/s
    assert other.error is not None and other.error < 1e-3


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ("t,push,servo\n0,1,2\n", "actuators of 'arm' are push, servo, pull"),
        ("t,push,servo,grip\n0,1,2,3\n", "grip"),
        ("t,push,servo,pull\n0,1,2\n", "row 2"),
        ("t,push,servo,pull\n0,1,2,x\n", "'x'"),
        ("t,push,servo,pull\n0,1,2,nan\n", "nan"),
        ("t,push,servo,pull\n0.1,1,2,3\n", "0.1"),
        ("t,push,servo,pull\n0,1,2,3\n0,1,2,3\n", "0.0 s follows"),
        ("t,push,servo,pull\n", "shape"),
        ("push,servo,pull\n1,2,3\n", "first line"),
        ("", "first line"),
    ],
)
def test_a_file_of_controls_that_is_none_is_refused(
    content: str, message: str, tmp_path: Path
) -> None:
    path = tmp_path / "controls.csv"
    path.write_text(content)
    with pytest.raises(tb.InputError) as raised:
        tb.from_mjcf(ARM, ctrl=path)
    assert message in str(raised.value) and "controls.csv" in str(raised.value)


def test_an_archive_that_holds_no_controls_is_refused(tmp_path: Path) -> None:
    (tmp_path / "broken.npz").write_bytes(b"PK\x03\x04 not an archive")
    np.savez(tmp_path / "other.npz", t=np.zeros(1))
    np.savez(tmp_path / "few.npz", t=np.zeros(1), ctrl=np.zeros((1, 2)))
    for name, message in (("broken", "no NPZ"), ("other", "'ctrl'"), ("few", "3 actuators")):
        with pytest.raises(tb.InputError) as raised:
            tb.from_mjcf(ARM, ctrl=tmp_path / f"{name}.npz")
        assert message in str(raised.value)


def two_links(tendon: str = "", actuator: str = "", equality: str = "", option: str = "") -> str:
    """Two links with a point at the tip, and a post; hinges turn in opposite senses."""
    return f"""
<mujoco model="links">
  <compiler angle="radian" autolimits="true"/>
  <option gravity="1 0 -9.81"/>
  <worldbody>
    <site name="post" pos="0.4 0 1.2"/>
    <site name="beside" pos="0.4 0.1 1.2"/>
    <body name="upper" pos="0 0 1">
      <joint name="one" axis="0 1 0" ref="0.1"/>
      <geom type="capsule" fromto="0 0 0 0.5 0 0.1" size="0.03" mass="1" contype="0"
            conaffinity="0"/>
      <site name="elbow" pos="0.3 0 0.05"/>
      <body name="lower" pos="0.5 0 0.1">
        <joint name="two" axis="0 -1 0"/>
        <geom type="capsule" fromto="0 0 0 0.4 0 0.2" size="0.03" mass="0.6" contype="0"
              conaffinity="0"/>
        <site name="tip" pos="0.4 0 0.2" euler="0 0.3 0"/>
      </body>
    </body>
  </worldbody>
  <tendon>{tendon}</tendon>
  <actuator>{actuator}</actuator>
  <equality>{equality}</equality>
</mujoco>"""


SUM = '<joint joint="one" coef="-2"/><joint joint="two" coef="2"/>'
TENDONS = {
    "of one hinge": (
        '<fixed name="t" stiffness="3" damping="0.2" springlength="0.4"><joint joint="two" '
        'coef="-1.5"/></fixed>',
        tb.RotationalSpringDamper,
    ),
    "of the angle of the lower link": (
        f'<fixed name="t" stiffness="3" damping="0.2" springlength="0.4">{SUM}</fixed>',
        tb.RotationalSpringDamper,
    ),
    "between a body and the post": (
        '<spatial name="t" stiffness="30" damping="0.2" springlength="0.3"><site site="post"/>'
        '<site site="tip"/></spatial>',
        tb.SpringDamper,
    ),
    "between two bodies": (
        '<spatial name="t" stiffness="30" springlength="0.1"><site site="elbow"/><site site="tip"/>'
        "</spatial>",
        tb.SpringDamper,
    ),
}


@pytest.mark.parametrize("name", TENDONS)
def test_springs_and_dampers_of_tendons_are_read(name: str) -> None:
    """Held against MuJoCo's accelerations; without the element they would differ."""
    text, kind = TENDONS[name]
    read: Any = read_model_file(two_links(text))
    assert [type(each) for each in read.mechanism.force_elements] == [kind]
    wrong = dataclasses.replace(read, mechanism=without(kind)(read.mechanism))
    with pytest.raises(tb.SimulationError, match="acceleration"):
        largest_difference(wrong)


@pytest.mark.parametrize("margin", [0.0, 0.05])
def test_a_limit_of_a_tendon_is_one_of_an_angle(margin: float) -> None:
    """The stop stands where the lower link's own angle has the limit's length."""
    text = two_links(f'<fixed name="t" range="-1 0.5" margin="{margin}">{SUM}</fixed>')
    read: Any = read_model_file(text)
    stops, kinematics = read.mechanism.stops, Kinematics(read.mechanism)
    assert [stop.name for stop in stops] == ["t lower limit", "t upper limit"]
    for stop, side, bound in zip(stops, (1, -1), (-1.0, 0.5), strict=True):
        qpos = np.array([[0.2, 0.3], [-0.4, 0.1]])
        expected = side * (qpos @ [-2.0, 2.0] - (bound + side * margin)) / 2
        assert kinematics.gap(stop.name, read.coordinates(qpos)) == pytest.approx(expected)


@pytest.mark.parametrize("kind", ["connect", "weld"])
def test_sites_that_coincide_close_a_loop(kind: str) -> None:
    read: Any = read_model_file(
        two_links(equality=f'<{kind} name="loop" site1="tip" site2="post"/>')
    )
    (joint,) = read.mechanism.loop_joints
    assert joint.kind == ("pin" if kind == "connect" else "weld")


def test_a_constant_force_on_a_site_is_read() -> None:
    pushed = two_links(
        actuator='<motor name="wind" site="tip" refsite="post" gear="2 0 -1 0 0 0"/>'
    )
    read: Any = read_model_file(pushed, ModelStart(ctrl=[1.5]))
    (force,) = read.mechanism.force_elements
    assert force.force == pytest.approx((3.0, -1.5))


@pytest.mark.parametrize(
    ("how", "message"),
    [
        (
            {"tendon": f'<fixed name="t" stiffness="3">{SUM.replace("2", "1", 1)}</fixed>'},
            "no angle",
        ),
        (
            {"tendon": f'<fixed name="t" stiffness="3" springlength="0.1 0.3">{SUM}</fixed>'},
            "slack between two lengths",
        ),
        (
            {
                "tendon": '<spatial name="t" stiffness="3" springlength="1"><site site="beside"/>'
                '<site site="tip"/></spatial>'
            },
            "leaves the plane",
        ),
        (
            {
                "tendon": '<spatial name="t" range="0 1"><site site="post"/><site site="tip"/>'
                "</spatial>"
            },
            "--without tendons",
        ),
        (
            {
                "tendon": '<spatial name="t" damping="1"><site site="post"/><site site="elbow"/>'
                '<site site="tip"/></spatial>'
            },
            "bent line",
        ),
        ({"actuator": '<motor name="m" site="tip" gear="1 0 0 0 0 0"/>'}, "a direction that moves"),
        (
            {"actuator": '<motor name="m" site="tip" refsite="post" gear="0 1 0 0 0 0"/>'},
            "in the plane",
        ),
    ],
)
def test_tendons_and_forces_that_are_none_here_are_refused(
    how: dict[str, str], message: str
) -> None:
    with pytest.raises(tb.UnsupportedProblemError) as raised:
        read_model_file(two_links(**how), ModelStart(ctrl=[1.0] if "actuator" in how else None))
    assert message in str(raised.value)


GEARS = """<mujoco model="gears">
  <compiler angle="radian"/>
  <option timestep="0.0005" integrator="RK4"/>
  <worldbody>
    <body name="a">
      <joint name="a" axis="0 -1 0" ref="0.3"/>
      <inertial pos="0.3 0 0" mass="2" diaginertia="0.1 0.2 0.1"/>
      <body name="b" pos="1 0 0">
        <joint name="b" axis="0 1 0"/>
        <inertial pos="0 0 0.4" mass="1" diaginertia="0.1 0.2 0.1"/>
        <body name="c" pos="0 0 1">
          <joint name="s" type="slide" axis="0.6 0 0.8" ref="0.2"/>
          <inertial pos="0 0 0" mass="3" diaginertia="0.1 0.2 0.1"/>
        </body>
      </body>
    </body>
  </worldbody>
  <tendon>
    <fixed name="rope"><joint joint="a" coef="0.5"/><joint joint="s" coef="-2"/></fixed>
  </tendon>
  <equality>
    <joint name="gear" joint1="a" joint2="b" polycoef="0.1 -1.7 0 0 0" solref="0.001 1"
           solimp="0.9999 0.9999 0.001"/>
    <tendon name="rack" tendon1="rope" polycoef="0.05 0 0 0 0" solref="0.001 1"
            solimp="0.9999 0.9999 0.001"/>
  </equality>
</mujoco>"""
# a - 0.3 = 0.1 - 1.7 b, and 0.5 (a - 0.3) - 2 (s - 0.2) = 0.05
GEARED = ModelStart(qpos=[0.23, 0.1, 0.1575])


def test_equalities_of_joints_and_tendons_are_couplers() -> None:
    read: Any = read_model_file(GEARS, GEARED)
    mechanism = read.mechanism
    assert [coupler.name for coupler in mechanism.couplers] == ["gear", "rack"]
    assert largest_difference(read)[0] < 1e-12
    run = read.moved(0.5, read.options)
    moved = solve(tb.Problem(mechanism, 0.5)).motion(run.t)
    # MuJoCo's equalities give way by 1e-4 of what they are asked to hold, at rates of some 10 /s.
    assert run.q == pytest.approx(moved.q, abs=2e-3)
    free = mechanism.model_copy(update={"couplers": ()})
    assert np.abs(run.q - solve(tb.Problem(free, 0.5)).motion(run.t).q).max() > 0.1


@pytest.mark.parametrize(
    "mistake",
    [
        lambda c: c.model_copy(update={"offset": 0.0}),
        lambda c: c.model_copy(update={"offset": c.offset * (1 + 1e-7)}),
        lambda c: c.model_copy(
            update={"terms": tuple(t.model_copy(update={"ratio": -t.ratio}) for t in c.terms)}
        ),
        lambda c: c.model_copy(update={"terms": ()}),
        lambda c: c.model_copy(update={"name": "other"}),
        None,
    ],
    ids=["no offset", "offset", "sense", "no terms", "name", "dropped"],
)
@pytest.mark.parametrize("which", [0, 1])
def test_a_coupler_that_was_read_wrongly_is_refused(mistake: Any, which: int) -> None:
    read: Any = read_model_file(GEARS, GEARED)
    couplers = list(read.mechanism.couplers)
    changed = [] if mistake is None else [mistake(couplers[which])]
    couplers[which : which + 1] = changed
    mechanism = read.mechanism.model_copy(update={"couplers": tuple(couplers)})
    with pytest.raises(tb.SimulationError, match="was not read rightly"):
        largest_difference(dataclasses.replace(read, mechanism=mechanism))


@pytest.mark.parametrize("group", ["stops", "joints"])
def test_what_was_dropped_is_missed(group: str) -> None:
    """A limit, or the joint that closes the loop."""
    read: Any = read_model_file(CART, ModelStart(keyframe="leaning"))
    kept = getattr(read.mechanism, group)[:-1]
    mechanism = read.mechanism.model_copy(update={group: kept})
    with pytest.raises(tb.SimulationError, match="was not read rightly"):
        largest_difference(dataclasses.replace(read, mechanism=mechanism))


def test_a_written_coupler_is_read_again(tmp_path: Path) -> None:
    mechanism, path = geared(), tmp_path / "written.xml"
    path.write_text(tb.mjcf(mechanism))
    again = tb.from_mjcf(path)
    assert len(again.couplers) == len(mechanism.couplers)
    one, other = (
        Equations(each).solve(np.array(each.start), np.zeros(3), ())[0]
        for each in (mechanism, again)
    )
    assert other == pytest.approx(one, rel=1e-11)
