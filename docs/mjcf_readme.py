"""README of each committed MJCF file: parameters, signs, stops, keyframes and measured accuracy."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any

import mujoco
import numpy as np
import trebucheck as tb
from mujoco import rollout
from trebucheck.engines.mujoco.read import absolute_from_relative
from trebucheck.models.arrays import FloatArray
from trebucheck.models.elements import PointStop, Stop
from trebucheck.models.kinematics import Kinematics
from trebucheck.models.library.registry import models, parameters_type
from trebucheck.models.mechanism import Mechanism
from trebucheck.models.mjcf.scene import RecordedMotion
from trebucheck.models.mjcf.variants import POINT_INERTIA
from trebucheck.reference.solution import Solution
from trebucheck.reference.solver import solve

STEPS = (4e-3, 2e-3, 1e-3, 5e-4, 2.5e-4)
_library: Any = mujoco
_rollout: Any = rollout


def readme(name: str, motion: RecordedMotion) -> str:
    """The whole page, in Markdown."""
    mechanism = tb.model(name)
    text = models()[name]
    file = f"{name}.xml"
    parts = [
        f"<!-- written by docs/generate.py -->\n# {name} (MJCF)",
        f"{text[:1].upper()}{text[1:]}.",
        f"![The machine at its launch]({name}.png) ![The throw, in real time]({name}.gif)",
        f"Needs MuJoCo {_least_version(mechanism)}. SI units.",
        _table(
            ("file", ""),
            (
                (f"`{file}`", "the machine alone"),
                (
                    "`scene.xml`",
                    "with ground, frame, light and a camera, `side`, whose picture the motion "
                    "fills",
                ),
                (
                    "`motion.json`",
                    "the certified events that are the keyframes, and the path that the camera is "
                    "fitted to",
                ),
            ),
        ),
        _USE.format(name=name),
        "## Parameters\n\n" + _parameters(name),
        "## Signs\n\n" + _signs(mechanism),
        "## Keyframes\n\n" + _keyframes(motion),
        "## Stops\n\n" + _stops(mechanism),
        "## Accuracy\n\n" + _accuracy(mechanism, motion),
        "## What reads it\n\n" + _IMPORTERS,
        "## The rest\n\n" + _REST.format(inertia=POINT_INERTIA),
    ]
    return "\n\n".join(parts) + "\n"


_USE = """```python
import mujoco, trebucheck as tb

model = mujoco.MjModel.from_xml_path(tb.mjcf_path("{name}"))  # scene=True: the scene
# Other parameters, with keyframes of their own:
other = mujoco.MjModel.from_xml_string(tb.mjcf("{name}", g=9.8))
```"""

_LIMITS = """\
A stop is one end of a joint's range, whose other end is far away. Limits are soft in MuJoCo: under
load one gives way by (1 - d) a / k, with its impedance d, stiffness k, and the acceleration a that
it withholds. Here d is the greatest that MuJoCo takes and the time constant is two steps, the
shortest that it takes, so that what a limit gives way falls with the square of the step: whoever
changes `timestep` changes `solreflimit` with it, or asks `tb.mjcf` for another step. `margin` is
there because a limit acts only where the joint is strictly nearer: with 0 a stop that is closed at
the start would carry nothing then. A limit acts again whenever its joint comes back; the paper's
stops are gone once released. Up to the launch that is the same motion."""

_POINTS = """\
A stop on a point is a frictionless contact of a small ball with a plane (group 4, hidden). A slot
that closes a loop is a ball between two planes, both pressed against it by `margin`: as long as
both push they are one two-sided constraint without play. Ball and planes hang on bodies without
mass, where the softness follows the inertia that is felt there and a force sensor has a place. Only
the pairs that are listed touch. MuJoCo leaves the J-dot v term out of contacts, so that the file
alone loses a moving point at its wall and finds it again: no lift-off should be read off it.
Softness is scaled with the step: whoever changes `timestep` asks `tb.mjcf` for another step."""

_SIGNS = """\
The plane of motion is x-z: x is the direction of launch, z is up. Hinges turn about `0 1 0`, which
is clockwise seen from the camera, as the paper's angles are. Joints are relative to the parent and
read zero at the start. `qpos` is ({joints}).

{table}

`<stop>_torque` is a stop's torque, or the force of one on a point, never negative. `<joint>_force`
is the force of the parent on the child in the child's frame, of a joint that closes a loop the
opposite."""

_MEASURED = """\
Largest error of the projectile up to the launch [m], against the certified motion, by the step.
*plain*: `mujoco.mj_step` or `mujoco.rollout` (the same to the bit) on this file written for the
step; *softness kept*: this very file with another `timestep`; *events located*:
`tb.engine("mujoco")`, which adds what a file cannot: releases found inside a step, stops preloaded
and taken out once released, and the J-dot v term of points. The difference between the first and
the last of the three is what plain stepping costs. It does not fall regularly with the step: how
far a step goes beyond a release is chance, and points at walls are lost and found again."""

_IMPORTERS = """\
Verdicts from runs: loading, masses, accelerations, ranges, motion up to the first event and after
it. Who refuses or misreads the file was also given the variants without sensors and with finite
inertia; [all models and reports](../../../docs/importers.md).

<!-- generated: importers -->
<!-- end -->"""

_REST = """\
- Each body has an `<inertial>`; a point mass has {inertia:g} kg m^2, twice the least that MuJoCo
  takes. Of the other bodies all three moments of inertia are the one about the axis of the plane.
- Geoms are for looking at: no mass, no contact, sizes for the eye. Those in group 4 are the
  contacts'.
- RK4 is the integrator: MuJoCo's others are of first order here. In another scene (`MjSpec.attach`)
  the options are that scene's: give it this file's `timestep`, `integrator` and `tolerance`.
- Names have no blanks or slashes; `tb.mjcf_names` gives them by the mechanism's own and by those of
  earlier files.
- Variants: `tb.mjcf(..., sensors=False)` for older versions of MuJoCo; `finite_inertia=True` for
  importers that refuse or raise small inertias: mass moved across pins gives point masses one, with
  the same equations of motion. `throw=True`: the projectile is a body of its own, tied by the
  equality `hold_projectile`; `trebucheck.models.mjcf.throw.throw(model, data)` steps to the
  release, lets it go, and steps until it lands. In MuJoCo's tree it stays a child of the sling, so
  that plain steps move it off its parabola where the machine meets its stops after the release: by
  up to 7.4e-3 m in 2 s at 1 ms and 1.9e-3 m at 0.25 ms (fixed, rolling); without such impacts by
  2e-9 m.
- MIT licence, see LICENSE; changes are in CHANGELOG.md."""


def _least_version(mechanism: Mechanism) -> str:
    """Oldest version of MuJoCo that loaded the file when tried: see docs/importers.md."""
    return (
        "3.3.5 or later (contact sensors)"
        if mechanism.point_stops
        else "3.3.0 or later (energy sensors)"
    )


def _table(heads: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    return "\n".join(f"| {' | '.join(cells)} |" for cells in (heads, ("---",) * len(heads), *rows))


def _parameters(name: str) -> str:
    fields = parameters_type(name).model_fields
    return _table(
        ("parameter", "default", ""),
        ((f"`{key}`", f"{f.default:.6g}", f.description or "") for key, f in fields.items()),
    )


def _signs(mechanism: Mechanism) -> str:
    model = _library.MjModel.from_xml_string(tb.mjcf(mechanism))
    joints, sums = (
        [model.joint(i).name for i in range(model.njnt)],
        absolute_from_relative(mechanism, model),
    )
    rows = []
    for coordinate, start, row in zip(mechanism.coordinates, mechanism.start, sums, strict=True):
        parts = (f"`{joint}`" for joint, weight in zip(joints, row, strict=True) if weight)
        rows.append((f"`{coordinate}`", " + ".join((f"{start:.6g}", *parts))))
    return _SIGNS.format(
        joints=", ".join(joints), table=_table(("coordinate", "is [rad, m]"), rows)
    )


def _keyframes(motion: RecordedMotion) -> str:
    rows = [("`home`", "0", "the start, speeds included")]
    rows += [
        (f"`{key.name}`", f"{key.time:.9f}", "45 degrees" if key.name == "launch" else "")
        for key in motion.keyframes
    ]
    return (
        _table(("key", "time [s]", ""), rows)
        + "\n\nStates of the certified motion; a test holds them to 1e-7."
    )


def _stops(mechanism: Mechanism) -> str:
    def limit(stop: Stop | PointStop) -> str:
        if isinstance(stop, PointStop):
            return f"point of `{stop.body}` not beyond {stop.offset:.6g} m along {stop.normal}"
        low = "at least" if stop.sense > 0 else "at most"
        return f"`{stop.body}` {low} {stop.sense * stop.limit:.6g} rad from `{stop.relative_to}`"

    rows = (
        (stop.name, limit(stop), "closed" if stop.closed else "open") for stop in mechanism.stops
    )
    if not mechanism.stops:
        return "There is none."
    about = _POINTS if mechanism.point_stops else _LIMITS
    return f"{_table(('stop', 'limit', 'at the start'), rows)}\n\n{about}"


def _accuracy(mechanism: Mechanism, motion: RecordedMotion) -> str:
    end = next(key.time for key in motion.keyframes if key.name == "launch")
    solution = solve(tb.Problem(mechanism, duration=end))
    rows = []
    for step in STEPS:
        t, q, u = _rolled_out(mechanism, tb.mjcf(mechanism, timestep=step), end)
        fixed = tb.mjcf(mechanism).replace('timestep="0.001"', f'timestep="{step!r}"')
        _, stale, _ = _rolled_out(mechanism, fixed, end)
        own = tb.engine("mujoco", timestep=step).simulate(tb.Problem(mechanism, duration=end))
        errors = (
            _error(solution, t, q),
            _error(solution, t, stale),
            _error(solution, own.t, own.q),
        )
        speed = abs(_speed(mechanism, q[-1], u[-1]) - _speed(mechanism, *_state(solution, t[-1])))
        rows.append((f"{step:g}", *(f"{error:.1e}" for error in errors), f"{speed:.1e}"))
    heads = (
        "step [s]",
        "plain",
        "softness kept",
        "events located",
        "plain: speed at the last step [m/s]",
    )
    return f"{_MEASURED}\n\n{_table(heads, rows)}"


def _rolled_out(
    mechanism: Mechanism, text: str, end: float
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Times [s] and the mechanism's q and u of plain stepping from the start."""
    model = _library.MjModel.from_xml_string(text)
    data = _library.MjData(model)
    _library.mj_resetDataKeyframe(model, data, 0)
    kind = _library.mjtState.mjSTATE_FULLPHYSICS
    start = np.empty(_library.mj_stateSize(model, kind))
    _library.mj_getState(model, data, start, kind)
    n, sums = int(end / model.opt.timestep), absolute_from_relative(mechanism, model)
    states = _rollout.rollout(model, data, start[None], nstep=n)[0][0]
    _refuse_other_motion(model, states[-1], n)
    q = np.array(mechanism.start) + states[:, 1 : 1 + model.nq] @ sums.T
    return states[:, 0], q, states[:, 1 + model.nq : 1 + model.nq + model.nv] @ sums.T


def _refuse_other_motion(model: Any, last: FloatArray, n: int) -> None:
    data = _library.MjData(model)
    _library.mj_resetDataKeyframe(model, data, 0)
    _library.mj_step(model, data, n)
    assert np.array_equal(data.qpos, last[1 : 1 + model.nq]), "rollout and mj_step differ"


def _error(solution: Solution, t: FloatArray, q: FloatArray) -> float:
    """The largest distance of the projectile from where it should be [m]."""
    kinematics = Kinematics(solution.problem.mechanism)
    marker = solution.problem.mechanism.marker("projectile")
    assert marker is not None
    row = kinematics.point(marker.body, marker.point)
    exact = solution.trajectory(np.minimum(t, solution.problem.duration)).q
    return float(
        np.linalg.norm(kinematics.position(row, q) - kinematics.position(row, exact), axis=1).max()
    )


def _state(solution: Solution, t: float) -> tuple[FloatArray, FloatArray]:
    motion = solution.motion(np.array([t]))
    return motion.q[0], motion.u[0]


def _speed(mechanism: Mechanism, q: FloatArray, u: FloatArray) -> float:
    """Speed of the projectile [m/s]."""
    kinematics, marker = Kinematics(mechanism), mechanism.marker("projectile")
    assert marker is not None
    return float(
        np.linalg.norm(kinematics.velocity(kinematics.point(marker.body, marker.point), q, u))
    )
