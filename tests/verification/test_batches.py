"""Batches of launches: what each machine does alone, whatever stands beside it."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
import pytest
import trebucheck as tb
from mechanisms import body_of, everything, hanging_bob, parallel_cranks, pin
from trebucheck.comparisons.campaigns.random_mechanisms import random_mechanism
from trebucheck.models.elements import SpringDamper
from trebucheck.models.errors import UnsupportedProblemError
from trebucheck.models.kinematics import Kinematics
from trebucheck.models.library.registry import varied
from trebucheck.models.mechanism import Marker, Mechanism
from trebucheck.models.problem import Problem, StopLaw
from trebucheck.models.spec import Spec
from trebucheck.models.stacked import columns_of, numbers, stack_of, stacked
from trebucheck.reference.solver import solve
from trebucheck.reference.taylor import batch
from trebucheck.reference.taylor.batch import launch_batch
from trebucheck.reference.taylor.numbers import numbers_of, projectile_row
from trebucheck.reference.taylor.solve import taylor_quantities

_PARTS = ("bodies", "joints", "stops", "markers", "force_elements")
ROUNDING = 1e-13  # of sums of some ten products of numbers of size 1 to 10


def _shaken(spec: Spec, random: np.random.Generator) -> Spec:
    """With each number, or component of a vector, changed by a thousandth; nothing is validated."""
    fields: dict[str, object] = {}
    for name, value in spec:
        if name in _PARTS:
            fields[name] = tuple(_shaken(part, random) for part in value)
        elif isinstance(value, float):
            fields[name] = value * random.uniform(0.999, 1.001)
        elif isinstance(value, tuple) and all(
            isinstance(component, float | int) for component in value
        ):
            fields[name] = tuple(component * random.uniform(0.999, 1.001) for component in value)
    return spec.model_copy(update=fields)


@pytest.mark.parametrize(
    "mechanism", [everything(), *(random_mechanism(seed) for seed in range(12))]
)
def test_stacked_mechanisms_have_the_numbers_of_each(mechanism: Mechanism) -> None:
    random = np.random.default_rng(5)
    each = [_shaken(mechanism, random) for _ in range(3)]
    ((indices, one),) = stacked(each)  # type: ignore[arg-type]
    assert indices.tolist() == [0, 1, 2]

    def values(mechanism: Mechanism) -> tuple[object, ...]:
        problem = Problem(everything(), 1.0, stop_law=StopLaw.UNILATERAL).model_copy(
            update={"mechanism": mechanism}
        )
        kinematics, q = Kinematics(mechanism), np.array(mechanism.start).T
        gaps = np.stack(
            [kinematics.gap(stop.name, q) for stop in mechanism.stops] or [np.zeros_like(q[..., 0])]
        )
        scale = kinematics.speed_scale(projectile_row(mechanism, kinematics))
        return (
            numbers_of(problem, kinematics, np.float64),
            kinematics.loop_residual(q),
            gaps.T,
            scale,
        )

    for i, alone in enumerate(each):
        for together, expected in zip(values(one), values(alone), strict=True):  # type: ignore[arg-type]
            assert np.array(together)[i] == pytest.approx(
                np.array(expected), rel=ROUNDING, abs=ROUNDING
            )


def test_mechanisms_of_several_kinds_are_stacked_apart() -> None:
    machines = [
        tb.fixed(),
        tb.rolling(),
        tb.fixed(tb.TrebuchetParameters(l1=9.0)).model_copy(update={"name": "third"}),
    ]
    groups = list(stacked(machines))
    assert [indices.tolist() for indices, _ in groups] == [[0, 2], [1]]
    pins = {joint.name: joint for joint in groups[0][1].joints}
    assert np.array_equal(pins["sling pin"].parent_point[0], [10.0, 9.0])


def _overarm(
    stiffness: float = 0.0, damping: float = 0.0, rest_length: float = 0.0, speed: float = 9.0
) -> Mechanism:
    """A bob that is swung over the top from the left, tied to a point aside."""
    tie = SpringDamper(
        name="tie",
        body="bob",
        point=(2.0, 0),
        relative_point=(0.5, 3.0),
        stiffness=stiffness,
        damping=damping,
        rest_length=rest_length,
    )
    marker = Marker(name="projectile", body="bob", point=(2.0, 0))
    return hanging_bob(
        start=math.pi, start_speeds=(speed,), force_elements=(tie,), markers=(marker,)
    )


def _assert_as_alone(machines: Sequence[Mechanism], duration: float) -> None:
    together = launch_batch(machines, duration)
    for i, machine in enumerate(machines):
        alone = taylor_quantities(Problem(machine, duration), "double", tolerance=1e-12)
        assert together.launched[i] == (alone.launch_time is not None)
        if alone.launch_time is not None:
            # The same tolerance, 1e-12 a step, over some ten steps.
            assert together.time[i] == pytest.approx(float(alone.launch_time), abs=1e-11)
            assert together.velocity[i] == pytest.approx(alone.launch_velocity, abs=1e-10)


@pytest.mark.slow
def test_what_one_machine_alone_has_moves_it() -> None:
    """The first machine's tie is without stiffness, damping and rest length.

    Others' numbers count none the less.
    """
    pytest.importorskip("heyoka")
    ties = [(), (30.0, 5.0, 1.0)]
    _assert_as_alone([_overarm(*tie) for tie in ties], duration=2.0)


@pytest.mark.slow
def test_a_batch_may_come_from_an_iterator_and_in_parts(monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("heyoka")
    machines = [_overarm(stiffness, speed=9.0 + stiffness / 10) for stiffness in range(0, 23)]
    whole = launch_batch(machines, duration=2.0)
    monkeypatch.setattr(batch, "_CHUNK", 5)
    parts = launch_batch(iter(machines), duration=2.0)
    for name in ("launched", "time", "velocity", "q", "u"):
        assert getattr(parts, name) == pytest.approx(getattr(whole, name), abs=1e-11)
    assert whole.launched.all()
    with pytest.raises(tb.InputError, match=r"mechanisms\[7\] \('rolling'\)"):
        launch_batch([*machines[:7], tb.rolling()], duration=2.0)


def _four_bar(speed: float, start: float) -> Mechanism:
    """A02 of the IFToMM benchmarks with one window: rods of 1 m and 1 kg.

    Singular where all of them are level.
    """
    rods = (
        ("crank", "ground", (0, 0)),
        ("follower", "ground", (1.0, 0)),
        ("coupler", "crank", (1.0, 0)),
    )
    return Mechanism(
        name="four-bar",
        bodies=tuple(body_of(name, f"{name} angle", 1.0, (0.5, 0), 1 / 12) for name, _, _ in rods),
        joints=(
            *(pin(f"{name} pin", parent, name, at) for name, parent, at in rods),
            pin("loop", "coupler", "follower", (1.0, 0), (1.0, 0)),
        ),
        markers=(Marker(name="projectile", body="crank", point=(1.0, 0)),),
        gravity=9.81,
        start=(start, start, 0.0),
        start_speeds=(speed, speed, 0.0),
    )


@pytest.mark.slow
def test_machines_pass_singular_positions_or_say_why_not() -> None:
    """From the top two singular positions come before the launch at 5 pi / 4.

    Below, some swing into one and back.
    """
    pytest.importorskip("heyoka")
    speeds = (0.5, 1.6, 3.0)
    machines = [
        _four_bar(speed, start) for start in (-math.pi / 2, math.pi + 0.5) for speed in speeds
    ]
    machines.append(
        _four_bar(2.0, 0.0)
    )  # it starts in a singular position, and swings to the other one and back
    found = launch_batch(machines, duration=3.0)
    for i, machine in enumerate(machines):
        solution = solve(Problem(machine, 3.0))
        if i in found.failures:
            assert not found.launched[i] and "singular position" in found.failures[i]
        elif solution.launch is None:
            assert not found.launched[i]
        else:
            # Behind each passage the branch is known to 1e-9 of the largest arm.
            assert found.time[i] == pytest.approx(solution.launch.time, abs=1e-8)
            assert found.velocity[i] == pytest.approx(solution.launch.velocity, abs=1e-7)
    assert found.launched[:3].all() and not any(i in found.failures for i in range(3))


@pytest.mark.slow
def test_constraints_that_depend_on_each_other_are_refused() -> None:
    pytest.importorskip("heyoka")
    beam = parallel_cranks(3, start=0.3)
    marked = beam.model_copy(
        update={"markers": (Marker(name="projectile", body=beam.bodies[0].name, point=(1.0, 0)),)}
    )
    with pytest.raises(
        UnsupportedProblemError,
        match="the Taylor integrator needs constraints that are independent",
    ):
        launch_batch([marked], duration=1.0)


# from arrays of parameters

WHIPPERS = {
    "l1": (7.0, 12.5),
    "l2": (2.5, 5.0),
    "r": (4.0, 8.0),
    "h": (6.0, 12.0),
    "m_b": (30.0, 150.0),
    "m_cw": (1500.0, 5000.0),
    "theta0": (-1.0, 1.5),
    "phi0": (0.0, 6.0),
    "alpha0": (-3.0, 3.0),
}
"""Machines whose rests open in any order, or at once; some roll about for ever."""


@pytest.mark.slow
@pytest.mark.parametrize("name", ["fixed", "rolling"])
def test_launches_from_arrays_are_those_of_each_machine(
    name: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """By the equations with stops alone, and by those without where none holds any more."""
    pytest.importorskip("heyoka")
    random, n = np.random.default_rng(7), 60
    values = {field: random.uniform(*limits, n) for field, limits in WHIPPERS.items()}
    found = tb.launches(name, values, duration=3.5)
    monkeypatch.setattr(batch, "_MANY", n)
    many = tb.launches(name, values, duration=3.5)
    assert many.launched.tolist() == found.launched.tolist()
    assert many.time == pytest.approx(found.time, abs=1e-7, nan_ok=True)
    first_opened: set[str] = set()
    for i in range(n):
        parameters = tb.TrebuchetParameters(**{field: v[i] for field, v in values.items()})
        problem = Problem(tb.model(name, parameters), duration=3.5)
        alone = taylor_quantities(problem, "double", tolerance=1e-13)
        assert found.launched[i] == (alone.launch_time is not None)
        if alone.launch_time is None or alone.launch_velocity is None:
            assert np.isnan(found.time[i]) and np.isnan(found.velocity[i]).all()
            continue
        # A hundred steps of 1e-10 each, in motions that magnify an error ten times.
        assert found.time[i] == pytest.approx(float(alone.launch_time), abs=1e-7)
        assert found.velocity[i] == pytest.approx(alone.launch_velocity, abs=1e-6)
        opened = {n: float(t) for n, t in alone.release_times.items() if t is not None}
        for stop, time in opened.items():
            if time <= alone.launch_time:
                assert found.release_times[stop][i] == pytest.approx(time, abs=1e-7)
        first_opened.add(min(opened, key=lambda stop: opened[stop]))
    assert first_opened == {"hanger rest", "sling rest"}
    assert 0 < found.launched.sum() < n


@pytest.mark.slow
def test_any_number_of_a_mechanism_may_be_an_array() -> None:
    pytest.importorskip("heyoka")
    stiffness, speed = np.linspace(0.0, 30.0, 9), np.linspace(9.0, 12.0, 9)
    machines = [_overarm(*row) for row in zip(stiffness, [0.1] * 9, [1.0] * 9, speed, strict=True)]
    paths = {"force_elements.tie.stiffness": stiffness, "start_speeds.0": speed}
    found = tb.launches(_overarm(5.0, 0.1, 1.0), paths, duration=2.0, tolerance=1e-12)
    expected = launch_batch(machines, duration=2.0)
    assert found.launched.any()
    for name in ("time", "velocity", "q", "u"):
        assert getattr(found, name) == pytest.approx(
            getattr(expected, name), abs=1e-11, nan_ok=True
        )


def test_a_single_number_stands_for_all_machines() -> None:
    machines = varied("fixed", {"l1": [9, 10, 11], "m_cw": 2500})
    assert [machine.body("hanger").mass for machine in machines] == [2500.0] * 3
    assert machines[1] == tb.fixed(tb.TrebuchetParameters(m_cw=2500.0))
    assert [m.body("arm").centre[0] for m in machines[1:]] == [3.0, 3.5]


def test_parameters_of_other_machines_may_be_arrays() -> None:
    machines = varied("hinged", {"theta0": [2.2, 2.4], "m_cw": [2500.0, 3000.0]})
    assert machines[1] == tb.hinged(tb.HingedParameters(theta0=2.4, m_cw=3000.0))


BEYOND = {
    "negative": ("fixed", {"l1": [9.0, -3.0]}, ("1", "l1", "-3.0")),
    "too large": ("fixed", {"theta0": [0.0, 13.0]}, ("1", "theta0", "13.0")),
    "no number": ("rolling", {"r": [6.0, 7.0, math.nan]}, ("2", "r", "nan")),
    "infinite": ("rolling", {"r": [6.0, -math.inf]}, ("1", "r", "-inf")),
    "overflow": ("fixed", {"l2": [4.0, 1e200]}, ("1", "l2", "1e+200")),
    "stop in the way": ("fixed", {"theta0": [0.0, 10.0]}, ("1", "theta0", "10.0", "arm stop")),
    "of another machine": ("hinged", {"m_b": [60.0, 0.0]}, ("1", "m_b", "0.0")),
    "field": ("fixed", {"bodies.arm.mass": [1e3, 0.0]}, ("1", "bodies.arm.mass", "0.0")),
    "gap": ("fixed", {"start.1": [math.pi, 3.2]}, ("1", "start.1", "3.2", "sling rest")),
    "axis": ("rolling", {"joints.fulcrum.axis.1": [0.0, 0.1]}, ("1", "0.1", "length 1")),
    "open loop": ("floating-arm", {"joints.track.child_point.1": [0, 0.3]}, ("1", "0.3", "track")),
    "no field": ("fixed", {"bodies.arm.mas": [1.0]}, ("bodies.arm.mas", "bodies.arm.mass")),
    "no parameter": ("fixed", {"l1": [9.0], "l3": [1.0]}, ("l3", "l2")),
    "lengths": ("fixed", {"l1": [9.0, 9.5], "r": [6.0, 6.5, 7.0]}, ("l1", "2", "r", "3")),
    "text": ("fixed", {"l1": ["9"]}, ("l1", "'9'")),
    "truth": ("fixed", {"l1": [True]}, ("l1", "True")),
    "table": ("fixed", {"l1": [[9.0]]}, ("l1", "[[9.0]]")),
    "none": ("fixed", {"l1": []}, ("l1", "[]")),
    "nothing": ("fixed", {}, ("values",)),
}
"""A model, values of which one cannot be built, and what the sentence has to name."""


@pytest.mark.parametrize("case", BEYOND)
def test_values_that_no_machine_takes_are_refused(case: str) -> None:
    model, values, named = BEYOND[case]
    with pytest.raises(tb.InputError) as refusal:
        tb.launches(model, values)
    for name in named:
        assert name in str(refusal.value)


AMONG = {
    "stop": (
        tb.fixed(),
        {"start.1": [3.0, 3.1, 3.2, 3.3], "stops.sling rest.limit": [3.0, 3.1, 3.15, 3.3]},
    ),
    "direction": (
        tb.rolling(),
        {
            "joints.fulcrum.axis.0": [1.0, 0.8, 0.7, 0.0],
            "joints.fulcrum.axis.1": [0.0, 0.6, 0.7, 1.0],
        },
    ),
    "spring": (
        _overarm(rest_length=1.0),
        {
            "force_elements.tie.relative_point.0": [-3.0, -2.0, -2.0, -1.0],
            "force_elements.tie.relative_point.1": [-1.0, 3.0, 0.0, 1.0],
        },
    ),
    "loop": (
        _four_bar(1.0, 0.5),
        {"start.0": [0.4, 0.5, 0.45, 0.6], "start.1": [0.4, 0.5, 0.55, 0.6]},
    ),
}
"""Numbers that fit together but in machine 2, none of which is the least or the largest."""


@pytest.mark.parametrize("case", AMONG)
def test_one_machine_whose_numbers_do_not_fit_is_found(case: str) -> None:
    mechanism, values = AMONG[case]
    columns = columns_of(values)
    with pytest.raises(tb.InputError, match="machine 2 "):
        stack_of(mechanism, columns).refuse()
    fits = {name: np.delete(column, 2) for name, column in columns.items()}
    stack_of(mechanism, fits).refuse()


@pytest.mark.parametrize("mechanism", [everything(), _overarm(rest_length=1.0)])
def test_arrays_are_refused_where_a_machine_alone_is(mechanism: Mechanism) -> None:
    for name, value in numbers(mechanism).items():
        for x in (value + 1e-3, value - 0.7, -1e3):
            machines = stack_of(mechanism, {name: np.array([value, x])})
            try:
                assert numbers(machines[1])[name] == x
            except tb.InputError:
                with pytest.raises(tb.InputError, match="machine 1 "):
                    machines.refuse()
            else:
                machines.refuse()
