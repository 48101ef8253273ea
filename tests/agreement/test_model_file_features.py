"""Features of model files beside their mechanics: drives, flags, masses, starts, and what is named.

What is read is held against MuJoCo's mass matrix and accelerations by the reader itself.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pytest
import trebucheck as tb
from trebucheck.cli.app import main
from trebucheck.comparisons.runs.model_files import read_model_file
from trebucheck.engines.study import ModelStart
from trebucheck.reference.solver import solve

LINK = (
    '<geom type="capsule" fromto="0 0 0 0.1 0 -0.5" size="0.02" mass="1" contype="0" '
    'conaffinity="0"/>'
)


def links(
    joint: str = "", inner: str = LINK, body: str = "", actuator: str = "", more: str = ""
) -> str:
    """Two links; the fields are those of the first joint, and of the second body."""
    return (
        f'<mujoco model="links"><compiler autolimits="true"/>{more}<worldbody>'
        f'<body name="upper" pos="0 0 1"><joint name="one" axis="0 1 0" {joint}/>{LINK}'
        f'<body name="lower" pos="0.1 0 -0.5" {body}><joint name="two" axis="0 1 0"/>{inner}'
        f'</body></body></worldbody><actuator>{actuator}</actuator></mujoco>'
    )  # fmt: skip


def elements_of(text: str, **how: Any) -> dict[str, Any]:
    """Force elements by their names."""
    return {each.name: each for each in tb.from_mjcf(text, **how).force_elements}


def test_inertia_and_damping_of_a_drive_are_read() -> None:
    """They act at the joint by the square of the gear, whether the actuator is disabled or not."""
    motor = '<motor name="m" joint="one" gear="3" armature="0.1" damping="0.2" {}/>'
    disabled = '<option><flag actuation="disable"/></option>'
    for text in (
        links(actuator=motor.format("")),
        links(actuator=motor.format('forcerange="-1 1"'), more=disabled),
    ):
        found = elements_of(text)
        assert found["m rotor"].inertia == pytest.approx(0.9)
        assert found["m damper"].damping == pytest.approx(1.8)
    undamped = links(actuator=motor.format(""), more='<option><flag damper="disable"/></option>')
    assert set(elements_of(undamped)) == {"m rotor"}
    assert not elements_of(links(actuator=motor.format("")), without=("actuators",))


def test_a_drive_that_is_nonlinear_or_of_several_joints_is_refused() -> None:
    poly = links(actuator='<motor name="m" joint="one" damping="0.2 0.1"/>')
    several = links(actuator='<motor name="m" tendon="t" armature="0.1"/>').replace(
        "<actuator>",
        '<tendon><fixed name="t"><joint joint="one" coef="1"/><joint joint="two" coef="2"/></fixed>'
        "</tendon><actuator>",
    )
    for text in (poly, several):
        with pytest.raises(tb.UnsupportedProblemError, match=r"'m'.*--without actuators"):
            tb.from_mjcf(text)


def test_what_tendons_and_delays_have_is_left_out_with_them() -> None:
    motor = '<motor name="m" joint="one" delay="0.01" nsample="3"/>'
    text = links(actuator=motor).replace(
        "<actuator>",
        '<tendon><fixed name="t" armature="0.2"><joint joint="one" coef="1"/>'
        '<joint joint="two" coef="2"/></fixed></tendon><actuator>',
    )
    for without in ((), ("actuators",), ("tendons",)):
        with pytest.raises(tb.UnsupportedProblemError, match=r"delay|'t' has an armature"):
            tb.from_mjcf(text, without=without)
    read = read_model_file(text, ModelStart(without=("actuators", "tendons")))
    assert not read.mechanism.force_elements
    assert sum("'t'" in what or "'m'" in what for what in read.left_out) == 2


def test_actuators_of_a_disabled_group_do_nothing() -> None:
    servos = (
        '<position name="a" joint="one" kp="4" group="1"/>'
        '<position name="b" joint="two" kp="5" group="2"/>'
    )
    text = links(actuator=servos, more='<option actuatorgroupdisable="2"/>')
    assert list(elements_of(text)) == ["a on one"]
    # A group that is negative is none of those that can be disabled.
    negative = text.replace('group="1"', 'group="-1"').replace('disable="2"', 'disable="0 2"')
    assert list(elements_of(negative)) == ["a on one"]


def test_a_body_without_mass_has_that_of_what_is_welded_to_it() -> None:
    """As one body; the motion is that of the file whose link has the geoms itself."""
    parts = '<geom size="0.05" mass="0.4" {}/>', '<geom size="0.03" mass="0.2" {}/>'
    places = 'pos="0.05 0 0"', 'pos="0.1 0 -0.5"'
    placed = list(zip(parts, places, strict=True))
    welded = links(inner="".join(f"<body {at}>{part.format('')}</body>" for part, at in placed))
    whole = links(inner="".join(part.format(at) for part, at in placed))
    one, other = (tb.from_mjcf(text) for text in (welded, whole))
    assert [body.name for body in one.bodies] == ["upper", "lower"]
    for field in ("mass", "centre", "inertia"):
        first, second = (getattr(each.body("lower"), field) for each in (one, other))
        assert first == pytest.approx(second, rel=1e-12)


def test_a_keyframe_that_moves_a_mocap_body_is_refused() -> None:
    text = (
        '<mujoco model="m"><worldbody><body name="hand" mocap="true" pos="0 0 1">'
        f'<body name="b"><joint name="j" axis="0 1 0"/>{LINK}</body></body></worldbody><keyframe>'
        '<key name="here" qpos="0.5"/><key name="there" qpos="0.5" mquat="1 0 1 0"/></keyframe>'
        "</mujoco>"
    )
    assert tb.from_mjcf(text, keyframe="here").start == (0.5,)
    with pytest.raises(tb.UnsupportedProblemError, match=r"'there'.*'hand'"):
        tb.from_mjcf(text, keyframe="there")


def test_bodies_that_sleep_are_refused() -> None:
    with pytest.raises(tb.UnsupportedProblemError, match="sleep"):
        tb.from_mjcf(links(more='<option><flag sleep="enable"/></option>'))


def test_gravity_that_does_not_act_needs_no_compensation() -> None:
    text = links(body='gravcomp="1"', more='<option><flag gravity="disable"/></option>')
    assert tb.from_mjcf(text).gravity == 0.0
    with pytest.raises(tb.UnsupportedProblemError, match="compensation of gravity"):
        tb.from_mjcf(links(body='gravcomp="1"'))


def test_a_limit_of_actuators_matters_where_one_acts() -> None:
    limited = 'actuatorfrcrange="-1 1"'
    assert not elements_of(links(joint=limited))  # of URDF: <limit effort="1"/>
    servo = '<position name="s" joint="one" kp="4"/>'
    with pytest.raises(tb.UnsupportedProblemError, match="'one' limits the force"):
        tb.from_mjcf(links(joint=limited, actuator=servo))
    assert not elements_of(links(joint=limited, actuator=servo), without=("actuators",))


def test_a_force_on_a_site_acts_on_every_joint() -> None:
    """Also on one that limits what its actuators do to it."""
    pushed = links(
        joint='actuatorfrcrange="-1 1"',
        inner=f'{LINK}<site name="tip"/>',
        actuator='<general site="tip" refsite="there" gear="1 0 0 0 0 0"/>',
    ).replace("<worldbody>", '<worldbody><site name="there"/>')
    with pytest.raises(tb.UnsupportedProblemError, match="'one' limits the force"):
        tb.from_mjcf(pushed, ctrl=[1e-3])
    assert len(elements_of(pushed.replace('actuatorfrcrange="-1 1"', ""), ctrl=[1e-3])) == 1


def test_a_limit_of_a_tendon_limits_forces_and_no_drive() -> None:
    tendon = '<tendon><fixed name="t" actuatorfrcrange="-1 1"><joint joint="one" coef="2"/></fixed>'
    text = links(actuator='<motor name="m" tendon="t" armature="0.1"/>').replace(
        "<actuator>", f"{tendon}</tendon><actuator>"
    )
    assert elements_of(text)["m rotor"].inertia == pytest.approx(0.4)
    with pytest.raises(tb.UnsupportedProblemError, match="'t' of 'm' limits the force"):
        tb.from_mjcf(text, ctrl=[0.1])


def test_a_start_with_four_digits_may_be_at_a_limit() -> None:
    text = links(joint='range="-30 30"')
    read: Any = read_model_file(text, ModelStart(qpos=[-0.5236, 0.0]))
    assert read.qpos[0] == -np.pi / 6
    assert any("beyond its limit" in what for what in read.left_out)
    (lower, _) = read.mechanism.stops
    assert lower.closed
    with pytest.raises(tb.InputError, match="beyond a limit"):
        tb.from_mjcf(text, qpos=[-0.5240, 0.0])


def test_pairs_that_are_excluded_do_not_touch() -> None:
    touching = LINK.replace('contype="0" conaffinity="0"', "")
    text = links(inner=touching).replace(LINK, touching)
    apart = text.replace(
        "<actuator>", '<contact><exclude body1="upper" body2="lower"/></contact><actuator>'
    )
    with_contacts, without = (read_model_file(each).left_out for each in (text, apart))
    assert [what.partition(":")[0] for what in with_contacts] == ["contacts"]
    assert not without


def test_without_contacts_the_file_moves_without_them_too() -> None:
    """A link whose end always touches the world."""
    touching = LINK.replace('contype="0" conaffinity="0"', "")
    text = (
        links()
        .replace(LINK, touching, 1)
        .replace("<worldbody>", '<worldbody><geom size="0.1" pos="0.1 0 1"/>')
    )
    with pytest.raises(tb.InputError, match="touch"):
        tb.audit(text, 0.3, qpos=[0.2, 0.0], engines=())
    found = tb.audit(text, 0.3, qpos=[0.2, 0.0], without=["contacts"], engines=())
    assert found.compared_to == 0.3
    assert found.left_out and "contacts" in found.left_out[0]


def test_axes_tell_by_how_much_they_are_off() -> None:
    text = links().replace('name="two" axis="0 1 0"', 'name="two" axis="0 1 0.001"')
    with pytest.raises(tb.UnsupportedProblemError, match=r"'two'.*0\.001 rad"):
        tb.from_mjcf(text)


def test_files_whose_models_have_one_name_are_told_apart() -> None:
    """The second one is numbered, in comparisons of the file itself as well."""
    heavier = links(inner=LINK.replace('mass="1"', 'mass="2"'))
    models = [tb.from_mjcf(text, qpos=[0.5, 0.0]) for text in (links(), heavier, links())]
    results = tb.compare(
        models, ["mujoco"], ["settings", "given"], duration=0.1, diagnose=False, isolate=False
    ).results
    found = [(run.model, run.preset) for run in results.runs]
    assert found == [(m, p) for m in ("links", "links 2") for p in ("settings", "given")]
    assert all(run.outcome in ("agrees", "disagrees") for run in results.runs)
    masses = [sum(body.mass for body in machine.mechanism.bodies) for machine in results.machines]
    assert masses == pytest.approx([2.0, 3.0])


@pytest.mark.parametrize(
    "given",
    [
        {"source": None},
        {"source": b"<mujoco/>"},
        {"source": mujoco.MjSpec()},
        {"qpos": "0.1,0.2"},
        {"qpos": [[0.1, 0.2]]},
        {"qvel": [None, "x"]},
        {"ctrl": {"a": 1.0}},
        {"without": "limits"},
    ],
    ids=lambda given: f"{given}"[:30],
)
def test_what_is_of_the_wrong_kind_gets_a_sentence(given: dict[str, Any]) -> None:
    with pytest.raises(tb.InputError, match=r"must be|valid are"):
        tb.from_mjcf(**({"source": links()} | given))


def test_a_text_may_begin_with_a_byte_order_mark() -> None:
    assert tb.from_mjcf("\ufeff" + links()).bodies == tb.from_mjcf(links()).bodies


def test_a_command_reads_recorded_controls(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "m.xml").write_text(links(actuator='<motor name="m" joint="one"/>'))
    (tmp_path / "c.csv").write_text("t,m\n0,0.1\n0.5,0.4\n")
    call = ["models", "read", str(tmp_path / "m.xml"), "--ctrl"]
    assert main([*call, str(tmp_path / "c.csv"), "--out", str(tmp_path / "m.json")]) == 0
    read = tb.Mechanism.model_validate_json((tmp_path / "m.json").read_text())
    assert [each.kind for each in read.force_elements] == ["recorded-torque"]
    assert main([*call, str(tmp_path / "none.csv")]) == 2
    assert "none.csv" in capsys.readouterr().err


def test_a_drive_moves_as_mujoco_moves_it() -> None:
    """RK4 at 1 ms, h^4 of accelerations below 1e2."""
    text = links(
        actuator='<motor name="m" joint="one" gear="3" armature="0.1" damping="0.02"/>',
        more='<option integrator="RK4" timestep="0.001"/>',
    )
    start = ModelStart(qpos=[1.0, 0.3], ctrl=[0.4])
    read: Any = read_model_file(text, start)
    moved = read.moved(1.0, read.options)
    exact = solve(tb.Problem(read.mechanism, 1.0)).trajectory(moved.t)
    assert np.abs(moved.q - exact.q).max() < 1e-9
