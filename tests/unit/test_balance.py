"""The balance of energy with dampers and motors, momentum as an invariant, and the scales of sprung
mechanisms.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
import trebucheck as tb
from trebucheck.comparisons.runs import balance
from trebucheck.comparisons.runs.metrics import measure
from trebucheck.comparisons.runs.quantities import JUDGED
from trebucheck.comparisons.runs.results import Metric
from trebucheck.comparisons.runs.scales import scales_until
from trebucheck.comparisons.runs.stretching import stretching_until
from trebucheck.comparisons.runs.tolerances import AppliedTolerance, _held_against
from trebucheck.models.library.registry import benchmark
from trebucheck.reference.solver import solve

STIFFNESS, MASS, OUT = 100.0, 4.0, 0.3
SPRING = tb.SpringDamper(
    name="spring", body="block", point=(0, 0), relative_point=(0, 0), stiffness=STIFFNESS
)


def _block(*elements: Any, stops: tuple[Any, ...] = (), **changes: Any) -> tb.Mechanism:
    """4 kg on a level rail, 0.3 m out; without force elements on a spring of 100 N/m: 5 rad/s."""
    fields: dict[str, Any] = {
        "name": "block",
        "bodies": (tb.Body(name="block", mass=MASS, centre=(0, 0), inertia=0.0),),
        "joints": (
            tb.PrismaticJoint(
                name="rail",
                child="block",
                parent_point=(0, 0),
                child_point=(0, 0),
                axis=(1, 0),
                coordinate="x",
            ),
        ),
        "stops": stops,
        "force_elements": elements or (SPRING,),
        "markers": (tb.Marker(name="block", body="block", point=(0, 0)),),
        "gravity": 0.0,
        "start": (OUT,),
    }
    return tb.Mechanism(**(fields | changes))


def _damped(damping: float) -> tb.SpringDamper:
    return SPRING.model_copy(
        update={"damping": damping, "relative_point": (-2, 0), "rest_length": 2.0}
    )


def _wall(restitution: float) -> tb.PointStop:
    return tb.PointStop(
        name="wall",
        body="block",
        point=(0, 0),
        normal=(1, 0),
        offset=0.05,
        closed=False,
        restitution=restitution,
    )


def _solved(mechanism: tb.Mechanism, tolerance: float = 1e-11) -> Any:
    problem = tb.Problem(mechanism, duration=2.0, stop_law=tb.StopLaw.UNILATERAL)
    return solve(problem, tolerance, tolerance)


def test_what_does_work() -> None:
    torque = tb.ConstantTorque(name="t", body="block", torque=1.0)
    force = tb.ConstantForce(name="f", body="block", point=(0, 0), force=(1.0, 0.0))
    twist = tb.RotationalSpringDamper(name="r", body="block", stiffness=1.0)
    for elements, works in (
        ((SPRING,), False), ((twist,), False), ((twist.model_copy(update={"damping": 0.1}),), True),
        ((SPRING, _damped(0.1)), True), ((force,), True), ((torque,), True),
    ):  # fmt: skip
        named = [element.model_copy(update={"name": f"e{i}"}) for i, element in enumerate(elements)]
        assert balance.does_work(_block(*named)) is works


@pytest.mark.parametrize("step", [1e-3, 1e-2, 4e-2])
@pytest.mark.parametrize("stops", [(), (_wall(0.7),)], ids=["smooth", "impacts"])
def test_the_balance_of_energy_is_known_to_what_the_samples_leave_unknown(
    step: float, stops: tuple[Any, ...]
) -> None:
    """A damped block, also with impacts.

    The reference's balance is constant between them, an engine's nearly.
    """
    block = _block(_damped(2.0), stops=stops)
    solution, own = (
        _solved(block, 3e-14),
        _solved(block).trajectory(np.arange(0, 2.0 - step / 3, step)),
    )
    (metric,) = (m for m in measure(own, solution, 1.99) if m.name == "energy_balance")
    assert metric.value is not None and metric.sampling_error is not None
    assert metric.value < metric.sampling_error + 1e-9
    assert metric.sampling_error < 9.0 * (
        (5 * step) ** 2 if stops else (2 * 5 * step) ** 4
    )  # of 9 W at most
    t = np.linspace(0.0, 2.0, 2001)
    kept = balance.reference_balance(solution, solution.trajectory(t))
    lost = np.abs(np.diff(kept)) > 1e-11
    assert lost.sum() == len(solution.impacts) == (5 if stops else 0)
    assert all(np.any(lost & (t[:-1] <= time) & (time <= t[1:])) for time, _ in solution.impacts)


def test_the_work_of_a_motor_in_closed_form() -> None:
    """A constant force does F x.

    With a damper between angles that does not turn nothing else does any.
    """
    pushed = _block(tb.ConstantForce(name="push", body="block", point=(0, 0), force=(3.0, 5.0)))
    solution = _solved(pushed)
    t = np.linspace(0.0, 2.0, 201)
    assert balance.reference_work(solution, t) == pytest.approx(
        3.0 * 0.5 * 3.0 / MASS * t**2, abs=1e-11
    )


def test_a_damper_that_is_too_weak_breaks_the_balance() -> None:
    right, weak = _block(_damped(2.0)), _block(_damped(1.9))
    own = replace(_solved(weak).trajectory(np.linspace(0.0, 2.0, 2001)), mechanism=right)
    solution = _solved(right)
    (metric,) = (m for m in measure(own, solution, 1.9) if m.name == "energy_balance")
    assert metric.value is not None
    assert (
        metric.value > 10e-3 * scales_until(solution, 1.9).energy
    )  # ten times the default tolerance


@pytest.mark.parametrize(
    ("value", "unknown", "tolerance", "judged"),
    [
        (0.9, 5.0, 1.0, True),  # holds as it is
        (1.4, 0.5, 1.5, True),  # holds with what is unknown
        (1.6, 0.5, 1.5, False),
        (4.0, 5.0, None, None),  # only what is unknown could decide
        (7.0, 5.0, 6.0, False),
    ],
)
def test_what_the_samples_leave_unknown_is_added_to_the_tolerance(
    value: float, unknown: float, tolerance: float | None, judged: bool | None
) -> None:
    metric = Metric(name="energy_balance", value=value, unit="J", sampling_error=unknown)
    found = _held_against(metric, AppliedTolerance(1.0, "default", "stated"), 1.0)
    assert found.holds is judged
    assert found.tolerance == (1.0 if value < 1 else tolerance)
    assert found.unjudged is (judged is None) and (found.note is None) is (judged is not None)


def test_samples_beside_several_impacts() -> None:
    """A power that is 1 W until 0.35 s, nothing until 0.37 s, and 3 W later.

    0.35 + 1.89 J at 1 s.
    """
    t = np.linspace(0.0, 1.0, 11)
    work, error = balance._integrated(t, np.where(t < 0.36, 1.0, 3.0), [0.35, 0.37])
    assert work[3] == pytest.approx(0.3) and error[3] == pytest.approx(0.0, abs=1e-15)
    assert abs(work[-1] - (0.35 + 3 * 0.63)) <= error[-1] == pytest.approx(0.1 * 2)


@pytest.mark.parametrize("last", [False, True])
def test_an_impact_in_the_first_or_the_last_interval(last: bool) -> None:
    """A power of 2 W up to the impact and of 5 W after it, or back: by straight lines, exactly."""
    t = np.array([0.0, 0.1, 0.3, 0.6, 1.0])
    impact, before, after = (0.9, 2.0, 5.0) if last else (0.05, 2.0, 5.0)
    work, error = balance._integrated(t, np.where(t < impact, before, after), [impact])
    assert work == pytest.approx(before * np.minimum(t, impact) + after * np.maximum(t - impact, 0))
    assert error == pytest.approx(np.zeros(5), abs=1e-14)


def test_the_error_across_an_impact_is_the_change_of_power_beside_it() -> None:
    """By 1 W in the interval before it and by 4 W in the one after it, over its own 0.2 s."""
    t = np.array([0.0, 0.1, 0.3, 0.4])
    value, error = balance._across(t, np.array([1.0, 2.0, 7.0, 3.0]), 2, [0.25])
    assert value == pytest.approx(2.0 * 0.15 + 7.0 * 0.05) and error == pytest.approx(0.2 * 5.0)


# momentum


def _free(**changes: Any) -> tb.Mechanism:
    joint = tb.FreeJoint(name="free", child="block", coordinates=("x", "y"))
    fields = {"joints": (joint,), "start": (0.0, OUT, 0.1), "gravity": 9.81}
    body = tb.Body(name="block", angle="a", mass=MASS, centre=(0, 0), inertia=0.1)
    twist = tb.RotationalSpringDamper(name="twist", body="block", stiffness=1.0)
    return _block(twist, **(fields | {"bodies": (body,)} | changes))


def test_horizontal_momentum_is_an_invariant_where_nothing_from_outside_acts_along_x() -> None:
    lift = tb.ConstantForce(name="lift", body="block", point=(0, 0), force=(0.0, 2.0))
    push = lift.model_copy(update={"force": (1e-9, 2.0)})
    invariant = balance.keeps_horizontal_momentum
    assert invariant(_free()) and invariant(_free(force_elements=(lift,)))
    assert invariant(_free(gravity=0.0, gravity_direction=(1.0, 0.0)))
    assert not invariant(_free(gravity_direction=(0.6, -0.8)))
    assert not invariant(_free(force_elements=(push,))) and not invariant(
        _free(force_elements=(SPRING,))
    )
    assert (
        invariant(_block(lift))
        and not invariant(_block())
        and not invariant(_block(lift, stops=(_wall(0.0),)))
    )
    upright = _block(lift).joints[0].model_copy(update={"axis": (0.0, 1.0)})
    assert not invariant(_block(lift, joints=(upright,)))


# scales and stretching


def test_scales_of_a_block_on_a_spring() -> None:
    """It has no length of its own: that of its way; no joint force.

    And the time of its spring, not of its way.
    """
    scales = scales_until(solve(tb.Problem(_block(), duration=2.0)), 2.0)
    assert scales.length == pytest.approx(2 * OUT, rel=1e-3)
    assert scales.time == pytest.approx(
        math.sqrt(MASS / STIFFNESS)
    ) and scales.speed == pytest.approx(5 * OUT, rel=1e-3)
    assert scales.force == pytest.approx(STIFFNESS * OUT) and scales.energy == pytest.approx(
        STIFFNESS * OUT**2, rel=1e-3
    )


def test_a_spring_that_is_not_known_stretches_the_motion() -> None:
    """A part e more stiffness makes x = OUT cos(wt) earlier by e wt / 2.

    Its speed, in parts of the largest.
    """
    solution = solve(tb.Problem(_block(), duration=2.0))
    found = stretching_until(solution, 2.0, scales_until(solution, 2.0))
    wt = 5.0 * found.t
    expected = np.maximum.accumulate(np.abs(np.sin(wt) + wt * np.cos(wt))) / 2
    assert found.parameters == pytest.approx(expected, rel=0.02, abs=5e-3)


def test_subjects_of_free_and_sliding_bodies() -> None:
    sliding = {title: JUDGED[title].subjects(_block()) for title in ("angle", "slide", "reaction")}
    assert sliding == {"angle": (), "slide": ("x",), "reaction": ("rail",)}
    free = {title: JUDGED[title].subjects(_free()) for title in ("angle", "slide", "reaction")}
    assert free == {"angle": ("a",), "slide": ("x", "y"), "reaction": ()}
    labels = {
        m.label
        for m in measure(_solved(_free()).trajectory(np.linspace(0, 1, 50)), _solved(_free()), 1.0)
    }
    assert {"angle_max (a)", "slide_max (x)", "slide_max (y)", "horizontal_momentum"} <= labels
    assert not any(label.startswith("joint_reaction") for label in labels)


def test_a_claim_is_widened_up_to_the_default() -> None:
    metric = Metric(name="energy_balance", value=0.04, unit="J", sampling_error=0.05)
    claim = AppliedTolerance(0.01, "claim", "stated")
    assert _held_against(metric, claim, 1.0).tolerance == pytest.approx(0.06)
    assert _held_against(metric, claim, 0.04).unjudged
    assert _held_against(metric, replace(claim, source="need"), 1.0).unjudged


def test_slides_on_bodies_are_lengths() -> None:
    """A bob 0.8 m out on a rod that turns without length of its own.

    On a ground rail only the way counts.
    """
    rod = tb.Body(name="rod", angle="a", mass=1.0, centre=(0, 0), inertia=0.0004)
    pin = tb.PinJoint(
        name="pin", parent="ground", child="rod", parent_point=(0, 0), child_point=(0, 0)
    )
    rail = _block().joints[0].model_copy(update={"parent": "rod"})
    spring = SPRING.model_copy(update={"relative_to": "rod", "rest_length": 0.5})
    turning = _block(
        spring, bodies=(rod, *_block().bodies), joints=(pin, rail), start=(0.3, 0.8), gravity=9.81
    )
    assert scales_until(solve(tb.Problem(turning, duration=0.01)), 0.01).length == pytest.approx(
        0.02 + 0.8, rel=1e-3
    )
    tied = SPRING.model_copy(update={"relative_point": (0, 1.5), "rest_length": 1.0})
    hung = _free(force_elements=(tied,), gravity=0.0)
    assert scales_until(solve(tb.Problem(hung, duration=0.01)), 0.01).length == pytest.approx(
        math.hypot(OUT, 1.4), rel=1e-3
    )
    far = _block(SPRING.model_copy(update={"relative_point": (1000, 0)}), start=(1000 + OUT,))
    assert scales_until(solve(tb.Problem(far, duration=2.0)), 2.0).length == pytest.approx(
        2 * OUT, rel=1e-3
    )


def test_forces_are_not_compared_beside_a_singular_position() -> None:
    """The four-bar of which all pins come to lie on one line: there its joint forces have poles."""
    problem = benchmark("n-four-bar").problem()
    solution = solve(tb.Problem(problem.mechanism, duration=2.0))
    first = solution.singular_passages[0].time
    t = np.linspace(0.0, 1.0, 1001)
    run = solution.trajectory(t)
    scales = scales_until(solution, 1.0)
    joint = next(iter(run.joint_reactions))

    def error(shift: float) -> float:
        """Of a force that is wrong by 1 N at one time, the passage and so much later."""
        wrong = run.joint_reactions[joint] + (np.abs(t - first - shift) < 6e-4)[:, None] * np.array(
            [1.0, 0.0]
        )
        spoilt = replace(run, joint_reactions={**run.joint_reactions, joint: wrong})
        found = {m.label: m.value for m in measure(spoilt, solution, 1.0, scales=scales)}
        return found[f"joint_reaction_max ({joint})"] or 0.0

    assert error(0.0) < 1e-6 and error(0.15 * scales.time) == pytest.approx(1.0)
    found = stretching_until(
        solve(problem), problem.duration, scales_until(solve(problem), problem.duration)
    )
    assert found.horizon == problem.duration


def test_five_samples_are_enough_to_know_the_error_of_simpsons_rule() -> None:
    """A parabola is integrated without error by every sample and by every second one."""
    t = np.linspace(0.0, 1.0, 5)
    work, error = balance._simpson(t, t**2)
    assert work[-1] == pytest.approx(1 / 3, rel=1e-12)
    assert error == pytest.approx(np.zeros(5), abs=1e-12)
    assert balance._simpson(t[:4], t[:4] ** 2)[1][-1] > 1e-3
