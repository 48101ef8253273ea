"""The equations in machine code against NumPy's, and a motion with them against one without."""

import numpy as np
import pytest
import trebucheck as tb
from mechanisms import everything
from trebucheck.models.functions import linear_form
from trebucheck.models.kinematics import initial_state
from trebucheck.reference import compiled
from trebucheck.reference.equations import Equations
from trebucheck.reference.perturbed import with_joint_element
from trebucheck.reference.solver import solve

pytest.importorskip("numba", reason="Numba is not installed: the equations are NumPy's")

_ROUNDING = (
    1e-12  # of the largest: some hundred roundings of matrices that lose two or three digits
)


def _with_linear_forces() -> tb.Mechanism:
    """One of each element whose force is linear in coordinates and speeds."""
    between = {"body": "bob", "relative_to": "arm"}
    forces = (
        tb.RotationalSpringDamper(
            name="twist", **between, stiffness=3.0, damping=0.2, rest_angle=0.3
        ),
        tb.RotationalSpringDamper(name="mooring", body="hull", stiffness=7.0, rest_angle=-1.0),
        tb.SlideSpringDamper(
            name="buffer", body="slider", relative_to="arm", coordinate="p", stiffness=20.0,
            damping=1.5, rest_position=0.2, force=4.0,
        ),
        tb.ConstantTorque(name="motor", body="arm", relative_to="hull", torque=0.9),
        tb.RecordedTorque(name="servo", **between, times=(0.0,), torques=(0.7,)),
        tb.RecordedForce(
            name="piston", body="arm", relative_to="hull", coordinate="s", times=(0.0,),
            forces=(-1.3,),
        ),
        tb.RotorInertia(name="rotor", **between, inertia=0.4),
        tb.SlideInertia(
            name="drive", body="slider", relative_to="arm", coordinate="p", inertia=0.7
        ),
    )  # fmt: skip
    linear = everything().model_copy(update={"force_elements": forces, "name": "linear forces"})
    return tb.Mechanism.model_validate(linear.model_dump())


def _machines() -> list[tb.Mechanism]:
    return [
        tb.fixed(),
        tb.rolling(),
        tb.hinged(),
        tb.floating_arm(),
        everything().model_copy(update={"force_elements": ()}),
        _with_linear_forces(),
    ]


@pytest.mark.parametrize("mechanism", _machines(), ids=lambda m: m.name)
def test_accelerations_and_multipliers_are_numpys(
    mechanism: tb.Mechanism, monkeypatch: pytest.MonkeyPatch
) -> None:
    random, (q, u) = np.random.default_rng(4), initial_state(mechanism)
    states = q + random.uniform(-0.3, 0.3, (5, len(q))), u + random.uniform(-1, 1, (5, len(u)))
    for closed in ((), tuple(stop.name for stop in mechanism.stops if stop.closed)):
        equations = Equations(mechanism)
        assert equations.compiled(q, closed) is not None
        quick = equations.solve(*states, closed)
        with monkeypatch.context() as patch:
            patch.setattr(compiled, "is_available", lambda: False)
            slow = Equations(mechanism).solve(*states, closed)
        for ours, numpys in zip(quick, slow, strict=True):
            assert ours == pytest.approx(numpys, abs=_ROUNDING * np.abs(numpys).max(initial=1.0))


def test_a_fault_beside_linear_forces_is_added_to_them(monkeypatch: pytest.MonkeyPatch) -> None:
    mechanism = _with_linear_forces()
    random, (q, u) = np.random.default_rng(4), initial_state(mechanism)
    states = q + random.uniform(-0.3, 0.3, (5, len(q))), u + random.uniform(-1, 1, (5, len(u)))
    fault = {"damping": 0.3, "stiffness": 2.0, "torque": 0.5}
    quick = with_joint_element(mechanism, "pin", **fault)
    assert quick.compiled(q, ()) is not None
    found = quick.solve(*states, ())[0]
    monkeypatch.setattr(compiled, "is_available", lambda: False)
    expected = with_joint_element(mechanism, "pin", **fault).solve(*states, ())[0]
    assert found == pytest.approx(expected, abs=_ROUNDING * np.abs(expected).max())


def test_forces_that_are_not_linear_are_numpys() -> None:
    mechanism = everything()
    assert Equations(mechanism).compiled(initial_state(mechanism)[0], ()) is None


def test_motion_is_that_of_scipys_integrator(monkeypatch: pytest.MonkeyPatch) -> None:
    """Same method, same choice of steps.

    The same evaluations, releases and states, but for rounding.
    """
    problem = tb.Problem(tb.rolling(), duration=2.6)
    quick = solve(problem, 1e-9, 1e-9)
    monkeypatch.setattr(compiled, "is_available", lambda: False)
    slow = solve(problem, 1e-9, 1e-9)
    assert quick.evaluations == slow.evaluations
    assert quick.release_times == pytest.approx(slow.release_times, abs=1e-11)
    t = np.linspace(0.0, 2.6, 101)
    assert quick.motion(t).q == pytest.approx(
        slow.motion(t).q, abs=1e-9
    )  # stretched 43 times by the launch


def test_body_without_inertia_about_its_pin_has_one_sentence() -> None:
    body = tb.Body(name="b", angle="a", mass=1.0, centre=(0, 0), inertia=0.0)
    pin = tb.PinJoint(name="p", parent="ground", child="b", parent_point=(0, 0), child_point=(0, 0))
    mechanism = tb.Mechanism(name="m", bodies=(body,), joints=(pin,), gravity=9.81, start=(0.0,))
    with pytest.raises(tb.SimulationError, match="no unique accelerations"):
        solve(tb.Problem(mechanism, duration=1.0))


BEAD = """
<mujoco><compiler angle="radian" autolimits="true"/><worldbody>
  <body name="arm"><joint name="hinge" type="hinge" axis="0 1 0"/>
    <geom type="capsule" fromto="0 0 0 1 0 0" size=".05"/>
    <body name="bead" pos=".3 0 .1"><joint name="rail" type="slide" axis=".8 0 .6" range="-.1 .2"/>
      <geom size=".1"/>
    </body>
  </body>
  <body name="cart" pos="0 0 3"><joint name="track" type="slide" axis=".6 0 -.8" range="-1 .3"/>
    <geom size=".1"/>
  </body>
</worldbody></mujoco>
"""


def test_stops_along_slides_are_linear_and_compiled(monkeypatch: pytest.MonkeyPatch) -> None:
    """Whether the line turns, as the bead's, or not, as the cart's; the arm's tip has none."""
    mechanism = tb.from_mjcf(BEAD)
    wall = tb.PointStop(
        name="wall", body="arm", point=(1.0, 0.0), normal=(0.0, 1.0), offset=-9.0, closed=False
    )
    floor = wall.model_copy(
        update={"name": "floor", "body": "bead", "relative_to": "cart", "point": (0.0, 0.0)}
    )
    both = mechanism.model_copy(update={"stops": (*mechanism.stops, wall, floor)})
    equations, random = Equations(both), np.random.default_rng(8)
    q, u = random.uniform(-2, 2, (2, 9, 3))
    for name, gap in equations.kinematics.gaps.items():
        linear = linear_form(gap)
        assert (linear is None) == (name in ("wall", "floor")), name
        if linear is not None:
            assert linear.value(q) == pytest.approx(gap.value(q), abs=1e-14)
            rates = equations.kinematics.rates(q)
            assert linear.coefficients + 0 * q == pytest.approx(gap.jacobian(q, rates), abs=1e-14)
    closed = tuple(stop.name for stop in mechanism.stops)[:1]
    assert equations.compiled(q[0], closed) is not None
    quick = equations.solve(q, u, closed)
    monkeypatch.setattr(compiled, "is_available", lambda: False)
    for ours, numpys in zip(quick, Equations(both).solve(q, u, closed), strict=True):
        assert ours == pytest.approx(numpys, abs=_ROUNDING * np.abs(numpys).max(initial=1.0))
