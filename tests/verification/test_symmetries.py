"""Mirror image, time translation, and a published trap in the order of releases."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
import pytest
import trebucheck as tb
from conftest import machine_parameters
from hypothesis import given
from trebucheck.reference.solver import solve

Build = Callable[..., tb.Mechanism]


def mirrored(mechanism: tb.Mechanism) -> tb.Mechanism:
    """The machine seen in a mirror, x -> -x.

    Angles become pi - q, body points (a, b) become (a, -b).
    """

    def flipped(point: tuple[float, float]) -> tuple[float, float]:
        return (point[0], -point[1])

    fields = mechanism.model_dump()
    for body in fields["bodies"]:
        body["centre"] = flipped(body["centre"])
    for joint in fields["joints"]:
        on_ground = joint["parent"] == "ground"
        x, y = joint["parent_point"]
        joint["parent_point"] = (-x, y) if on_ground else (x, -y)
        joint["child_point"] = flipped(joint["child_point"])
        if "axis" in joint:
            joint["axis"] = (-joint["axis"][0], joint["axis"][1])
    for stop in fields["stops"]:
        if stop["relative_to"] == "ground":
            stop["limit"] -= stop["sense"] * math.pi
        stop["sense"] = -stop["sense"]
    for marker in fields["markers"]:
        marker["point"] = flipped(marker["point"])
    n = len(mechanism.bodies)
    fields["start"] = tuple(math.pi - q for q in mechanism.start[:n]) + mechanism.start[n:]
    return tb.Mechanism(**fields)


@pytest.mark.slow
@given(parameters=machine_parameters())
def test_mirror_image(build: Build, parameters: tb.TrebuchetParameters) -> None:
    machine = build(parameters)
    first, second = (solve(tb.Problem(m, duration=2.2)) for m in (machine, mirrored(machine)))
    t = np.linspace(0.0, 2.2, 50)
    one, other = first.trajectory(t), second.trajectory(t)
    assert len(first.release_times) > 0
    for name, time in first.release_times.items():
        mine = second.release_times[name]
        # Two runs of the integrator: its tolerance of 3e-14 per step, grown by some hundreds in the
        # swing.
        assert (mine is None) == (time is None)
        assert mine is None or mine == pytest.approx(time, abs=1e-11)
    assert len(one.markers) > 0
    for name, motion in one.markers.items():
        expected = motion.position * np.array([-1.0, 1.0])
        assert other.marker(name).position == pytest.approx(expected, abs=1e-9)


@pytest.mark.parametrize("pause", [0.4, 1.3, 2.0])
def test_time_translation(build: Build, pause: float) -> None:
    """A machine stopped anywhere and started again with that state goes on as if nothing had
    been."""
    machine = build()
    whole = solve(tb.Problem(machine, duration=2.4))
    state = whole.motion(np.array([pause]))
    fields = machine.model_dump()
    fields["start"], fields["start_speeds"] = tuple(state.q[0]), tuple(state.u[0])
    for stop in fields["stops"]:
        released = whole.release_times[stop["name"]]
        stop["closed"] = stop["closed"] and (released is None or released > pause)
    closed = {stop["name"] for stop in fields["stops"] if stop["closed"]}
    for stop in fields["stops"]:
        if stop["name"] in closed:  # held gaps are zero to rounding only
            stop["limit"] += float(whole.equations.kinematics.gap(stop["name"], state.q[0]))
    rest = solve(tb.Problem(tb.Mechanism(**fields), duration=2.4 - pause))
    for name in closed:
        expected = whole.release_times[name]
        assert expected is not None
        assert rest.release_times[name] == pytest.approx(expected - pause, abs=1e-12)
    end = np.array([2.4 - pause])
    assert rest.motion(end).q == pytest.approx(whole.motion(end + pause).q, abs=1e-11)


def test_the_hanger_is_released_by_the_torque_of_the_true_active_set(build: Build) -> None:
    """A published simulator asks for the hanger's torque with the sling already free.

    A false, earlier release.
    """
    solution = solve(tb.Problem(build(), duration=2.0))
    hanger, sling = solution.release_times["hanger rest"], solution.release_times["sling rest"]
    assert hanger is not None and sling is not None and hanger < sling
    before = solution.segments[0]
    assert set(before.closed) == {"hanger rest", "sling rest"}
    q, u = np.split(np.asarray(before.interpolant(hanger)), 2)
    start = solution.motion(np.zeros(1)).stop_torques["hanger rest"][0]
    n_loops = solution.equations.n_loops
    true = solution.equations.solve(q, u, before.closed)[1][
        n_loops + before.closed.index("hanger rest")
    ]
    trap = solution.equations.solve(q, u, ("hanger rest",))[1][n_loops]
    assert abs(true) < 1e-6 * start  # the stated need; it is a root, so much less
    assert abs(trap) > 1e-6 * start
