"""Cases of `recorded.py` for the judging code: small motions and models that are wrong on purpose.

Each is wrong by numbers of its own in every quantity, so that no two quantities can be exchanged,
no sign can be lost and no scale be forgotten without a recorded value becoming another one.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache
from typing import Any

import numpy as np
import trebucheck as tb
from mechanisms import (
    angle_stop,
    bouncing,
    chain,
    chain_on_a_slot,
    everything,
    floor,
    hanging_bob,
    parallel_cranks,
    rods_on_a_slot,
    scaled,
    slider_crank,
)
from recorded_engines import leaning
from trebucheck.comparisons.diagnosis.diagnose import (
    check_and_diagnose,
    diagnose_motion,
    find_onset,
    growth,
)
from trebucheck.comparisons.diagnosis.equivalence import (
    check_model,
    expected,
    gap_errors,
    random_states,
    scaled_differences,
)
from trebucheck.comparisons.report import markdown
from trebucheck.comparisons.runs.balance import reference_work, sampled_balance
from trebucheck.comparisons.runs.impacts import paired
from trebucheck.comparisons.runs.metrics import against, measure
from trebucheck.comparisons.runs.quantities import QUANTITIES
from trebucheck.comparisons.runs.record import RunErrors, curves_of, machine_row, pair_of
from trebucheck.comparisons.runs.results import Metric, Run
from trebucheck.comparisons.runs.runner import Runner, farthest, run_duration
from trebucheck.comparisons.runs.scales import scales_until
from trebucheck.comparisons.runs.stretching import stretching_until
from trebucheck.comparisons.runs.study import Until
from trebucheck.comparisons.runs.tolerances import Needs, judge, tolerance_for
from trebucheck.conformance.certificate import badge, certificate, next_steps
from trebucheck.conformance.suite import judgement
from trebucheck.conformance.verdicts import CheckState, CheckVerdict, Conformance
from trebucheck.engines.inspection import Inspection, State
from trebucheck.engines.reference.engine import ReferenceEngine
from trebucheck.models.elements import (
    GROUND,
    ConstantForce,
    ConstantTorque,
    CubicTorsionSpring,
    RotationalSpringDamper,
    SpringDamper,
)
from trebucheck.models.errors import SimulationError
from trebucheck.models.mechanism import Mechanism
from trebucheck.models.problem import StopLaw
from trebucheck.models.trajectory import PointMotion
from trebucheck.reference.solver import solve


def sprung() -> Mechanism:
    """A bob between springs and dampers, with a motor, pulled aside."""
    return hanging_bob(
        start=0.7,
        start_speeds=(1.0,),
        force_elements=(
            SpringDamper(
                name="tie", body="bob", point=(0.3, 0.1), relative_to=GROUND,
                relative_point=(-0.2, 0.1), stiffness=40.0, damping=1.5, rest_length=0.3,
            ),
            RotationalSpringDamper(
                name="twist", body="bob", relative_to=GROUND, stiffness=3.0, damping=0.2,
                rest_angle=0.3,
            ),
            CubicTorsionSpring(
                name="bar", body="bob", relative_to=GROUND, stiffness=2.0, cubic_stiffness=1.5,
                rest_angle=-0.2,
            ),
            ConstantTorque(name="motor", body="bob", relative_to=GROUND, torque=0.9),
            ConstantForce(name="pull", body="bob", point=(0.1, 0.2), force=(2.0, -1.0)),
        ),
    )  # fmt: skip


_BUILT: dict[str, tuple[Callable[[], Mechanism], float, StopLaw]] = {
    "fixed": (tb.fixed, 1.4, StopLaw.RELEASE_ONCE),
    "stop and floor": (
        lambda: hanging_bob(angle_stop(1.0, 0.5), floor(1.9, 0.3)), 1.4, StopLaw.UNILATERAL,
    ),
    "thrown": (lambda: tb.model("catapult"), 2.0, StopLaw.RELEASE_ONCE),
    "ball": (lambda: bouncing(0.3, 0.6), 1.1, StopLaw.UNILATERAL),
    "loop": (slider_crank, 0.9, StopLaw.RELEASE_ONCE),
    "chain": (chain_on_a_slot, 0.8, StopLaw.RELEASE_ONCE),
    "everything": (everything, 0.6, StopLaw.UNILATERAL),
    "sprung": (sprung, 0.8, StopLaw.RELEASE_ONCE),
    "small rods": (
        lambda: scaled(rods_on_a_slot(inertia=0.01, tip=(0.5, 0.2)), 1e-3),
        0.03, StopLaw.RELEASE_ONCE,
    ),
    "redundant": (lambda: parallel_cranks(3), 0.5, StopLaw.RELEASE_ONCE),
    "flat": (lambda: parallel_cranks(2, start=-0.3), 0.8, StopLaw.RELEASE_ONCE),
    "wild": (lambda: chain(start=(-2.5, -2.0)), 7.0, StopLaw.RELEASE_ONCE),
}  # fmt: skip
"""Mechanism, duration [s] and law of the stops."""


@cache
def _runner(name: str) -> Runner:
    build, duration, law = _BUILT[name]
    return Runner(build(), None, Until.of(duration), law)


def _times(end: float) -> np.ndarray:
    """Uneven steps, with a gap of a tenth of the time in the middle, to a little after the end."""
    s = np.linspace(0.0, 1.0, 90)
    t = end * 1.02 * (s + 0.01 * np.sin(9 * s) * s * (1 - s))
    return t[(t < 0.5 * end) | (t > 0.6 * end)]


def spoiled(right: tb.Trajectory) -> tb.Trajectory:
    """Another error in every quantity; each grows from zero at the start."""
    number = iter(range(1, 1000))

    def off(values: np.ndarray) -> np.ndarray:
        k = next(number)
        size = 1e-3 * (1 + 0.1 * k) * (float(np.abs(values).max()) or 1.0)
        wave = np.sin((3 + 0.37 * k) * right.t / right.t[-1] + 0.01 * k * k)
        change = size * wave * right.t / right.t[-1]
        if values.ndim == 2:
            change = (
                change[:, None]
                * (1 + 0.3 * np.arange(values.shape[1]))
                * [(-1) ** i for i in range(values.shape[1])]
            )
        return values + change

    markers = {n: PointMotion(off(m.position), off(m.velocity)) for n, m in right.markers.items()}
    releases = {
        n: None if time is None else time + 0.004 * next(number)
        for n, time in right.release_times.items()
    }
    impacts = tuple((time + 2e-4 * (k + 1), i) for k, (time, i) in enumerate(right.impacts))
    return replace(
        right,
        q=off(right.q),
        u=off(right.u),
        markers=markers,
        kinetic_energy=off(right.kinetic_energy),
        potential_energy=off(right.potential_energy),
        stop_torques={n: off(v) for n, v in right.stop_torques.items()},
        joint_reactions={n: off(v) for n, v in right.joint_reactions.items()},
        joint_gaps={joint.name: np.abs(off(0 * right.t)) for joint in right.mechanism.joints},
        release_times=releases,
        impacts=impacts,
    )


def measured(name: str) -> list[Any]:
    """Metrics of a spoiled motion, whole and cut off, and what the reference is known by."""
    runner = _runner(name)
    right = runner.solution.trajectory(_times(runner.end))
    wrong = spoiled(right)
    found: list[Any] = [[m.model_dump(mode="json") for m in runner.measured(wrong)]]
    # No impacts told, and an end before all that the engine did
    end = 0.7 * runner.end
    silent = replace(wrong, impacts=())
    found.append([m.model_dump(mode="json") for m in measure(silent, runner.solution, end)])
    far = farthest(wrong, runner)
    found.append([far.point, far.distance, far.time, far.until])
    found.append(_curves(wrong, runner))
    coarse = replace(spoiled(runner.solution.trajectory(np.linspace(0.0, runner.end, 31))))
    errors = [RunErrors.of(run, runner.solution.trajectory(run.t)) for run in (wrong, coarse)]
    found.append(pair_of(name, ("a", "b"), errors[0], errors[1], end).model_dump(mode="json"))
    return found


_OF_ROUNDING = "ball"
"""The integration of its flight errs by rounding alone, which differs between kernels of BLAS."""


def onsets(name: str) -> list[Any]:
    """Time and quantity by which a spoiled motion leaves each tolerance, and all together."""
    runner = _runner(name)
    right = runner.solution.trajectory(_times(runner.end))
    wrong = spoiled(right)
    aligned = against(wrong, runner.solution, runner.end, right)
    broken: list[Metric] = []
    for metric in runner.measured(wrong):
        known = metric.value is not None and metric.observed
        tolerance = 0.3 * abs(metric.value) if known and metric.value else None
        broken.append(metric.model_copy(update={"tolerance": tolerance}))
    found: list[Any] = []
    for chosen in (*[[metric] for metric in broken], broken, broken[2:5]):
        onset = find_onset(aligned, chosen)
        found.append(onset and [onset.first_violated, onset.time, list(onset.active)])
    if name != _OF_ROUNDING:
        found += growth(runner.solution, right.t[right.t <= runner.end])[::9].tolist()
    return found


def diagnosed(name: str) -> list[Any]:
    """Causes of motions that have one mistake of an adapter each, without any engine."""
    build, duration, law = _BUILT[name]
    mechanism = build()
    runner = _runner(name)
    found: list[Any] = []
    for what, changed in _ALTERED.items():
        wrong = changed(mechanism)
        if wrong is None:
            continue
        moved = solve(tb.Problem(wrong, duration=duration, stop_law=law))
        motion = replace(moved.trajectory(np.linspace(0.0, duration, 120)), mechanism=mechanism)
        broken = [
            metric.model_copy(update={"tolerance": 1e-3 * abs(metric.value)})
            for metric in runner.measured(motion)
            if metric.value and metric.name in ("position_max", "angle_max", "velocity_max")
        ]
        diagnosis = diagnose_motion(broken, motion, runner.solution, 0.9 * duration)
        best = diagnosis.causes[: max(2, diagnosis.likeliest)]
        rows = [[c.name, c.kind, c.amount, round(c.explained, 4)] for c in best]
        agrees = [diagnosis.likeliest, diagnosis.motion_agrees, diagnosis.parts_at]
        found.append([what, diagnosis.leads, *agrees, list(diagnosis.holding), rows])
    return found


def _bodies(mechanism: Mechanism, **factors: float) -> Mechanism:
    """The last body with other numbers."""
    *others, last = mechanism.bodies
    update = {name: getattr(last, name) * factor for name, factor in factors.items()}
    return mechanism.model_copy(update={"bodies": (*others, last.model_copy(update=update))})


def _without_force(mechanism: Mechanism) -> Mechanism | None:
    rest = mechanism.force_elements[1:]
    if not mechanism.force_elements:
        return None
    return mechanism.model_copy(update={"force_elements": rest})


_ALTERED: dict[str, Callable[[Mechanism], Mechanism | None]] = {
    "gravity": lambda m: m.model_copy(update={"gravity": m.gravity * 1.02}),
    "mass": lambda m: _bodies(m, mass=1.05),
    "speeds": lambda m: (
        m.model_copy(update={"start_speeds": tuple(0.97 * u for u in m.start_speeds)})
        if any(m.start_speeds or ())
        else None
    ),
    "force": _without_force,
}


def _curves(wrong: tb.Trajectory, runner: Runner) -> list[Any]:
    curves = curves_of(against(wrong, runner.solution, runner.end))
    chosen = slice(0, None, 97)
    parts = [curves.energy[chosen], *(curves.torques[n][chosen] for n in sorted(curves.torques))]
    parts += [axis[chosen] for n in sorted(curves.positions) for axis in curves.positions[n]]
    events = [dict(curves.release_times), curves.launch_time, curves.launch_speed, curves.end]
    return [[list(part) for part in parts], dict(curves.force_units), events]


def known(name: str) -> list[Any]:
    """Scales, stretching and uncertainties of a reference motion, and its balance of energy."""
    runner = _runner(name)
    row = machine_row(runner, Needs.of(None)).model_dump(mode="json")
    kept = ("scales", "stretching", "predictability", "judged_to", "release_times", "impacts")
    found: list[Any] = [row[key] for key in (*kept, "start_torques", "launch_time")]
    # Of an estimate the size alone says something: differences of rounding errors
    found += [sorted(row["reference_uncertainty"]), row["uncertainty_source"]]
    earlier = scales_until(runner.solution, 0.3 * runner.end)
    found.append(earlier.model_dump(mode="json"))
    growth = stretching_until(runner.solution, runner.end, earlier)
    found.append(growth.horizon)
    # A difference quotient of two solutions is known to some three digits: hence its logarithm
    for values in (growth.t, growth.parameters, growth.start, growth.allowed):
        found.append(np.log10(1.0 + values[::40]).tolist())
    if name != _OF_ROUNDING:
        found.append((1e9 * growth.rounding[::40]).tolist())
    t = _times(runner.end)
    balance, error = sampled_balance(runner.solution.trajectory(t))
    work = reference_work(runner.solution, t[t <= runner.end])
    return [*found, balance[::9].tolist(), (error[::9] * 1e3).tolist(), work[::9].tolist()]


def aligned() -> list[Any]:
    """Pairs of impacts: late, missing, unresolved, beyond the end, more than are counted."""
    falling = [0.3, 0.9, 1.26, 1.476, 1.6056, 1.6834, 1.73, 1.758, 1.775]
    cases: list[tuple[Sequence[float], Sequence[float], float, float]] = [
        (falling, falling, 1e-3, math.inf),
        (falling[:5], falling, 0.02, math.inf),
        ([time + 0.004 for time in falling[:6]], falling, 0.02, 1.7),
        ([falling[0], *falling[2:]], falling, 1e-3, math.inf),
        (falling, [falling[0], *falling[2:]], 1e-3, math.inf),
        ([], falling[:3], 0.01, 1.0),
        (falling[:3], [], 0.01, 1.0),
        ([1.0, 1.004, 1.03], [1.001, 1.02], 0.01, 2.0),
        ([0.01 * k for k in range(1, 120)], [0.01 * k + 1e-3 for k in range(1, 120)], 1e-3, 9.0),
    ]
    return [[list(map(list, paired(*case)))] for case in cases]


# --- The model check


@dataclass(frozen=True)
class Odd:
    """The reference's built model, wrong in every number that it shows."""

    name: str = "odd"
    part: float = 1e-6
    """Error in parts of a number and of one."""
    roundoff: float = 2.0**-53
    refuses: tuple[int, ...] = ()
    """States in which it finds no accelerations."""
    hides: tuple[str, ...] = ()
    """Fields that it does not show in every state."""

    capabilities = ReferenceEngine.capabilities

    def inspect(self, mechanism: Mechanism, states: Sequence[State]) -> Inspection:
        every = random_states(mechanism)
        numbers = [k for k, state in enumerate(every) for s in states if _same(state, s)]
        if any(k in self.refuses for k in numbers):
            raise SimulationError("no accelerations here")
        right = ReferenceEngine().inspect(mechanism, states)
        exact = expected(mechanism, states)

        def off(k: int, values: Any) -> Any:
            """Every number of a state by its own part."""
            values = np.asarray(values, dtype=float)
            order = 1 + np.arange(values.size).reshape(values.shape)
            return values + self.part * (1 + 0.1 * k) * order * np.cos(order) * (1 + abs(values))

        dynamics: list[Any] = []
        for i, each in enumerate(right.dynamics):
            k = numbers[i] if i < len(numbers) else i
            shown = {
                "mass_matrix": off(k, exact.mass[i]),
                "forces": off(k, exact.forces[i]),
                "centres": {n: off(k + j, v) for j, (n, v) in enumerate(each.centres.items())},
                "stop_gaps": {n: float(off(k, v)) for n, v in each.stop_gaps.items()},
                "stop_torques": {n: float(off(k, v)) for n, v in each.stop_torques.items()},
                "accelerations": off(k, each.accelerations),
            }
            for field in self.hides:
                if k % 2 and field in shown:
                    shown[field] = None if field in ("mass_matrix", "forces") else {}
            dynamics.append(replace(each, **shown))
        return replace(
            right,
            start=off(0, right.start),
            start_speeds=off(1, right.start_speeds),
            dynamics=tuple(dynamics),
            total_mass=None if "total_mass" in self.hides else right.total_mass * (1 + self.part),
            roundoff=self.roundoff,
        )


def _same(one: State, other: State) -> bool:
    return bool(np.array_equal(one.q, other.q) and np.array_equal(one.u, other.u))


@dataclass(frozen=True)
class Other:
    """Shows the built model of another mechanism, in all that can be shown."""

    mechanism: Mechanism
    name: str = "other"
    relative: bool = False
    """Whether its coordinates count from its own start, which is elsewhere."""
    capabilities = ReferenceEngine.capabilities

    def inspect(self, mechanism: Mechanism, states: Sequence[State]) -> Inspection:
        wrong = self.mechanism
        if self.relative:
            shift = np.array(wrong.start) - np.array(mechanism.start)
            states = [replace(state, q=state.q + shift) for state in states]
        shown = ReferenceEngine().inspect(wrong, states)
        exact = expected(wrong, states)
        dynamics = [
            replace(each, mass_matrix=exact.mass[k], forces=exact.forces[k])
            for k, each in enumerate(shown.dynamics)
        ]
        return replace(shown, dynamics=tuple(dynamics))


def _moved_stop(mechanism: Mechanism, at: int, by: float) -> Mechanism | None:
    stops = list(mechanism.stops)
    if len(stops) <= at or not stops[at].closed:
        return None
    field = "limit" if hasattr(stops[at], "limit") else "offset"
    update = {field: getattr(stops[at], field) + by}
    stops[at] = stops[at].model_copy(update=update)
    return mechanism.model_copy(update={"stops": tuple(stops)})


def _other_start(mechanism: Mechanism, at: int, change: Callable[[float], float]) -> Mechanism:
    start = list(mechanism.start)
    start[at] = change(start[at])
    return mechanism.model_copy(update={"start": tuple(start)})


_BUILT_WRONG: dict[str, Callable[[Mechanism], Mechanism | None]] = {
    **{n: c for n, c in _ALTERED.items() if n != "speeds"},
    "first stop up": lambda m: _moved_stop(m, 0, 0.01),
    "first stop down": lambda m: _moved_stop(m, 0, -0.01),
    "second stop": lambda m: _moved_stop(m, 1, 0.02),
    "start in degrees": lambda m: _other_start(m, 0, math.degrees),
    "start mirrored": lambda m: _other_start(m, 0, lambda angle: -angle),
    "start an angle away": lambda m: _other_start(m, 0, lambda angle: angle + 1.0),
    "start turns away": lambda m: _other_start(m, 0, lambda angle: angle + 7.0),
    "start beside": lambda m: _other_start(m, -1, lambda value: value + 0.01),
    "inertia": lambda m: _bodies(m, inertia=1.1) if m.bodies[-1].inertia else None,
    "centre": lambda m: m.model_copy(
        update={
            "bodies": (
                m.bodies[0].model_copy(update={"centre": (m.bodies[0].centre[0] + 0.01, 0.02)}),
                *m.bodies[1:],
            )
        }
    ),
}


_WITHOUT_STOPS = ("gravity", "mass", "inertia", "centre", "start an angle away", "start turns away")
"""Asked of the mechanism without stops alone."""


def built(name: str) -> list[Any]:
    """Causes of built models that are another mechanism."""
    mechanism = _CHECKED[name]()
    found: list[Any] = []
    for what, changed in _BUILT_WRONG.items():
        wrong = changed(mechanism)
        if wrong is None or (mechanism.stops and what in _WITHOUT_STOPS):
            continue
        equality, diagnosis = check_and_diagnose(Other(wrong), mechanism)
        found.append([what, equality.holds, [c.label for c in equality.broken]])
        if diagnosis is not None:
            best = diagnosis.causes[: max(3, diagnosis.likeliest)]
            rows = [[c.name, c.kind, c.amount, round(c.explained, 4)] for c in best]
            found.append([diagnosis.leads, diagnosis.likeliest, rows])
    return found


def built_elsewhere() -> list[Any]:
    """Causes of a built model that starts with its stop elsewhere, told from there or not."""
    right, parameters = tb.fixed(), tb.TrebuchetParameters()
    wrong = tb.fixed(tb.TrebuchetParameters(alpha0=1.01 * parameters.alpha0))
    found: list[Any] = []
    for relative in (False, True):
        equality, diagnosis = check_and_diagnose(Other(wrong, relative=relative), right)
        assert diagnosis is not None
        rows = [[c.name, c.kind, c.amount, round(c.explained, 4)] for c in diagnosis.causes[:4]]
        found.append([[c.label for c in equality.broken], diagnosis.likeliest, rows])
    return found


_CHECKED: dict[str, Callable[[], Mechanism]] = {
    "fixed": tb.fixed,
    "rolling": tb.rolling,
    "loop": slider_crank,
    "leaning": leaning,
    "hinged": tb.hinged,
    "everything": everything,
    "small": lambda: scaled(rods_on_a_slot(inertia=0.01, tip=(0.5, 0.2)), 1e-3),
    "weightless": lambda: hanging_bob(gravity=0.0, start_speeds=(0.7,)),
}
_ODD: dict[str, Mapping[str, Any]] = {
    "in all": {},
    "single precision": {"roundoff": 6e-8, "part": 3e-5},
    "sometimes": {"refuses": (2, 3, 7), "hides": ("stop_torques", "mass_matrix")},
    "hidden": {"hides": ("forces", "centres", "stop_gaps", "total_mass"), "part": 1e-12},
    "in most states": {"refuses": tuple(range(1, 20))},
    "at the start": {"refuses": (0,)},
}


def checked(name: str) -> list[Any]:
    """The model check on a model that is wrong in every number, and states that it is made in."""
    mechanism = _CHECKED[name]()
    states = random_states(mechanism)
    found: list[Any] = [
        [state.q.tolist(), state.u.tolist(), list(state.closed)] for state in states
    ]
    engine = Odd()
    dynamics = engine.inspect(mechanism, states).dynamics
    reference = expected(mechanism, states)
    differences = scaled_differences(reference, dynamics)
    found += [len(differences), (differences[::5] * 1e3).tolist()]
    found.append({n: 1e3 * error for n, error in gap_errors(reference, dynamics).items()})
    found += [reference.force_scale.tolist(), reference.acceleration_scale.tolist()]
    found.append(dict(reference.torque_scales))
    like = reference.as_dynamics(dynamics)[-1]
    found += [like.accelerations.tolist(), dict(like.stop_torques), dict(like.stop_gaps)]
    for changes in _ODD.values():
        try:
            equality = check_model(replace(engine, **changes), mechanism)
        except SimulationError as error:
            found.append(type(error).__name__)
            continue
        found += [equality.exposed, equality.states, equality.holds, equality.note]
        for check in equality.checks:
            value = None if check.value is None else 1e6 * check.value
            row = [check.name, check.subject, value, check.unit, 1e6 * check.tolerance]
            found.append([*row, check.holds, check.reason])
    return found


# --- Tolerances


def _run(engine: str, preset: str, step: float | None, metrics: Sequence[Metric]) -> Run:
    settings = {} if step is None else {"timestep": step}
    return Run(
        model="m", engine=engine, preset=preset, outcome="not judged", engine_version="1",
        settings=settings, metrics=tuple(metrics),
    )  # fmt: skip


def held_against(name: str) -> list[Any]:
    """Tolerance, source and verdict of every metric, by engines, presets, steps and needs."""
    runner = _runner(name)
    # The uncertainties of an estimate are rounding errors: they are set.
    known = {metric: 10.0 ** -(6 + k % 6) for k, metric in enumerate(QUANTITIES)}
    machine = machine_row(runner, Needs.of(None)).model_copy(
        update={"reference_uncertainty": known}
    )
    longer = machine.model_copy(
        update={"whole_scales": machine.scales.model_copy(update={"energy": 7.0, "speed": 3.0})}
    )
    metrics: list[Metric] = []
    for k, kind in enumerate(QUANTITIES.values()):
        of = QUANTITIES[kind.follows] if kind.follows else kind
        subjects = of.subjects(machine.mechanism) if of.of else (None,)
        for subject in subjects:
            scale = kind.scale_of(machine.scales, subject, machine.mechanism)
            for value in (1e-9 * scale * (k + 1), 0.003 * scale, None):
                fields = {"name": kind.name, "subject": subject, "unit": "1"}
                metrics.append(Metric(**fields, value=value))
                if value is not None:
                    metrics.append(Metric(**fields, value=-value, sampling_error=0.002 * scale))
            metrics.append(Metric(**fields, value=None, observed=False, note="not told"))
    needs = (None, {"default": "0.5%"}, {"position": 1e-4, "energy": "2%", "release": 0.01})
    found: list[Any] = []
    first = 0
    for engine, preset, step in (
        ("mujoco", "assisted", 1e-3), ("mujoco", "default", 2e-3), ("pymunk", "assisted", 5e-4),
        ("pymunk", "default", 1e-2), ("exudyn", "assisted", 4e-3), ("reference", "assisted", None),
    ):  # fmt: skip
        for need in needs:
            run = _run(engine, preset, step, metrics)
            for of in (machine, longer):
                first += 1  # each metric comes up with some engine, need and end
                for m in judge(run, of, Needs.of(need))[first % 13 :: 13]:
                    tolerance = None if m.tolerance is None else 1e6 * m.tolerance
                    found.append([m.name, tolerance, m.source, m.holds, m.note, m.reason])
    return found


def claims() -> list[Any]:
    """Every engine's own tolerance of every metric at several steps."""
    found: list[Any] = []
    for mechanism in (tb.fixed(), tb.rolling()):
        for engine in ("mujoco", "pymunk", "exudyn", "reference"):
            for preset in ("assisted", "default"):
                for kind in QUANTITIES.values():
                    for subject in (*kind.subjects(mechanism), None):
                        for step in (1e-3, 1.7e-2):
                            claim = tolerance_for(
                                engine, preset, kind.name, subject, mechanism, step,
                                table_one=step == 1e-3,
                            )  # fmt: skip
                            if claim is not None:
                                found.append([engine, kind.name, 1e6 * claim.value])
    return found


def durations() -> list[float]:
    """Durations of engines' runs, by the end, the step and the longest [s]."""
    return [
        run_duration(end, step, longest)
        for end in (0.01, 1.0, 30.0)
        for step in (0.0, 1e-4, 1e-2)
        for longest in (math.inf, end + 0.015, end)
    ]


# --- Conformance


def _verdict(id: str, state: CheckState, **more: Any) -> CheckVerdict:
    return CheckVerdict(id=id, state=state, **more)


def conformed() -> list[Any]:
    """Certificates, badges and advice of results with every state; judgements of metrics."""
    kept, broken, skipped = CheckState.KEPT, CheckState.BROKEN, CheckState.SKIPPED
    rows = (
        _verdict("reference/assisted/interface/description", kept),
        _verdict("reference/assisted/interface/refuses", broken, text="it moves 3 of them"),
        _verdict("reference/assisted/fixed/runs", kept, wall_time=1.25),
        _verdict("reference/assisted/fixed/position", kept, error=2e-4, tolerance=5e-4, unit="m"),
        _verdict("reference/assisted/fixed/speed", broken, error=0.4, tolerance=0.1, unit="m/s",
                 text="x 7", cause="is 2 % of gravity"),
        _verdict("reference/assisted/fixed/energy", CheckState.NOT_JUDGED, text="no tolerance 9"),
        _verdict("reference/assisted/bead/runs", skipped, text="it has no slot 5"),
        _verdict("reference/assisted/bead/position", skipped, text="it has no slot 5"),
        _verdict("reference/assisted/catapult/release", CheckState.DEVIATES, error=3.0,
                 tolerance=2.0, text="known since 2020"),
        _verdict("reference/default/fixed/runs", kept, wall_time=0.5),
        _verdict("reference/default/fixed/release", broken, error=0.3, tolerance=0.25,
                 unit="s", text="y 8"),
        _verdict("deviations/file/row/ref*", skipped, text="row 1: none of its checks was run"),
    )  # fmt: skip
    fields = {"tier": "quick", "engines": {"reference/assisted": "1.0", "reference/default": "2.0"}}
    groups = (rows, rows[:1], rows[:4], rows[6:8], (*rows[2:4], rows[8]), (rows[2], *rows[6:8]))
    found: list[Any] = []
    for chosen in groups:
        results = Conformance.made_here(
            **fields, supplied={"reference/assisted": {}}, verdicts=chosen
        )
        found += [results.passed, {s.value: n for s, n in sorted(results.counts.items())}]
        found += [badge(results).replace('"', " "), list(next_steps(results))]
        page = markdown.text(certificate(results))
        # Of the tables' rows; what their headings say is no value
        rows = [line.split("|") for line in page.splitlines() if line.startswith("| reference/")]
        found += [[cell.strip() for cell in row] for row in rows]
    return found


def judgements() -> list[Any]:
    """Verdicts on the metrics of one quantity: by the worst, and by those without a tolerance."""

    def metric(value: float | None, tolerance: float | None, **more: Any) -> Metric:
        source = {} if tolerance is None else {"source": "default", "reason": "of 3 m"}
        fields = {"name": "position_max", "subject": f"tip {value}", "unit": "m"}
        return Metric(**fields | {"value": value, "tolerance": tolerance} | source | more)

    small, large, unknown = metric(1e-3, 1e-2), metric(-0.05, 1e-2), metric(0.2, None, note="why 4")
    absent = metric(None, None, observed=False, note="not told 6")
    event = metric(None, 0.1, note="at 3 s by the engine alone")
    follows = metric(0.3, None, follows="other")
    run = _run("reference", "assisted", None, ())
    groups = [
        [], [small], [large], [small, large], [large, small], [unknown], [small, unknown],
        [large, unknown], [absent], [absent, small], [event, small], [follows], [follows, large],
        [metric(1e-2, 1e-2)], [metric(0.0, 1e-2)], [metric(0.2, None)],
    ]  # fmt: skip
    return [judgement(group, run).model_dump(mode="json") for group in groups]


CASES: dict[str, Callable[[], Any]] = {
    **{f"measured-{n.replace(' ', '-')}": (lambda n=n: measured(n)) for n in _BUILT},
    **{f"known-{n.replace(' ', '-')}": (lambda n=n: known(n)) for n in _BUILT if n != "everything"},
    **{
        f"onsets-{n.replace(' ', '-')}": (lambda n=n: onsets(n))
        for n in ("fixed", "stop and floor", "ball", "sprung", "flat")
    },
    **{
        f"diagnosed-{n.replace(' ', '-')}": (lambda n=n: diagnosed(n))
        for n in ("stop and floor", "sprung", "flat")
    },
    **{f"built-{n}": (lambda n=n: built(n)) for n in ("leaning", "weightless")},
    "built-elsewhere": built_elsewhere,
    **{f"checked-{n}": (lambda n=n: checked(n)) for n in _CHECKED},
    **{
        f"tolerances-{n.replace(' ', '-')}": (lambda n=n: held_against(n))
        for n in ("fixed", "stop and floor", "everything")
    },
    "tolerances-claims": claims,
    "durations-of-runs": durations,
    "impacts-aligned": aligned,
    "conformance-results": conformed,
    "conformance-judgements": judgements,
}
