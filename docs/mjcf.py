"""README and pictures of the committed MJCF files, with the accuracy that is measured here."""

from __future__ import annotations

import importlib
import os
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import trebucheck as tb
from PIL import Image
from trebucheck.models.arrays import FloatArray
from trebucheck.models.elements import PointStop
from trebucheck.models.kinematics import Kinematics
from trebucheck.models.library.registry import models, parameters_type
from trebucheck.models.mechanism import Mechanism
from trebucheck.models.mjcf.scene import SCENE_FILE, RecordedMotion
from trebucheck.models.mjcf.tree import joint_values
from trebucheck.models.mjcf.variants import POINT_INERTIA
from trebucheck.reference.solution import Solution
from trebucheck.reference.solver import solve

STEPS = (4e-3, 2e-3, 1e-3, 5e-4, 2.5e-4)
# Read when MuJoCo is loaded, as the engine's modules do, too; it has no type stubs.
os.environ.setdefault("MUJOCO_GL", "egl")
_library: Any = importlib.import_module("mujoco")
_rollout: Any = importlib.import_module("mujoco.rollout")
_STILL, _MOVING = (640, 480), (320, 240)
_COLOURS = 64
_LAST = 8  # frames for which the last picture stays


def readme(name: str, motion: RecordedMotion) -> str:
    """The whole page, in Markdown."""
    mechanism = tb.model(name)
    text = models()[name]
    # The oldest version that loaded the file when tried: see docs/importers.md.
    least = "3.3.0 or later (energy sensors)"
    if mechanism.point_stops:
        least = "3.3.5 or later (contact sensors)"
    parameters: list[tuple[str, str, str]] = []
    for key, field in parameters_type(name).model_fields.items():
        parameters.append((f"`{key}`", f"{field.default:.6g}", field.description or ""))
    parts = [
        f"<!-- written by docs/generate.py -->\n# {name} (MJCF)",
        f"{text[:1].upper()}{text[1:]}.",
        f"![The machine at its launch]({name}.png) ![The throw, in real time]({name}.gif)",
        f"Needs MuJoCo {least}. SI units.",
        _table(
            ("file", ""),
            (
                (f"`{name}.xml`", "the machine alone"),
                ("`scene.xml`", _SCENE),
                ("`motion.json`", _MOTION),
            ),
        ),
        _USE.format(name=name),
        "## Parameters\n\n" + _table(("parameter", "default", ""), parameters),
        "## Signs\n\n" + _signs(mechanism),
        "## Keyframes\n\n" + _keyframes(motion),
        "## Stops\n\n" + _stops(mechanism),
        "## Accuracy\n\n" + _accuracy(mechanism, motion),
        "## What reads it\n\n" + _IMPORTERS,
        "## The rest\n\n" + _REST.format(inertia=POINT_INERTIA),
    ]
    return "\n\n".join(parts) + "\n"


_SCENE = "with ground, frame, light and a camera, `side`, whose picture the motion fills"
_MOTION = "the certified events that are the keyframes, and the path that the camera is fitted to"
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


def _table(heads: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    return "\n".join(f"| {' | '.join(cells)} |" for cells in (heads, ("---",) * len(heads), *rows))


def _signs(mechanism: Mechanism) -> str:
    from trebucheck.engines.mujoco.read import absolute_from_relative

    model = _library.MjModel.from_xml_string(tb.mjcf(mechanism))
    joints = [model.joint(i).name for i in range(model.njnt)]
    sums = absolute_from_relative(mechanism, model)
    rows = []
    for coordinate, start, row in zip(mechanism.coordinates, mechanism.start, sums, strict=True):
        parts = (f"`{joint}`" for joint, weight in zip(joints, row, strict=True) if weight)
        rows.append((f"`{coordinate}`", " + ".join((f"{start:.6g}", *parts))))
    table = _table(("coordinate", "is [rad, m]"), rows)
    return _SIGNS.format(joints=", ".join(joints), table=table)


def _keyframes(motion: RecordedMotion) -> str:
    rows = [("`home`", "0", "the start, speeds included")]
    for key in motion.keyframes:
        about = "45 degrees" if key.name == "launch" else ""
        rows.append((f"`{key.name}`", f"{key.time:.9f}", about))
    table = _table(("key", "time [s]", ""), rows)
    return f"{table}\n\nStates of the certified motion; a test holds them to 1e-7."


def _stops(mechanism: Mechanism) -> str:
    if not mechanism.stops:
        return "There is none."
    rows: list[tuple[str, str, str]] = []
    for stop in mechanism.stops:
        if isinstance(stop, PointStop):
            limit = f"point of `{stop.body}` not beyond {stop.offset:.6g} m along {stop.normal}"
        else:
            low, angle = "at least" if stop.sense > 0 else "at most", stop.sense * stop.limit
            limit = f"`{stop.body}` {low} {angle:.6g} rad from `{stop.relative_to}`"
        rows.append((stop.name, limit, "closed" if stop.closed else "open"))
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
        located = tb.engine("mujoco", timestep=step).simulate(tb.Problem(mechanism, duration=end))
        runs = (t, q), (t, stale), (located.t, located.q)
        errors = [_error(solution, *run) for run in runs]
        exact = solution.motion(t[-1:])
        speed = _speed(mechanism, q[-1], u[-1]) - _speed(mechanism, exact.q[0], exact.u[0])
        rows.append((f"{step:g}", *(f"{error:.1e}" for error in errors), f"{abs(speed):.1e}"))
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
    from trebucheck.engines.mujoco.read import absolute_from_relative

    model = _library.MjModel.from_xml_string(text)
    data = _library.MjData(model)
    _library.mj_resetDataKeyframe(model, data, 0)
    kind = _library.mjtState.mjSTATE_FULLPHYSICS
    start = np.empty(_library.mj_stateSize(model, kind))
    _library.mj_getState(model, data, start, kind)
    n, sums = int(end / model.opt.timestep), absolute_from_relative(mechanism, model)
    states = _rollout.rollout(model, data, start[None], nstep=n)[0][0]
    data = _library.MjData(model)
    _library.mj_resetDataKeyframe(model, data, 0)
    _library.mj_step(model, data, n)
    assert np.array_equal(data.qpos, states[-1, 1 : 1 + model.nq]), "rollout and mj_step differ"
    q = np.array(mechanism.start) + states[:, 1 : 1 + model.nq] @ sums.T
    return states[:, 0], q, states[:, 1 + model.nq : 1 + model.nq + model.nv] @ sums.T


def _error(solution: Solution, t: FloatArray, q: FloatArray) -> float:
    """The largest distance of the projectile from where it should be [m]."""
    kinematics = Kinematics(solution.problem.mechanism)
    marker = solution.problem.mechanism.marker("projectile")
    assert marker is not None
    row = kinematics.point(marker.body, marker.point)
    exact = solution.trajectory(np.minimum(t, solution.problem.duration)).q
    distances = kinematics.position(row, q) - kinematics.position(row, exact)
    return float(np.linalg.norm(distances, axis=1).max())


def _speed(mechanism: Mechanism, q: FloatArray, u: FloatArray) -> float:
    """Speed of the projectile [m/s]."""
    kinematics, marker = Kinematics(mechanism), mechanism.marker("projectile")
    assert marker is not None
    row = kinematics.point(marker.body, marker.point)
    return float(np.linalg.norm(kinematics.velocity(row, q, u)))


def draw(mechanism: Mechanism, motion: RecordedMotion, folder: Path) -> None:
    """A picture at the end of the motion, `NAME.png`, and a moving one in real time, `NAME.gif`."""
    path = folder / SCENE_FILE
    still = Image.fromarray(next(_rendered(mechanism, motion.path[-1:], path, _STILL)))
    still.save(folder / f"{mechanism.name}.png", optimize=True)
    small = [Image.fromarray(pixels) for pixels in _rendered(mechanism, motion.path, path, _MOVING)]
    # One palette for all frames, from the first beside the last.
    both = Image.new("RGB", (2 * small[0].width, small[0].height))
    both.paste(small[0], (0, 0))
    both.paste(small[-1], (small[0].width, 0))
    palette = both.quantize(_COLOURS, Image.Quantize.MAXCOVERAGE)
    first, *others = (frame.quantize(palette=palette, dither=Image.Dither.NONE) for frame in small)
    wait = round(1000 * motion.keyframes[-1].time / (len(small) - 1))
    first.save(
        folder / f"{mechanism.name}.gif",
        save_all=True,
        append_images=[*others, *[others[-1]] * _LAST],
        duration=wait,
        loop=0,
        optimize=False,
    )


def _rendered(
    mechanism: Mechanism, states: Sequence[Sequence[float]], path: Path, size: tuple[int, int]
) -> Iterator[Any]:
    """The scene in each state of a motion."""
    model = _library.MjModel.from_xml_path(str(path))
    data = _library.MjData(model)
    with _library.Renderer(model, size[1], size[0]) as renderer:
        for q in states:
            data.qpos[:] = joint_values(mechanism, list(np.subtract(q, mechanism.start)))
            _library.mj_forward(model, data)
            renderer.update_scene(data, "side")
            yield renderer.render().copy()
