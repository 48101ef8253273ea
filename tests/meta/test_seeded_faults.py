"""The checks catch seeded faults: a wrong machine or a wrong reading, judged as MuJoCo's assisted
preset would be.

The motions are the reference's own, of a machine or with a reading that is wrong in one place; an
engine that had the fault would show it at least as much.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import cache

import numpy as np
import plugin_engines
import pytest
import trebucheck as tb
from trebucheck.comparisons.runs.record import machine_row
from trebucheck.comparisons.runs.results import Machine, Metric, Outcome, Run
from trebucheck.comparisons.runs.runner import Runner
from trebucheck.comparisons.runs.tolerances import Needs, judge

P = tb.TrebuchetParameters
TABLE_ONE = P()


@cache
def _compared(build: Callable[..., tb.Mechanism]) -> tuple[Runner, Machine]:
    runner = Runner(build())
    return runner, machine_row(runner, Needs())


def _judged(trajectory: tb.Trajectory, build: Callable[..., tb.Mechanism]) -> list[Metric]:
    """Metrics that break the bars of mujoco assisted at 1e-3 s."""
    runner, machine = _compared(build)
    run = Run(
        model=build().name,
        engine="mujoco",
        preset="assisted",
        outcome=Outcome.NOT_JUDGED,
        engine_version="-",
        settings={"timestep": 1e-3},
        metrics=runner.measured(trajectory),
    )
    return [m for m in judge(run, machine) if m.holds is False]


def _moved_by(mechanism: tb.Mechanism, **problem: object) -> tb.Trajectory:
    return tb.engine("reference", timestep=1e-3).simulate(
        tb.Problem(mechanism, duration=2.8, **problem)
    )


def _off_by_a_thousandth(name: str) -> Callable[[Callable[..., tb.Mechanism]], tb.Mechanism]:
    return lambda build: build(P(**{name: getattr(TABLE_ONE, name) * 1.001}))


def _body(mechanism: tb.Mechanism, name: str, **changes: object) -> tb.Mechanism:
    bodies = [
        body.model_dump() | (changes if body.name == name else {}) for body in mechanism.bodies
    ]
    return tb.Mechanism(**{**mechanism.model_dump(), "bodies": bodies})


def _six_digits() -> tb.TrebuchetParameters:
    """As a file format that keeps six digits would have it: only the angles have more."""
    return P(**{name: float(f"{getattr(TABLE_ONE, name):.6g}") for name in P.model_fields})


WRONG_MACHINES: dict[str, Callable[[Callable[..., tb.Mechanism]], tb.Mechanism]] = {
    **{
        f"{name} off by 0.1 %": _off_by_a_thousandth(name)
        for name in ("l1", "l2", "r", "h", "m_b", "m_cw", "m_a", "g")
    },
    "gravity 9.80665": lambda build: build(P(g=9.80665)),
    "start of the hanger 0.1 deg off": lambda build: build(
        P(alpha0=TABLE_ONE.alpha0 + np.radians(0.1))
    ),
    "start of the sling 0.1 deg off": lambda build: build(P(phi0=TABLE_ONE.phi0 + np.radians(0.1))),
    "hanger's angle with the wrong sign": lambda build: build(P(alpha0=-TABLE_ONE.alpha0)),
    "arm's inertia about its end": lambda build: _body(
        build(), "arm", inertia=1000.0 * 14.0**2 / 3
    ),
    "arm's inertia off by 0.1 %": lambda build: _body(
        build(), "arm", inertia=build().body("arm").inertia * 1.001
    ),
    "a sphere's inertia on the projectile": lambda build: _body(
        build(), "sling", inertia=0.4 * 60.0 * 0.1**2
    ),
    "six digits of every number": lambda build: build(_six_digits()),
}


@pytest.mark.parametrize("build", [tb.fixed, tb.rolling], ids=["fixed", "rolling"])
@pytest.mark.parametrize("fault", WRONG_MACHINES)
def test_a_wrong_machine_is_caught(fault: str, build: Callable[..., tb.Mechanism]) -> None:
    wrong = WRONG_MACHINES[fault](build)
    trajectory = replace(_moved_by(wrong), mechanism=build())
    assert _judged(trajectory, build)


def _without_stop(trajectory: tb.Trajectory, name: str) -> tb.Trajectory:
    mechanism = trajectory.mechanism
    stops = [stop for stop in mechanism.stops if stop.name != name]
    free = _moved_by(
        tb.Mechanism(**{**mechanism.model_dump(), "stops": [s.model_dump() for s in stops]})
    )
    nothing = np.zeros(len(free.t))
    return replace(
        free,
        mechanism=mechanism,
        stop_torques={**free.stop_torques, name: nothing},
        release_times={**free.release_times, name: 0.0},
    )


WRONG_READINGS: dict[str, Callable[[tb.Trajectory], tb.Trajectory]] = {
    "hanger rest missing": lambda t: _without_stop(t, "hanger rest"),
    "sling rest missing": lambda t: _without_stop(t, "sling rest"),
    "time shifted by half a step": lambda t: replace(t, t=np.concatenate([[0.0], t.t[1:] - 5e-4])),
    "torques scaled by 1.001": lambda t: replace(
        t, stop_torques={n: v * 1.001 for n, v in t.stop_torques.items()}
    ),
    "release at the step's end": lambda t: replace(
        t,
        release_times={n: v and float(np.ceil(v * 1e3) / 1e3) for n, v in t.release_times.items()},
    ),
    "a stop that never opens": lambda t: replace(
        t, release_times={**t.release_times, "sling rest": None}
    ),
    "kinetic energy of the step before": lambda t: replace(
        t, kinetic_energy=np.roll(t.kinetic_energy, 1)
    ),
}


@pytest.mark.parametrize("build", [tb.fixed, tb.rolling], ids=["fixed", "rolling"])
@pytest.mark.parametrize("fault", WRONG_READINGS)
def test_a_wrong_reading_is_caught(fault: str, build: Callable[..., tb.Mechanism]) -> None:
    assert _judged(WRONG_READINGS[fault](_moved_by(build())), build)


@pytest.mark.parametrize("build", [tb.fixed, tb.rolling], ids=["fixed", "rolling"])
def test_what_is_right_is_not_flagged(build: Callable[..., tb.Mechanism]) -> None:
    assert not _judged(_moved_by(build()), build)
    other_tolerance = tb.engine("reference", timestep=1e-3, rtol=1e-12, atol=1e-12)
    assert not _judged(other_tolerance.simulate(tb.Problem(build(), duration=2.8)), build)


def test_a_lying_plug_in_is_caught() -> None:
    """0.1 % too heavy a projectile, in an engine of a third party."""
    assert _judged(plugin_engines.Liar().simulate(tb.Problem(tb.fixed(), duration=2.8)), tb.fixed)
