"""pymunk and records of efforts: order against the reference, closed forms, stops, programs."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
import records
import trebucheck as tb
from mechanisms import body_of, pin, slider_crank
from records import INERTIA, push, record, summed
from trebucheck.comparisons.diagnosis.equivalence import check_model
from trebucheck.engines.presets import ASSISTED, DEFAULT, PRESETS, SETTINGS
from trebucheck.models.elements import GROUND
from trebucheck.reference.solver import solve

pytest.importorskip("pymunk")

ALONE = (DEFAULT, SETTINGS)
TIMES, EFFORTS = (0.0, 0.24, 0.4, 0.56), (3.0, -7.0, 0.0, 5.0)
DURATION = 0.8
STEPS = (4e-3, 2e-3, 1e-3)
"""Each instant is at a whole number of them."""
ORDER = {DEFAULT: 1, SETTINGS: 1, ASSISTED: 2}


def torque(body: str, **fields: Any) -> tb.RecordedTorque:
    """A record of torques that change their sign."""
    made = {"name": f"{body} motor", "body": body, "times": TIMES, "torques": EFFORTS}
    return record(**(made | fields))


def force(body: str, **fields: Any) -> tb.RecordedForce:
    """A record of forces along the slide s."""
    made = {"name": f"{body} drive", "body": body, "times": TIMES, "forces": EFFORTS}
    return push(**(made | fields))


def wheel(**changes: Any) -> tb.Mechanism:
    """A balanced wheel: its speed changes by the record's integral."""
    return records.wheel(**({"force_elements": (torque("wheel"),)} | changes))


def arms(inertia: float = 0.05) -> tb.Mechanism:
    """Two arms with motors, one on the ground and one between them."""
    return tb.Mechanism(
        name="arms",
        bodies=(
            body_of("upper", "a", 2.0, (0.4, 0.1), inertia),
            body_of("lower", "b", 1.0, (0.3, 0.0), inertia),
        ),
        joints=(pin("shoulder", GROUND, "upper"), pin("elbow", "upper", "lower", (0.4, 0.1))),
        force_elements=(torque("upper"), torque("lower", relative_to="upper")),
        gravity=9.81,
        start=(0.9, 1.3),
    )


def cart() -> tb.Mechanism:
    """A cart that is driven along a slope, with a rod that hangs from it."""
    rail = tb.PrismaticJoint(
        name="rail", parent=GROUND, child="cart", parent_point=(0.1, 0.2), child_point=(0.0, 0.0),
        axis=(0.8, 0.6), coordinate="s",
    )  # fmt: skip
    return tb.Mechanism(
        name="cart",
        bodies=(
            body_of("cart", None, 2.5, (0.0, 0.0), 0.1),
            body_of("rod", "b", 1.0, (0.1, -0.5), 0.08),
        ),
        joints=(rail, pin("hinge", "cart", "rod")),
        force_elements=(force("cart"),),
        gravity=9.81,
        start=(0.4, 0.1),
    )


def boom(kind: type[Any] = tb.PrismaticJoint) -> tb.Mechanism:
    """A boom that turns, a bent bracket welded to it, and a slider that is driven along that."""
    weld = tb.WeldJoint(
        name="weld", parent="boom", child="bracket", parent_point=(0.5, 0.1),
        child_point=(0.1, 0.0), angle=0.7,
    )  # fmt: skip
    line = kind(
        name="line", parent="bracket", child="slider", parent_point=(0.1, 0.2),
        child_point=(0.05, -0.1), axis=(0.6, -0.8), coordinate="s",
    )  # fmt: skip
    slider = body_of("slider", "c" if kind is tb.SlotJoint else None, 1.5, (0.1, 0.0), 0.2)
    return tb.Mechanism(
        name=f"boom with a {line.kind}",
        bodies=(
            body_of("boom", "a", 2.0, (0.5, 0.1), 0.4),
            body_of("bracket", None, 0.5, (0.1, 0.1), 0.02),
            slider,
        ),
        joints=(pin("pivot", GROUND, "boom"), weld, line),
        force_elements=(
            force("slider", relative_to="bracket", forces=(-2.0, 6.0, 0.0, -5.0)),
            torque("boom"),
            tb.SpringDamper(
                name="spring", body="slider", point=(0.0, 0.0), relative_to="boom",
                relative_point=(0.2, 0.3), stiffness=60.0, rest_length=0.4,
            ),
        ),
        gravity=9.81,
        start=(0.3, 0.5, 0.2) if kind is tb.SlotJoint else (0.3, 0.2),
    )  # fmt: skip


def simulated(mechanism: tb.Mechanism, preset: str, step: float, **problem: Any) -> Any:
    """A run of pymunk."""
    engine = tb.engine("pymunk", preset, timestep=step)
    return engine.simulate(tb.Problem(mechanism, **({"duration": DURATION} | problem)))


def errors(mechanism: tb.Mechanism, preset: str, replayed: tb.Mechanism) -> list[float]:
    """Largest errors of positions of runs with the steps, of one mechanism against another."""
    exact = solve(tb.Problem(mechanism, DURATION))
    found: list[float] = []
    for step in STEPS:
        run = simulated(replayed, preset, step)
        found.append(float(np.abs(run.q - exact.motion(run.t).q).max()))
    return found


def converges(found: list[float], preset: str) -> bool:
    """Tell whether errors fall by the order of the preset's scheme with half the step, twice.

    A limit that is off by as little as the last error would halve the last ratio.
    """
    ratios = np.array(found[:-1]) / found[1:]
    return bool(np.all(np.abs(ratios / 2 ** ORDER[preset] - 1) < 0.2))


# --- Motion


def cranked() -> tb.Mechanism:
    """A slider crank with a motor on its crank: a loop."""
    crank = slider_crank()
    motor = torque(crank.bodies[0].name, torques=(2.0, -1.5, 0.0, 1.0))
    return crank.model_copy(update={"force_elements": (motor,)})


# By itself pymunk lets go of points beside the centres of bodies that turn, whatever the step is.
MOVED = [
    *((mechanism, preset) for mechanism in (arms(), cart()) for preset in PRESETS),
    *((mechanism, ASSISTED) for mechanism in (arms(0.0), boom(), boom(tb.SlotJoint), cranked())),
]


@pytest.mark.parametrize(("mechanism", "preset"), MOVED)
def test_a_record_is_followed_with_the_order_of_the_scheme(
    mechanism: tb.Mechanism, preset: str
) -> None:
    found = errors(mechanism, preset, mechanism)
    assert converges(found, preset), found


def _later(record: Any, by: float) -> Any:
    return record.model_copy(update={"times": (0.0, *(t + by for t in record.times[1:]))})


def _efforts(record: Any, efforts: tuple[float, ...]) -> Any:
    return record.model_copy(update={record.values: efforts})


MISTAKES: dict[str, Callable[[Any], Any]] = {
    "a period late": lambda r: _efforts(r, (r.efforts[0], *r.efforts[:-1])),
    "turned round": lambda r: _efforts(r, tuple(-effort for effort in r.efforts)),
    "the first value throughout": lambda r: r.at(0.0),
}


@pytest.mark.parametrize("preset", PRESETS)
@pytest.mark.parametrize("mistake", MISTAKES)
@pytest.mark.parametrize("mechanism", [arms(), cart()], ids=lambda m: m.name)
def test_a_wrong_replay_is_seen(mechanism: tb.Mechanism, mistake: str, preset: str) -> None:
    wrong = tuple(MISTAKES[mistake](each) for each in mechanism.force_elements)
    replayed = mechanism.model_copy(update={"force_elements": wrong})
    assert not converges(errors(mechanism, preset, replayed), preset)


def test_a_replay_that_is_half_a_step_late_is_not_of_second_order() -> None:
    """As one would be whose kick at an instant has the effort of one of its halves alone."""
    mechanism = arms()
    exact, found = solve(tb.Problem(mechanism, DURATION)), list[float]()
    for step in STEPS:
        late = tuple(_later(each, step / 2) for each in mechanism.force_elements)
        run = simulated(mechanism.model_copy(update={"force_elements": late}), ASSISTED, step)
        found.append(float(np.abs(run.q - exact.motion(run.t).q).max()))
    assert not converges(found, ASSISTED)


@pytest.mark.parametrize("preset", PRESETS)
def test_a_wheel_s_speed_has_the_record_s_impulse(preset: str) -> None:
    """To rounding, in each sample: a step has the effort with which it begins."""
    run = simulated(wheel(), preset, 2e-3)
    speed = 0.5 + summed(run.t, 1, TIMES, EFFORTS) / INERTIA
    assert np.abs(run.u[:, 0] - speed).max() < 1e-12
    angle = 0.3 + 0.5 * run.t + summed(run.t, 2, TIMES, EFFORTS) / INERTIA
    if preset != ASSISTED:  # a step moves the bodies with the speeds with which it begins
        angle -= 1e-3 * (run.u[:, 0] - 0.5)
    assert np.abs(run.q[:, 0] - angle).max() < 1e-12


@pytest.mark.parametrize("preset", PRESETS)
def test_an_instant_inside_a_step(preset: str) -> None:
    """By itself pymunk has the new effort from the next step on; with assistance a step ends."""
    mechanism = wheel(force_elements=(torque("wheel", times=(0.0, 0.2504), torques=(0.0, 8.0)),))
    run = simulated(mechanism, preset, 1e-3)
    late = 0.0 if preset == ASSISTED else 0.0006
    gained = 8.0 / INERTIA * (DURATION - 0.2504 - late)
    assert run.t[-1] == pytest.approx(DURATION, abs=1e-12)
    assert run.u[-1, 0] == pytest.approx(0.5 + gained, rel=1e-12)


def test_periods_shorter_than_a_step_are_steps() -> None:
    times = tuple(0.001 * k for k in range(800))
    efforts = tuple(float(e) for e in np.random.default_rng(5).uniform(-9, 9, 800))
    mechanism = wheel(force_elements=(torque("wheel", times=times, torques=efforts),))
    run = simulated(mechanism, ASSISTED, 0.02)
    assert run.provenance.steps == 800 and len(run.t) == 801
    assert np.abs(np.diff(run.u[:, 0]) - np.array(efforts) * 1e-3 / INERTIA).max() < 1e-12


@pytest.mark.parametrize("preset", PRESETS)
@pytest.mark.parametrize(("mechanism", "joint"), [(cart(), "rail"), (arms(), "elbow")])
def test_joint_forces_are_those_of_the_efforts_that_act(
    mechanism: tb.Mechanism, joint: str, preset: str
) -> None:
    """Away from the start and the instants they converge with the order of the scheme."""
    exact, found = solve(tb.Problem(mechanism, DURATION)), list[float]()
    for step in STEPS:
        run = simulated(mechanism, preset, step)
        away = (np.abs(run.t[:, None] - np.array(TIMES)) > 1.5 * step).all(axis=1)
        wrong = run.joint_reactions[joint] - exact.trajectory(run.t).joint_reactions[joint]
        found.append(float(np.abs(wrong[away]).max()))
    assert converges(found, preset), found


def test_joint_forces_of_a_loop_are_of_second_order_at_instants_too() -> None:
    """A new start there has speeds that do not open the loop."""
    mechanism = cranked()
    exact, found = solve(tb.Problem(mechanism, DURATION)), list[float]()
    for step in STEPS:
        run, wrong = simulated(mechanism, ASSISTED, step), 0.0
        near = (np.abs(run.t[:, None] - np.array(TIMES[1:])) < 0.5 * step).any(axis=1)
        for joint, force in exact.trajectory(run.t).joint_reactions.items():
            wrong = max(wrong, float(np.abs(run.joint_reactions[joint] - force)[near].max()))
        found.append(wrong)
    assert converges(found, ASSISTED), found


# --- Stops


def test_a_stop_opens_where_its_torque_changes_its_sign() -> None:
    stop = tb.Stop(name="rest", body="wheel", sense=1, limit=0.3, closed=True)
    record = torque("wheel", times=(0.0, 0.4), torques=(-3.0, 5.0))
    pressed = wheel(stops=(stop,), start_speeds=(), force_elements=(record,))
    for law in tb.StopLaw:
        run = simulated(pressed, ASSISTED, 1e-3, stop_law=law)
        assert run.release_times["rest"] == 0.4
        assert run.stop_torques["rest"][run.t < 0.4] == pytest.approx(3.0, abs=1e-9)
        assert not run.stop_torques["rest"][run.t >= 0.4].any()
        angle = 0.3 + 0.5 * 5.0 / INERTIA * (DURATION - 0.4) ** 2
        assert run.q[-1, 0] == pytest.approx(angle, abs=1e-12)


@pytest.mark.parametrize("instant", [0.4, 0.5 - 1e-13, 0.5, 0.5 + 1e-13, 0.5004, 0.502])
def test_a_wheel_that_is_driven_into_a_stop(instant: float) -> None:
    """It is met at 0.5 s, or not at all, and left where the torque turns round.

    All is quadratic in time between events, which a leapfrog follows exactly.
    """
    stop = tb.Stop(name="wall", body="wheel", sense=-1, limit=-0.25, closed=False)
    record = torque("wheel", times=(0.0, instant), torques=(2 * INERTIA, -2 * INERTIA))
    met = wheel(stops=(stop,), start=(0.0,), start_speeds=(), force_elements=(record,))
    law = tb.StopLaw.UNILATERAL
    run = simulated(met, ASSISTED, 1e-3, stop_law=law)
    exact = solve(tb.Problem(met, DURATION, stop_law=law)).motion(run.t)
    assert np.abs(run.q - exact.q).max() < 1e-9


def test_rebounds_go_on_over_instants() -> None:
    """A hammer of restitution 0.6, thrown at the floor ever harder and softer.

    A fourth of the step leaves a sixteenth of the error of an impact's time, and of first order a
    fourth: the bound is between the two, as errors of third order depend on where in a step an
    impact is.
    """
    floor = tb.PointStop(
        name="floor", body="rod", point=(0.5, 0.0), normal=(0.0, 1.0), offset=-0.2, closed=False,
        restitution=0.6,
    )  # fmt: skip
    times = tuple(0.05 * k for k in range(16))
    torques = tuple(2.0 * (-1) ** k + 0.1 * k for k in range(16))
    hammer = tb.Mechanism(
        name="hammer",
        bodies=(body_of("rod", "a", 1.0, (0.4, 0.0), 0.05),),
        joints=(pin("pivot", GROUND, "rod"),),
        stops=(floor,),
        force_elements=(torque("rod", times=times, torques=torques),),
        gravity=9.81,
        start=(0.0,),
    )
    problem = {"stop_law": tb.StopLaw.UNILATERAL}
    exact = [time for time, _ in solve(tb.Problem(hammer, DURATION, **problem)).impacts[:3]]
    found: list[list[float]] = []
    for step in STEPS:
        impacts = simulated(hammer, ASSISTED, step, **problem).impacts[:3]
        found.append([abs(time - true) for (time, _), true in zip(impacts, exact, strict=True)])
    assert all(coarse > 8 * fine for coarse, fine in zip(found[0], found[-1], strict=True)), found


# --- Programs and models


@pytest.mark.parametrize("preset", ALONE)
@pytest.mark.parametrize("mechanism", [arms(), cart(), boom()], ids=lambda m: m.name)
def test_a_program_has_the_same_motion(mechanism: tb.Mechanism, preset: str) -> None:
    engine, found = tb.engine("pymunk", preset), dict[str, Any]()
    problem = tb.Problem(mechanism, DURATION)
    exec(engine.script(problem), found)
    run = engine.simulate(problem)
    for key in ("t", "q", "u"):
        assert np.array_equal(found[key], getattr(run, key))


EVERY = [wheel(), arms(), arms(0.0), cart(), boom(), boom(tb.SlotJoint)]


@pytest.mark.parametrize("preset", PRESETS)
@pytest.mark.parametrize("mechanism", EVERY, ids=lambda m: m.name)
def test_the_built_model_has_the_record(mechanism: tb.Mechanism, preset: str) -> None:
    checked = check_model(tb.engine("pymunk", preset), mechanism)
    assert checked.exposed and checked.holds, checked


@pytest.mark.parametrize("preset", PRESETS)
def test_a_wrong_effort_is_seen_in_the_built_model(
    preset: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    from trebucheck.engines.pymunk import inspect as module

    def wrong(build: Any) -> Any:
        def built(mechanism: tb.Mechanism, *arguments: Any) -> Any:
            drive, *others = mechanism.force_elements
            assert isinstance(drive, tb.RecordedForce)
            drive = drive.model_copy(update={"forces": (1.001 * drive.value,)})
            changed = mechanism.model_copy(update={"force_elements": (drive, *others)})
            return build(changed, *arguments)

        return built

    for name in ("build", "build_documented"):
        monkeypatch.setattr(module, name, wrong(getattr(module, name)))
    assert not check_model(tb.engine("pymunk", preset), boom()).holds


def test_a_new_start_at_an_instant_is_named() -> None:
    engine: Any = tb.engine("pymunk")
    named = {each.does for each in engine.assisted_by if each.acts_on(wheel())}
    assert any("recorded effort" in does for does in named)
    held = wheel(force_elements=(torque("wheel").at(0.0),))
    named = {each.does for each in engine.assisted_by if each.acts_on(held)}
    assert not any("recorded effort" in does for does in named)
