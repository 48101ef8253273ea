"""Couplers: closed forms of gears and a rack, other formulations, welds, and what is refused."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
import trebucheck as tb
from mechanisms import geared, pin
from trebucheck.comparisons.diagnosis.faults import with_closed_loops
from trebucheck.engines.units import Units
from trebucheck.models.kinematics import Kinematics
from trebucheck.models.stacked import stack_of
from trebucheck.reference.certification.redundant import solve_redundant
from trebucheck.reference.equations import Equations
from trebucheck.reference.solver import solve
from trebucheck.reference.taylor.solve import solve_taylor

TIMES = np.linspace(0.0, 1.5, 31)


def coupler(follows: str, offset: float = 0.0, **ratios: float) -> tb.Coupler:
    """A coupler of that name."""
    terms = tuple(tb.CouplerTerm(coordinate=name, ratio=ratios[name]) for name in ratios)
    return tb.Coupler(name=f"{follows} follows", coordinate=follows, terms=terms, offset=offset)


def wheels(ratio: float, torque: float, inertias: tuple[float, float]) -> tb.Mechanism:
    """Two balanced wheels on the ground, the second geared to the first."""
    names = "one", "two"
    return tb.Mechanism(
        name="wheels",
        bodies=tuple(
            tb.Body(name=name, angle=name, mass=1.0, centre=(0, 0), inertia=inertia)
            for name, inertia in zip(names, inertias, strict=True)
        ),
        joints=tuple(pin(f"axle of {name}", "ground", name, (0.0, 0.0)) for name in names),
        force_elements=(tb.ConstantTorque(name="motor", body="one", torque=torque),),
        couplers=(coupler("two", one=ratio, offset=0.5),),
        gravity=9.81,
        start=(0.2, 0.5 + ratio * 0.2),
    )


def test_geared_wheels_turn_by_their_reduced_inertia() -> None:
    ratio, torque, (one, two) = -2.5, 3.0, (0.4, 0.07)
    motion = solve(tb.Problem(wheels(ratio, torque, (one, two)), 1.5)).motion(TIMES)
    angle = 0.5 * torque / (one + ratio**2 * two) * TIMES**2
    assert motion.q[:, 0] == pytest.approx(0.2 + angle, abs=1e-11)
    assert motion.q[:, 1] == pytest.approx(0.5 + ratio * (0.2 + angle), abs=1e-11)


def test_the_multiplier_is_the_effort_on_what_follows() -> None:
    ratio, torque, (one, two) = -2.5, 3.0, (0.4, 0.07)
    mechanism = wheels(ratio, torque, (one, two))
    q = np.array(mechanism.start)
    acceleration, multipliers = Equations(mechanism).solve(q, np.zeros(2), ())
    assert multipliers == pytest.approx([two * acceleration[1]], rel=1e-14)
    assert acceleration[0] == pytest.approx((torque - ratio * multipliers[0]) / one, rel=1e-14)


def test_a_weight_on_a_rack_turns_a_wheel_and_hangs_on_it() -> None:
    radius, mass, inertia, gravity = 0.3, 2.0, 0.05, 9.81
    mechanism = tb.Mechanism(
        name="rack",
        bodies=(
            tb.Body(name="wheel", angle="a", mass=1.0, centre=(0, 0), inertia=inertia),
            tb.Body(name="rack", mass=mass, centre=(0, 0), inertia=0.1),
        ),
        joints=(
            pin("axle", "ground", "wheel", (0.0, 0.0)),
            tb.PrismaticJoint(
                name="rail", child="rack", parent_point=(radius, 0), child_point=(0, 0),
                axis=(0, 1), coordinate="s",
            ),
        ),
        couplers=(coupler("s", a=-radius),),
        gravity=gravity,
        start=(0.0, 0.0),
    )  # fmt: skip
    solution = solve(tb.Problem(mechanism, 1.5))
    motion = solution.motion(TIMES)
    fall = gravity * mass / (mass + inertia / radius**2)
    assert motion.q[:, 1] == pytest.approx(-0.5 * fall * TIMES**2, abs=1e-11)
    # What the rail holds is across it: nothing, as the rack's force is along it.
    trajectory = solution.trajectory(TIMES)
    assert trajectory.joint_reactions["rail"] == pytest.approx(np.zeros((31, 2)), abs=1e-11)
    # The axle carries the wheel; the rack pushes on the ground, on which its line stands.
    assert trajectory.joint_reactions["axle"][:, 1] == pytest.approx(
        np.full(31, 1.0 * gravity), rel=1e-12
    )


def test_both_formulations_and_integrators_give_one_motion() -> None:
    problem = tb.Problem(geared(), 1.5)
    motion, redundant = solve(problem).motion(TIMES), solve_redundant(problem)
    series = solve_taylor(problem).motion(TIMES)
    for k, t in enumerate(TIMES.tolist()):
        q, u = redundant.state(t)
        assert motion.q[k] == pytest.approx(q, abs=1e-9)
        assert motion.u[k] == pytest.approx(u, abs=1e-9)
    assert series.q == pytest.approx(motion.q, abs=1e-10)


def test_forces_of_joints_agree_between_the_formulations() -> None:
    problem = tb.Problem(geared(), 1.5)
    trajectory, redundant = solve(problem).trajectory(TIMES), solve_redundant(problem)
    for k in (3, 17, 30):
        state = redundant.motion.state(float(TIMES[k]))
        for name, force in redundant.system.reactions(state, ()).items():
            assert trajectory.joint_reactions[name][k] == pytest.approx(force, abs=1e-8)


def test_a_proof_encloses_motion_and_forces() -> None:
    """The reference's local errors are below 1e-12; forces of joints are some tens of newtons."""
    until = 0.2
    proof, solution = tb.prove(geared(), digits=10, until=until), solve(tb.Problem(geared(), until))
    motion, at_end = solution.motion(np.array([until])), solution.trajectory(np.array([until]))
    for found, expected in ((proof.q(until), motion.q[0]), (proof.u(until), motion.u[0])):
        values = [float(value.value) for value in found.values()]
        assert values == pytest.approx(expected.tolist(), abs=1e-10)
    for joint, force in at_end.joint_reactions.items():
        found = [float(part.value) for part in proof.joint_reaction(joint, until)]
        assert found == pytest.approx(force[0].tolist(), abs=1e-9 * np.abs(force).max())


def test_derivatives_by_an_offset_are_those_of_differences() -> None:
    """The start moves by the least that fits; the quotient errs by 1e-10 of third derivatives."""
    mechanism, end, change = geared(), 1.0, 1e-5

    def moved(by: float) -> Any:
        gear, *others = mechanism.couplers
        gear = gear.model_copy(update={"offset": gear.offset + by})
        wrong = mechanism.model_copy(update={"couplers": (gear, *others)})
        there = with_closed_loops(wrong)
        assert there is not None
        return solve(tb.Problem(there, end)).motion(np.array([end])).q[0]

    rows = tb.sensitivities(mechanism, end).to_dataframe()
    rows = rows[(rows.quantity == "coordinate") & (rows.number == "offset of gear")]
    found = dict(zip(rows["of"], rows["value"], strict=True))
    expected = (moved(change) - moved(-change)) / (2 * change)
    assert [found[name] for name in mechanism.coordinates] == pytest.approx(expected, abs=1e-6)


def test_energy_is_kept() -> None:
    trajectory = solve(tb.Problem(geared(), 1.5)).trajectory(TIMES)
    energy = trajectory.kinetic_energy + trajectory.potential_energy
    assert np.ptp(energy) < 1e-10 * trajectory.kinetic_energy.max()


def test_a_pin_and_a_coupler_are_a_weld() -> None:
    def pendulum(second: Any, **changes: Any) -> tb.Mechanism:
        held = isinstance(second, tb.WeldJoint)
        return tb.Mechanism(
            name="pendulum",
            bodies=(
                tb.Body(name="rod", angle="a", mass=1.0, centre=(0, -0.5), inertia=0.1),
                tb.Body(
                    name="bob", angle=None if held else "b", mass=2.0, centre=(0.1, -0.3),
                    inertia=0.05,
                ),
            ),
            joints=(pin("hinge", "ground", "rod", (0.0, 0.0)), second),
            gravity=9.81,
            start=(0.7,) if held else (0.7, 0.7 + 0.3),
            **changes,
        )  # fmt: skip

    at: dict[str, Any] = {"parent_point": (0.0, -1.0), "child_point": (0.0, 0.0)}
    welded = pendulum(tb.WeldJoint(name="end", parent="rod", child="bob", angle=0.3, **at))
    pinned = pendulum(
        tb.PinJoint(name="end", parent="rod", child="bob", **at),
        couplers=(coupler("b", a=1.0, offset=0.3),),
    )
    one, other = (solve(tb.Problem(each, 1.5)).trajectory(TIMES) for each in (welded, pinned))
    assert other.q[:, 0] == pytest.approx(one.q[:, 0], abs=1e-10)
    for joint in ("hinge", "end"):
        assert other.joint_reactions[joint] == pytest.approx(one.joint_reactions[joint], abs=1e-8)


def test_a_coupler_without_terms_holds_its_coordinate() -> None:
    start = (0.3, 0.8)
    mechanism = wheels(1.0, 2.0, (0.4, 0.1)).model_copy(
        update={"couplers": (coupler("two", offset=0.8),), "start": start}
    )
    motion = solve(tb.Problem(mechanism, 1.0)).motion(np.linspace(0.0, 1.0, 11))
    assert motion.q[:, 1] == pytest.approx(np.full(11, 0.8), abs=1e-13)
    assert motion.q[-1, 0] == pytest.approx(0.3 + 0.5 * 2.0 / 0.4, abs=1e-11)


def test_a_coupler_is_the_same_in_other_units() -> None:
    mechanism, units = geared(), Units(0.25, 8.0, 0.5)
    scaled = units.mechanism(mechanism)
    q = units.coordinates(mechanism)
    residual = Kinematics(scaled).loop_residual(np.array(scaled.start) + 0.1 / q)
    moved = Kinematics(mechanism).loop_residual(np.array(mechanism.start) + 0.1)
    first = [units.length if name == "s" else 1.0 for name in ("beta", "s")]
    assert residual == pytest.approx(moved / first, rel=1e-13)
    assert [c.coordinate for c in mechanism.couplers] == ["beta", "s"]


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"couplers": (coupler("gamma", alpha=1.0),)}, ("gamma", "alpha")),
        ({"couplers": (coupler("beta", gamma=1.0),)}, ("gamma",)),
        ({"couplers": (coupler("beta", alpha=1.0, offset=1.0),)}, ("beta follows", "off by")),
        (
            {"couplers": (coupler("beta", alpha=-1.7, offset=0.4),), "start_speeds": (1, 1, 0)},
            ("beta follows", "off by"),
        ),
        ({"couplers": (coupler("beta", alpha=-1.7, offset=0.4),) * 2}, ("used twice",)),
    ],
    ids=["unknown", "unknown term", "start", "start speeds", "twice"],
)
def test_what_does_not_fit_is_refused(changes: dict[str, Any], words: tuple[str, ...]) -> None:
    fields = {name: getattr(geared(), name) for name in tb.Mechanism.model_fields}
    with pytest.raises(tb.InputError) as refused:
        solve(tb.Problem(tb.Mechanism(**(fields | changes)), 1.0))
    assert all(word in str(refused.value) for word in words)


def test_a_coordinate_stands_once_in_a_coupler() -> None:
    with pytest.raises(tb.InputError, match="'a' twice"):
        coupler("a", a=1.0)


def test_a_batch_of_other_ratios_is_refused_by_the_coupler_s_name() -> None:
    stack = stack_of(geared(), {"couplers.gear.terms.0.ratio": np.array([-1.7, -1.6])})
    with pytest.raises(tb.TrebucheckError, match="gear"):
        tb.throw(stack)


def test_a_mechanism_without_couplers_keeps_its_hash() -> None:
    bare = geared().model_copy(update={"couplers": ()})
    assert "couplers" not in bare.model_dump(mode="json")
    assert tb.Mechanism.from_json(geared().to_json()) == geared()
