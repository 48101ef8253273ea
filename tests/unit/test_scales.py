"""Scales of motions given by formulas, of mechanisms at rest, without gravity, of any size.

Stretching; the end.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import mechanisms
import numpy as np
import pytest
import trebucheck as tb
from formulas import ARM, END, TURN, WAY, Formula, trolley
from trebucheck.comparisons.runs import stretching as stretchings
from trebucheck.comparisons.runs import study
from trebucheck.comparisons.runs.quantities import JUDGED, QUANTITIES, judged_quantity
from trebucheck.comparisons.runs.scales import Scales, _spring_time, extent, scales_until, size
from trebucheck.comparisons.runs.stretching import predictable_until, stretching, stretching_at
from trebucheck.comparisons.runs.study import Until
from trebucheck.models.elements import PointStop
from trebucheck.models.mechanism import Body, Marker
from trebucheck.reference.solver import characteristic_time, solve


def _scales(end: float = END, **changes: Any) -> Scales:
    return scales_until(replace(Formula(), **changes), end)  # type: ignore[arg-type]


def test_scales_of_a_motion_by_formulas() -> None:
    scales = _scales()
    assert scales.length == 3.0  # the trolley's radius of gyration and the arm
    assert scales.speed == pytest.approx(ARM * TURN)
    assert scales.time == pytest.approx(math.sqrt(3.0 / 9.0))
    assert scales.angular_speed == pytest.approx(TURN)
    assert (scales.mass, scales.angle) == (5.0, 1.0)
    assert scales.force == 45.0
    # The rest's 20 N m; of stops that never push a thousandth of the force, times the size where it
    # is a torque.
    assert scales.torques == pytest.approx({"rest": 20.0, "buffer": 0.045 * 3.0, "wall": 0.045})
    assert scales.energy == pytest.approx(75.0 + 75.0)
    assert scales.largest_energy == pytest.approx(75.0 + 55.0 + 5 * 9 * 3)


def test_a_motion_before_its_end_counts_only() -> None:
    assert _scales(0.4).speed == pytest.approx(1e-6 * math.sqrt(27.0), rel=0.5)
    assert _scales(0.7).torques["rest"] == pytest.approx(20.0)
    assert _scales(1.0).energy == pytest.approx(100.0)


def test_the_characteristic_time_is_the_least_of_three() -> None:
    spinning = {"u": lambda t: [0 * t, 10.0 + 0 * t, 0 * t]}
    assert _scales(**spinning).time == pytest.approx(3.0 / 20.0)
    assert _scales(0.01).time == pytest.approx(0.1)
    floating = trolley(gravity=0.0)
    assert _scales(mechanism=floating).time == pytest.approx(3.0 / 2.0)
    still = {"u": lambda t: [0 * t] * 3, "mechanism": floating}
    assert _scales(**still).time == pytest.approx(10 * END)


def test_a_turning_body_and_a_moving_point_both_have_speeds() -> None:
    turning = _scales(u=lambda t: [5.0 + 0 * t, 0 * t, 0 * t])
    assert turning.speed == pytest.approx(2.5)  # of the hook, half a metre out
    assert turning.angular_speed == pytest.approx(5.0)
    sliding = _scales(u=lambda t: [0 * t, 0 * t, -6.0 + 0 * t])
    assert sliding.speed == pytest.approx(6.0)
    assert sliding.angular_speed == pytest.approx(6.0 / 3.0)  # a slide's speed is no turn


def test_forces_are_of_joints_and_of_stops_on_points() -> None:
    assert _scales(torques={**Formula().torques, "wall": lambda t: -99.0 + 0 * t}).force == 99.0
    assert _scales(torques={**Formula().torques, "rest": lambda t: 1e6 + 0 * t}).force == 45.0
    none = {name: lambda t: np.zeros((len(t), 2)) for name in ("slot", "pivot")}
    assert _scales(reactions=none).force == pytest.approx(1e-6 * 5.0 * 9.0)
    fast = {"reactions": none, "u": lambda t: [0 * t, 0 * t, 30.0 + 0 * t]}
    assert _scales(**fast).force == pytest.approx(1e-6 * 5.0 * 300.0)


def test_an_energy_that_only_has_a_zero_elsewhere_is_no_other_scale() -> None:
    shifted = _scales(potential=lambda t: 1020.0 - 50.0 * t)
    assert shifted.energy == pytest.approx(150.0)
    still = {"kinetic": lambda t: 0 * t, "potential": lambda t: 20.0 + 0 * t}
    assert _scales(**still).energy == pytest.approx(1e-9 * (20.0 + 135.0))
    nothing = {"kinetic": lambda t: 0 * t, "potential": lambda t: 0 * t}
    least = 1e-6 * 3.0 / END
    floating = {"mechanism": trolley(gravity=0.0), "u": lambda t: [0 * t] * 3}
    assert _scales(**nothing, **floating).energy == pytest.approx(0.5 * 5.0 * least**2)


def test_a_body_reaches_to_its_farthest_point() -> None:
    mechanism = trolley()
    assert [extent(mechanism, body) for body in mechanism.bodies] == [1.0, ARM]
    far = trolley(markers=(Marker(name="far", body="arm", point=(3, 4)),))
    assert extent(far, far.body("arm")) == 5.0
    assert size(far) == 6.0
    wall = PointStop(
        name="wall", body="trolley", point=(0, -7), normal=(0, 1), offset=-9, closed=False
    )
    assert extent(trolley(stops=(wall,)), trolley().body("trolley")) == 7.0
    hung = trolley(
        joints=(trolley().joints[0], mechanisms.pin("pivot", "trolley", "arm", (0, 6), (0, 0)))
    )
    assert extent(hung, hung.body("trolley")) == 6.0
    off = trolley(
        joints=(trolley().joints[0], mechanisms.pin("pivot", "trolley", "arm", (0, 0), (-1, 0)))
    )
    assert extent(off, off.body("arm")) == 3.0
    bar = mechanisms.four_bar()
    assert extent(bar, bar.body("coupler")) == pytest.approx(
        2.5
    )  # to the joint that closes the loop
    assert extent(bar, bar.body("rocker")) == pytest.approx(2.0)
    bob = Body(name="arm", angle="beta", mass=2.0, centre=(0, 9), inertia=0.0)
    assert extent(trolley(bodies=(trolley().bodies[0], bob)), bob) == 9.0


@pytest.mark.parametrize("factor", [1e-3, 1e2])
def test_scales_of_a_mechanism_of_another_size_are_the_same_parts(factor: float) -> None:
    """Lengths times s, masses times s^3, times the square root.

    The theory of models under gravity.
    """
    s, own = factor, mechanisms.hanging_bob(start=0.3)
    body = Body(name="bob", angle="beta", mass=3.0 * s**3, centre=(2.0 * s, 0), inertia=0.0)
    other = mechanisms.hanging_bob(
        start=0.3, bodies=(body,), markers=(Marker(name="bob", body="bob", point=(2.0 * s, 0)),)
    )
    small = scales_until(solve(tb.Problem(other, duration=1.0 * math.sqrt(s))), math.sqrt(s))
    usual = scales_until(solve(tb.Problem(own, duration=1.0)), 1.0)
    powers = {
        "length": 1,
        "time": 0.5,
        "speed": 0.5,
        "angular_speed": -0.5,
        "mass": 3,
        "force": 3,
        "energy": 4,
    }
    assert len(powers) > 0
    for name, power in powers.items():
        assert getattr(small, name) == pytest.approx(
            getattr(usual, name) * s**power, rel=1e-6, abs=0
        ), name


def test_springs_on_angles_have_the_time_of_the_inertia_that_they_turn() -> None:
    """A body that is lighter than the arm is not at the spring.

    A cubic one has its stiffness at the start.
    """
    body = Body(name="bob", angle="beta", mass=3.0, centre=(0.5, 0), inertia=0.25)
    turned = 3.0 * 0.5**2 + 0.25
    ends = {"name": "spring", "body": "bob", "relative_to": "ground"}
    springs = [
        (tb.RotationalSpringDamper(**ends, stiffness=9e4), 9e4),
        (tb.CubicTorsionSpring(**ends, stiffness=9e4), 9e4),
        (
            tb.CubicTorsionSpring(**ends, stiffness=5e4, cubic_stiffness=1e5, rest_angle=0.1),
            5e4 + 3e5 * 0.2**2,
        ),
        (tb.CubicTorsionSpring(**ends, cubic_stiffness=1e5, rest_angle=0.1), 3e5 * 0.2**2),
    ]
    assert len(springs) > 0
    for spring, stiffness in springs:
        swing = mechanisms.hanging_bob(
            start=0.3, bodies=(body,), markers=(), force_elements=(spring,)
        )
        scales = scales_until(solve(tb.Problem(swing, duration=0.1)), 0.1)
        assert scales.time == pytest.approx(math.sqrt(turned / stiffness), rel=1e-12), spring


@pytest.mark.parametrize(
    ("mass", "stiffness"), [(0.04, 0.25), (0.25, 9.0), (9.0, 0.25), (3.0, 0.0)]
)
def test_a_spring_has_the_time_of_the_lightest_body_at_it(mass: float, stiffness: float) -> None:
    """However light or soft; without a stiffness it has none."""
    machine = mechanisms.chain()
    upper, lower = (
        body.model_copy(update={"mass": m})
        for body, m in zip(machine.bodies, (2 * mass, mass), strict=True)
    )
    machine = machine.model_copy(update={"bodies": (upper, lower)})
    ends = {"name": "spring", "point": (0.1, 0.2), "relative_point": (0.3, 0.0)}
    spring = tb.SpringDamper(**ends, body="upper", relative_to="lower", stiffness=stiffness)
    expected = math.sqrt(mass / stiffness) if stiffness else math.inf
    assert _spring_time(machine, spring) == pytest.approx(expected)
    alone = tb.SpringDamper(**ends, body="upper", stiffness=stiffness)
    assert _spring_time(machine, alone) == pytest.approx(math.sqrt(2) * expected)


def test_scales_of_a_small_trebuchet_are_the_same_parts() -> None:
    """Every scale, those of stops among them, below 1: none of them is an absolute value."""
    s, usual = 1e-3, tb.TrebuchetParameters()
    lengths, masses = ("l1", "l2", "r", "h"), ("m_b", "m_cw", "m_a")
    changes = {name: getattr(usual, name) * s for name in lengths}
    changes |= {name: getattr(usual, name) * s**3 for name in masses}
    small = tb.fixed(tb.TrebuchetParameters(**changes))
    found, expected = (
        scales_until(solve(tb.Problem(m, duration=end)), end).model_dump()
        for m, end in ((small, 0.4 * math.sqrt(s)), (tb.fixed(), 0.4))
    )
    powers = {
        "length": 1, "angle": 0, "way": 1, "turn": 0, "time": 0.5,
        "speed": 0.5, "angular_speed": -0.5, "mass": 3, "force": 3,
        "energy": 4, "largest_energy": 4,
    }  # fmt: skip
    torques, own = expected.pop("torques"), found.pop("torques")
    assert found == pytest.approx({k: v * s ** powers[k] for k, v in expected.items()}, rel=1e-6)
    assert own == pytest.approx({k: v * s**4 for k, v in torques.items()}, rel=1e-6, abs=0)
    assert len(own) >= 2


@pytest.mark.parametrize("start", [math.pi / 2, math.pi / 2 - 1e-6])
def test_a_pendulum_at_its_lowest_point_has_scales(start: float) -> None:
    scales = scales_until(solve(tb.Problem(mechanisms.hanging_bob(start=start), duration=2.0)), 2.0)
    assert scales.time == pytest.approx(math.sqrt(2.0 / 9.81))
    assert scales.force == pytest.approx(3.0 * 9.81)
    assert scales.speed == pytest.approx(1e-6 * math.sqrt(2.0 * 9.81), rel=1e-3)
    assert scales.energy == pytest.approx(1e-9 * 2 * 3.0 * 9.81 * 2.0, rel=1e-3)


# quantities


def _scale(name: str, subject: str | None = None) -> float:
    return QUANTITIES[name].scale_of(_scales(), subject, trolley())


def test_each_quantity_is_measured_in_its_own_scale() -> None:
    time = math.sqrt(1 / 3)
    found = {
        ("position_max", "hook"): WAY,
        ("velocity_max", "hook"): 2.0,
        ("angle_max", "beta"): 1.0,
        ("slide_max", "s"): WAY,
        ("angular_speed_max", "beta"): 1.0,
        ("slide_speed_max", "s"): 2.0,
        ("launch_time", None): time,
        ("launch_speed", None): 2.0,
        ("release_time", "rest"): time,
        ("impact_time", "buffer"): time,
        ("impact_impulse", "rest"): 30.0,
        ("impact_impulse", "wall"): 10.0,
        ("impact_speed", "beta"): 1.0,
        ("impact_speed", "hook"): 2.0,
        ("stop_torque_max", "rest"): 20.0,
        ("stop_torque_max", "wall"): 0.045,
        ("joint_reaction_max", "slot"): 45.0,
        ("kinetic_energy_max", None): 150.0,
        ("potential_energy_max", None): 150.0,
        ("energy_balance", None): 150.0,
        ("horizontal_momentum", None): 10.0,
        ("stop_gap_held", "rest"): 1.0,
        ("stop_penetration", "wall"): WAY,
        ("joint_gap_max", "pivot"): WAY,
        ("missing_time", None): time,
        ("unseen_time", None): time,
        ("energy_drift", None): 1.0,
        ("base_error", None): 0.01,
    }
    assert {key: _scale(*key) for key in found} == pytest.approx(found)
    assert {name for name, _ in found} >= {quantity.name for quantity in JUDGED.values()}


def test_what_follows_is_judged_in_its_place() -> None:
    follows = {
        quantity.name: quantity.follows for quantity in QUANTITIES.values() if quantity.follows
    }
    assert follows == {
        "position_rms": "position_max",
        "stop_torque_settled": "stop_torque_max",
        "stop_impulse": "stop_torque_max",
        "joint_reaction_relative": "joint_reaction_max",
        "energy_drift": "energy_balance",
        "energy_drift_kinetic": "energy_balance",
        "complementarity": "stop_penetration",
        "first_parting": "base_error",
    }
    assert {q.name for q in QUANTITIES.values() if q.event} == {
        "launch_time",
        "release_time",
        "impact_time",
    }
    assert (
        judged_quantity("position") is judged_quantity("position_max") is QUANTITIES["position_max"]
    )
    with pytest.raises(tb.InputError, match=f"tolerance '{'x' * 60}' is"):
        judged_quantity("x" * 61)
    refused = r"is not of a judged quantity( \(did you mean .*\?\))?; there are: position, speed"
    for name in ("position_rms", "energy (of the start's)", "x", ""):
        with pytest.raises(tb.InputError, match=refused):
            judged_quantity(name)


def test_a_quantity_knows_its_subjects() -> None:
    subjects = {title: quantity.subjects(trolley()) for title, quantity in JUDGED.items()}
    stops, joints, markers = ("rest", "buffer", "wall"), ("slot", "pivot"), ("projectile", "hook")
    assert subjects == {
        "position": markers,
        "speed": markers,
        "angle": ("tilt", "beta"),
        "angular-speed": ("tilt", "beta"),
        "slide": ("s",),
        "slide-speed": ("s",),
        "release": ("rest",),
        "stop-gap": ("rest",),
        "impact": stops,
        "impulse": stops,
        "impact-speed": ("tilt", "beta", "s", *markers),
        "stop-torque": stops,
        "penetration": stops,
        "reaction": joints,
        "joint-gap": joints,
        "launch-time": (),
        "launch-speed": (),
        "kinetic-energy": (),
        "potential-energy": (),
        "energy": (),
        "momentum": (),
        "duration": (),
        "sampling": (),
        "base-error": (),
    }


# stretching


def test_the_horizon_is_the_last_time_below_the_limit() -> None:
    t = np.linspace(0.0, 4.0, 5)
    assert predictable_until(t, np.array([0.0, 1.0, 50.0, 99.0, 100.0])) == 4.0
    assert predictable_until(t, np.array([0.0, 1.0, 50.0, 100.1, 1e9])) == 2.0
    assert predictable_until(t, np.array([0.0, 1.0, 100.0, 100.0, np.inf])) == 3.0
    assert predictable_until(t, np.full(5, np.inf)) == 1.0


def _stretched(mechanism: tb.Mechanism, end: float) -> tuple[Any, Any]:
    solution = solve(tb.Problem(mechanism, duration=1.5 * end))
    return stretching(solution, end, scales_until(solution, end))


def test_a_free_rotation_is_stretched_by_what_slows_it_down() -> None:
    """A rod that turns evenly, without gravity.

    More inertia changes nothing, as the speed at the start is given.
    """
    t, stretched = _stretched(mechanisms.hanging_bob(gravity=0.0, start_speeds=(1.0,)), 1.0)
    assert len(t) == len(stretched) == 400 and t[-1] == 1.0
    assert stretched.max() < 1e-2


def test_a_small_swing_is_stretched_as_its_period_is() -> None:
    """A point mass on l swings with w = sqrt(g / l).

    An inertia of e m l^2 more makes that w / sqrt(1 + e).
    """
    length, end = 3.0, 2.0
    bob = mechanisms.hanging_bob(start=math.pi / 2 - 1e-3, length=length, markers=())
    t, stretched = _stretched(bob, end)
    wt = math.sqrt(9.81 / length) * t
    expected = (
        np.maximum.accumulate(np.abs(np.sin(wt) + wt * np.cos(wt))) / 2
    )  # of the speed, in parts of its largest
    assert stretched == pytest.approx(expected, rel=0.02, abs=5e-3)
    assert stretching_at(solve(tb.Problem(bob, duration=3.0)), end) == pytest.approx(
        stretched[-1], rel=1e-3
    )


def test_stretching_is_of_everything_in_parts_of_its_scale() -> None:
    slot = mechanisms.chain_on_a_slot()
    t = np.linspace(0.0, 0.2, 3)
    solution = solve(tb.Problem(slot, duration=0.2))
    scales, motion = (
        scales_until(solution, 0.2).model_copy(update={"angle": 2.0}),
        solution.trajectory(t),
    )
    q, u, rods = motion.q, motion.u, np.exp(-1j * motion.q[:, :2])
    arms = (
        complex(0.5, 0.1) - complex(0.1, 0.1),
        complex(0.5, -0.1),
        complex(0.4, -0.5) - complex(0, 0.1),
    )
    along = complex(0.8, 0.6)
    upper = complex(1, 2) + q[:, 2] * along + rods[:, 0] * arms[0]
    lower = upper + rods[:, 0] * arms[1] + rods[:, 1] * arms[2]
    upper_speed = u[:, 2] * along - 1j * u[:, 0] * rods[:, 0] * arms[0]
    lower_speed = upper_speed - 1j * (
        u[:, 0] * rods[:, 0] * arms[1] + u[:, 1] * rods[:, 1] * arms[2]
    )
    forces = [force[:, 0] + 1j * force[:, 1] for force in motion.joint_reactions.values()]
    expected = [
        upper / scales.length,
        upper_speed / scales.speed,
        q[:, 0] / 2.0,
        u[:, 0] / scales.angular_speed,
        lower / scales.length,
        lower_speed / scales.speed,
        q[:, 1] / 2.0,
        u[:, 1] / scales.angular_speed,
        *(force / scales.force for force in forces),
    ]
    assert stretchings._motion(solution, t, scales) == pytest.approx(np.array(expected), rel=1e-9)


def test_stretching_is_not_looked_at_where_an_impact_jumps() -> None:
    t = np.linspace(0.0, 1.0, 11)
    struck = replace(
        Formula(), impacts=((0.305, {}), (0.52, {}), (0.695, {}), (0.0, {}), (1.0, {}))
    )
    left = stretchings._away_from_impacts(struck, t)  # type: ignore[arg-type]
    assert left == pytest.approx([0.0, 0.1, 0.2, 0.4, 0.5, 0.6, 0.8, 0.9, 1.0])


def test_a_changed_mechanism_that_cannot_be_moved_is_stretched_without_limit(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    calls: list[str] = []

    def fails(problem: tb.Problem, *tolerances: float) -> Any:
        calls.append(problem.mechanism.content_hash)
        if len(calls) > 1:
            raise tb.SimulationError("it cannot be moved")
        return solve(problem, *tolerances)

    monkeypatch.setattr(stretchings, "solve", fails)
    _, stretched = _stretched(mechanisms.hanging_bob(), 1.0)
    assert np.isinf(stretched).all() and len(set(calls)) == 2


# the end


@pytest.mark.parametrize(
    ("given", "expected"),
    [
        (None, Until(required=False)),
        ("launch", Until()),
        (" launch:tip ", Until(name="tip")),
        ("release:hanger rest", Until("release", name="hanger rest")),
        ("release: rest ", Until("release", name="rest")),
        ("2.5", Until("time", 2.5)),
        (2, Until("time", 2.0)),
    ],
)
def test_ends_are_read(given: Any, expected: Until) -> None:
    assert repr(Until.of(given)) == repr(expected)


@pytest.mark.parametrize(
    "given",
    [
        "launch:",
        "launch: ",
        "release",
        "release:",
        "release: ",
        "start",
        "",
        "1,5",
        "x" * 60,
        "x" * 61,
    ],
)
def test_ends_of_no_form_are_refused(given: str) -> None:
    shown = given if len(given) <= 60 else "x" * 57 + "..."
    form = "must be 'launch', 'launch:MARKER', 'release:STOP', or a time in seconds"
    with pytest.raises(tb.InputError) as refused:
        Until.of(given)
    assert str(refused.value) == f"until = {shown!r} {form}."


def test_the_marker_that_is_thrown() -> None:
    assert Until.of("launch:tip").thrown == "tip"
    for other in (None, "launch", "1.0", "release:tip"):
        assert Until.of(other).thrown == "projectile"


def test_a_time_is_the_end_and_the_reference_goes_on() -> None:
    solution, end = Until.of(0.5).solve(mechanisms.hanging_bob(), tb.StopLaw.UNILATERAL)
    assert end == 0.5 and solution.problem.duration == pytest.approx(0.7)
    assert solution.problem.stop_law is tb.StopLaw.UNILATERAL
    for time in ("nan", "-1", "0", "inf"):
        with pytest.raises(tb.InputError, match="duration"):
            Until.of(time).solve(mechanisms.hanging_bob(), tb.StopLaw.RELEASE_ONCE)


LAW = tb.StopLaw.RELEASE_ONCE


def test_a_motion_that_does_not_launch_is_refused_if_the_launch_was_asked_for() -> None:
    bob = mechanisms.hanging_bob()
    with pytest.raises(
        tb.InputError, match=r"'pendulum' does not launch within .* s, so there is no end"
    ):
        Until.of("launch").solve(bob, LAW)
    solution, end = Until.of(None).solve(bob, LAW)
    assert end * 1.4 == pytest.approx(solution.problem.duration)
    with pytest.raises(
        tb.InputError, match=r"until = 'launch:tip': 'pendulum' has no such marker: \['bob'\]"
    ):
        Until.of("launch:tip").solve(bob, LAW)
    up = mechanisms.hanging_bob(start=math.pi, start_speeds=(5.0,))
    solution, end = Until.of("launch:bob").solve(up, LAW)
    launch = solution.launch_at(math.pi / 4, "bob")
    assert launch is not None and end == launch.time and solution.problem.duration >= 1.4 * end


def test_the_reference_goes_on_by_two_fifths_beyond_an_event() -> None:
    bob = mechanisms.hanging_bob()
    scale = characteristic_time(bob)
    for event, spans in ((1.42, 2.0), (1.44, 5.5), (3.9, 5.5), (4.0, 16.0), (15.0, 16.0)):
        solution = study._solved(bob, LAW, lambda _, event=event: event * scale)
        assert solution.problem.duration == pytest.approx(spans * scale)


def test_a_release_is_the_end() -> None:
    mechanism = tb.fixed()
    solution, end = Until.of("release:hanger rest").solve(mechanism, LAW)
    assert end == solution.release_times["hanger rest"] == pytest.approx(1.19494, abs=1e-5)
    assert solution.problem.duration >= 1.4 * end
    for name in ("arm stop", "nothing"):
        with pytest.raises(
            tb.InputError, match=f"until = 'release:{name}': 'fixed' has no such closed stop"
        ):
            Until.of(f"release:{name}").solve(mechanism, LAW)
    held = mechanisms.rod_pendulum(
        mechanisms.angle_stop(0.0, body="rod").model_copy(update={"closed": True})
    )
    with pytest.raises(
        tb.InputError, match="until = 'release:stop': the stop does not open within"
    ):
        Until.of("release:stop").solve(held, LAW)
    lifted = mechanisms.rod_pendulum(
        mechanisms.angle_stop(0.0, body="rod").model_copy(
            update={"closed": True, "sense": 1, "limit": 0.0}
        )
    )
    with pytest.raises(
        tb.InputError, match="until = 'release:stop': the stop opens at the start; name another end"
    ):
        Until.of("release:stop").solve(lifted, LAW)
