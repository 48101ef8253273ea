"""Batches of launches: what each machine does alone, whatever stands beside it."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
import pytest
import trebucheck as tb
from mechanisms import body_of, everything, hanging_bob, parallel_cranks, pin
from random_mechanisms import random_mechanism
from trebucheck.models.elements import SpringDamper
from trebucheck.models.errors import UnsupportedProblemError
from trebucheck.models.kinematics import Kinematics
from trebucheck.models.mechanism import Marker, Mechanism
from trebucheck.models.problem import Problem, StopLaw
from trebucheck.models.spec import Spec
from trebucheck.reference.solver import solve
from trebucheck.reference.taylor import batch
from trebucheck.reference.taylor.batch import launch_batch, stacked
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
