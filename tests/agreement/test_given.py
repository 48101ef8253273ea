"""Model files moved as they are: the preset `given` of MuJoCo."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pytest
import trebucheck as tb
from trebucheck.comparisons.runs.study import Study
from trebucheck.engines.given import SteppedModel
from trebucheck.engines.mujoco.files import reread
from trebucheck.engines.mujoco.planar import MUJOCO
from trebucheck.engines.presets import GIVEN
from trebucheck.models.arrays import FloatArray
from trebucheck.models.controls import ControlRecord

# A body of two links: damped hinges, a limit that is met, a motor, its own step and integrator.
MODEL = """
<mujoco model="arm">
  <compiler angle="radian"/>
  <option timestep="0.004" integrator="{integrator}"/>
  <worldbody>
    <body name="upper">
      <joint name="shoulder" axis="0 1 0" damping="0.1"/>
      <geom type="capsule" fromto="0 0 0 0.4 0 0" size="0.03" mass="1" contype="{contype}"/>
      <body name="lower" pos="0.4 0 0">
        <joint name="elbow" axis="0 1 0" damping="0.05" limited="{limited}" range="-2 0.3"/>
        <geom type="capsule" fromto="0 0 0 0.3 0 0" size="0.02" mass="0.5" contype="{contype}"/>
        <site name="tip" pos="0.3 0 0"/>
      </body>
    </body>
    <geom name="floor" type="plane" pos="0 0 -0.5" size="1 1 1" contype="{contype}"/>
  </worldbody>
  <actuator><motor joint="shoulder" gear="2"/></actuator>
</mujoco>
"""
UNTIL = 0.4  # [s] the elbow is not at its limit yet, and nothing touches the floor
CTRL = 0.5


def _text(integrator: str = "Euler", limited: str = "false", contype: int = 0) -> str:
    return MODEL.format(integrator=integrator, limited=limited, contype=contype)


def _read(text: str = "", ctrl: object = (CTRL,)) -> tb.Mechanism:
    return tb.from_mjcf(text or _text(), qpos=[0.0, 0.2], qvel=[0.5, 0.0], ctrl=ctrl)  # type: ignore[arg-type]


def _problem(mechanism: tb.Mechanism, duration: float = UNTIL) -> tb.Problem:
    return tb.Problem(mechanism, duration=duration, stop_law=tb.StopLaw.UNILATERAL)


def test_its_states_are_those_of_mujocos_own_steps() -> None:
    mechanism = _read()
    found = tb.engine("mujoco", GIVEN).simulate(_problem(mechanism))
    model = mujoco.MjModel.from_xml_string(_text())
    data = mujoco.MjData(model)
    data.qpos[:], data.qvel[:], data.ctrl[:] = [0.0, 0.2], [0.5, 0.0], CTRL
    tips = []
    for _ in range(100):
        mujoco.mj_step(model, data)
        mujoco.mj_forward(model, data)
        tips.append(np.array(data.site("tip").xpos)[[0, 2]])
    assert len(found.t) == 101
    assert found.provenance.settings == {
        "timestep": 0.004,
        "integrator": "Euler",
        "explicit_damping": False,
        "stiff": False,
    }
    # The plane of the model is seen from the side that has its x to the right.
    assert np.abs(np.abs(found.markers["tip"].position[1:]) - np.abs(tips)).max() < 1e-12


def test_the_order_is_that_of_the_files_integrator() -> None:
    for integrator, order in (("Euler", 1), ("RK4", 4)):
        mechanism, errors = _read(_text(integrator)), list[float]()
        for step in (8e-3, 4e-3):
            found = tb.engine("mujoco", GIVEN, timestep=step).simulate(_problem(mechanism))
            right = tb.solve(_problem(mechanism)).trajectory(found.t)
            errors.append(float(np.abs(found.q - right.q).max()))
        assert np.log2(errors[0] / errors[1]) == pytest.approx(order, abs=0.3)


def test_energies_are_mujocos_and_begin_as_the_references() -> None:
    mechanism = _read()
    found = tb.engine("mujoco", GIVEN).simulate(_problem(mechanism))
    right = tb.solve(_problem(mechanism)).trajectory(found.t[:1])
    assert found.kinetic_energy[0] == pytest.approx(right.kinetic_energy[0], rel=1e-12)
    assert found.potential_energy[0] == pytest.approx(right.potential_energy[0], abs=1e-12)


def test_recorded_controls_are_replayed() -> None:
    record = ControlRecord(np.array([0.0, 0.1, 0.2]), np.array([[0.5], [-1.0], [2.0]]))
    mechanism = tb.Mechanism.from_json(_read(_text("RK4"), record).to_json())
    found = tb.engine("mujoco", GIVEN, timestep=1e-3).simulate(_problem(mechanism))
    right = tb.solve(_problem(mechanism)).trajectory(found.t)
    # Of fourth order between the changes, which are at steps.
    assert np.abs(found.q - right.q).max() < 1e-8


def test_a_mechanism_remembers_its_file(tmp_path: Path) -> None:
    path = tmp_path / "arm.xml"
    path.write_text(_text())
    mechanism = tb.from_mjcf(path, qpos=[0.0, 0.2])
    assert mechanism.source is not None and mechanism.source.path == path
    again = tb.Mechanism.from_json(mechanism.to_json())
    assert again.source == mechanism.source
    # What it is does not depend on where it came from.
    bare = mechanism.model_copy(update={"source": None})
    assert bare.content_hash == mechanism.content_hash
    assert tb.from_mjcf(_text(), qpos=[0.0, 0.2]).content_hash == mechanism.content_hash
    path.write_text(_text().replace('mass="1"', 'mass="1.1"'))
    with pytest.raises(tb.UnsupportedProblemError, match="was changed"):
        tb.engine("mujoco", GIVEN).simulate(_problem(mechanism))


def test_what_cannot_be_moved_as_given_is_refused() -> None:
    given = tb.engine("mujoco", GIVEN)
    compiled = tb.from_mjcf(mujoco.MjModel.from_xml_string(_text()))
    for mechanism in (tb.fixed(), compiled):
        with pytest.raises(tb.UnsupportedProblemError, match="was read from none"):
            given.simulate(_problem(mechanism))
    heavier = _read()
    first = heavier.bodies[0].model_copy(update={"mass": 2.0})
    heavier = heavier.model_copy(update={"bodies": (first, *heavier.bodies[1:])})
    with pytest.raises(tb.UnsupportedProblemError, match="another mechanism"):
        given.simulate(_problem(heavier))
    limited = _read(_text(limited="true"))
    with pytest.raises(tb.UnsupportedProblemError, match="release-once"):
        given.simulate(tb.Problem(limited, duration=UNTIL))
    with pytest.raises(tb.InputError, match="integrator = 'leapfrog'"):
        tb.engine("mujoco", GIVEN, integrator="leapfrog").simulate(_problem(_read()))
    with pytest.raises(tb.InputError, match="timestep"):
        tb.engine("mujoco", GIVEN, timestep=0.9).simulate(_problem(_read()))
    with pytest.raises(tb.InputError, match="preset 'given'"):
        tb.engine("pymunk", GIVEN)


def test_a_contact_ends_what_can_be_compared() -> None:
    mechanism = _read(_text(contype=1))
    with pytest.raises(tb.SimulationError, match="a contact acts"):
        tb.engine("mujoco", GIVEN).simulate(_problem(mechanism, 2.0))


def test_studies_take_it_where_it_is_asked_for_alone() -> None:
    mechanism = _read()
    assert GIVEN not in Study.of(mechanism, "mujoco").presets_of("mujoco")
    found = tb.compare(mechanism, "mujoco", [GIVEN], until=UNTIL, isolate=False)
    (row,) = found.results.runs
    assert row.settings["timestep"] == 0.004
    # 0.1 % is the need that is stated for every engine; Euler's error is a per cent of a step.
    assert row.outcome == "disagrees"
    assert row.diagnosis is not None
    assert "integrator" in {cause.name for cause in row.diagnosis.causes}


def test_a_limit_of_a_file_is_unilateral_by_default() -> None:
    mechanism = _read(_text(limited="true"))
    assert Study.of(mechanism, "mujoco").law_of(mechanism) is tb.StopLaw.UNILATERAL
    assert Study.of(mechanism, "mujoco", stop_law="release-once").law_of(mechanism) is (
        tb.StopLaw.RELEASE_ONCE
    )


def test_what_stands_still_has_a_page(tmp_path: Path) -> None:
    """No run has an error: there is no diagram of errors over costs."""
    hanging = tb.from_mjcf(_text(), qpos=[np.pi / 2, 0.0])
    found = tb.compare(hanging, "mujoco", [GIVEN], until=0.1, isolate=False, diagnose=False)
    found.write_html(tmp_path / "page.html")
    assert (tmp_path / "page.html").stat().st_size > 0


class _OtherEngine:
    """Steps of MuJoCo's under another name, with a failure where one is asked for."""

    engine, engine_version, integrators = "other", "1", ("Euler",)

    def __init__(self, fails: str = "") -> None:
        self.fails = fails
        self.controls = np.zeros((0, 0))

    def stepped(self, model: Any, start: Any, controls: FloatArray) -> SteppedModel:
        if self.fails == "lacks":
            raise NotImplementedError("no tendons.")
        self.controls = controls
        found = MUJOCO.stepped(model, start, controls)
        if self.fails == "diverges":
            found.qvel[-1] = np.nan
        return replace(found, contact=7 if self.fails == "touches" else None)


def test_another_engine_brings_its_steps_alone() -> None:
    record = ControlRecord(np.array([0.0, 0.1]), np.array([[0.5], [-1.0]]))
    source = _read(ctrl=record).source
    assert source is not None
    own, other = reread(source), _OtherEngine()
    read = reread(source, other)
    assert (read.engine, read.engine_version, read.integrators) == ("other", "1", ("Euler",))
    expected, found = (each.moved(UNTIL, read.options) for each in (own, read))
    assert np.array_equal(found.q, expected.q) and np.array_equal(found.u, expected.u)
    # The control that a step begins with acts in it.
    assert np.array_equal(other.controls[:, 0], np.where(np.arange(100) < 25, 0.5, -1.0))
    assert reread(source, _OtherEngine("touches")).moved(UNTIL, read.options).contact == (
        pytest.approx(7 * 0.004)
    )
    with pytest.raises(tb.UnsupportedProblemError, match=r"^other has not .* 'arm' .* tendons\.$"):
        reread(source, _OtherEngine("lacks")).moved(UNTIL, read.options)
    with pytest.raises(tb.SimulationError, match="'arm' diverges with the integrator 'Euler'"):
        reread(source, _OtherEngine("diverges")).moved(UNTIL, read.options)
    # What a stepper does to the model it is given stays with it.
    assert np.array_equal(own.moved(UNTIL, read.options).q, expected.q)
