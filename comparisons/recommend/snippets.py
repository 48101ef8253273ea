"""Settings as texts to paste: into the MJCF, the pymunk or the Exudyn script, and for trebucheck itself."""

from __future__ import annotations

import json
import shlex
from collections.abc import Callable, Mapping, Sequence
from importlib.resources import files
from typing import Any

from jinja2 import Environment, StrictUndefined

from ...engines.mujoco.engine import MujocoEngine
from ...engines.registry import engine
from ...models.mechanism import Mechanism
from ...reference.solver import characteristic_time

COMMAND, PYTHON = "trebucheck on the command line", "trebucheck in Python"
MJCF, MUJOCO_PYTHON = "MJCF", "MuJoCo in Python"
PYMUNK_PYTHON, EXUDYN_PYTHON = "pymunk in Python", "Exudyn in Python"
_TO_A_LAUNCH = 2.0  # characteristic times: most launches come by then


def snippets(
    name: str, mechanism: Mechanism, preset: str, changes: Mapping[str, Any], words: Sequence[str] = ()
) -> dict[str, str]:
    """Texts to paste, by what they are for; the trebucheck ones last.

    Args:
        name: of the engine.
        mechanism: the machine they are for.
        preset: the settings start from.
        changes: options set over the preset, the time step included.
        words: how the machine is named on the command line; by its name if left out.
    """
    settings = engine(name, preset, **changes)
    own = _OF[name](settings, mechanism) if name in _OF else {}
    return own | {
        COMMAND: _command(name, words or ("--model", mechanism.name), preset, changes),
        PYTHON: _python(name, preset, changes),
    }


def _command(name: str, machine: Sequence[str], preset: str, changes: Mapping[str, Any]) -> str:
    words = ["trebucheck", "run", "--engine", name, *map(shlex.quote, machine), "--preset", preset]
    for key, value in changes.items():
        if key == "timestep":
            words += ["--timestep", repr(value)]
        else:
            text = value if isinstance(value, str) else json.dumps(value, separators=(",", ":"))
            words += ["--option", shlex.quote(f"{key}={text}")]
    return " ".join(words)


def _python(name: str, preset: str, changes: Mapping[str, Any]) -> str:
    options = "".join(f", {key}={value!r}" for key, value in changes.items())
    return f'import trebucheck as tb\n\nengine = tb.engine("{name}", "{preset}"{options})'


def _mujoco(settings: Any, mechanism: Mechanism) -> dict[str, str]:
    # The model as it is built knows the softness that follows from the step, and where stops are on tendons.
    from ...engines.mujoco.build import load

    assert isinstance(settings, MujocoEngine)
    model = load(mechanism, settings)
    points = bool(mechanism.point_stops or mechanism.loop_joints)
    outside = [
        words
        for asked, words in (
            (not settings.keep_limits, "limits taken out when they release"),
            (settings.locate_releases, "releases found inside a step"),
            (settings.preload, "limits preloaded"),
            (settings.free_substeps > 1, "shorter steps after the last release"),
            (settings.moving_points and points, "points held through all stages of a step by `mjcb_control`"),
        )
        if asked
    ]
    given: dict[str, Any] = {
        "options": settings, "solref": model.jnt_solref[0].tolist(), "tendons": model.ntendon > 0, "outside": outside,
        "points": points,
    }  # fmt: skip
    found = {MJCF: _filled("mujoco.xml.j2", **given)}
    # The callback that holds points is no text to paste: such a machine is run by trebucheck's own lines.
    return found | ({MUJOCO_PYTHON: _filled("mujoco.py.j2", **given)} if outside and not points else {})


def _pymunk(settings: Any, _: Mechanism) -> dict[str, str]:
    return {PYMUNK_PYTHON: _filled("pymunk.py.j2", options=settings)}


def _exudyn(settings: Any, mechanism: Mechanism) -> dict[str, str]:
    end = float(f"{_TO_A_LAUNCH * characteristic_time(mechanism):.3g}")
    points = bool(mechanism.point_stops)
    return {EXUDYN_PYTHON: _filled("exudyn.py.j2", options=settings, end=end, points=points)}


_OF: dict[str, Callable[[Any, Mechanism], dict[str, str]]] = {
    "mujoco": _mujoco, "pymunk": _pymunk, "exudyn": _exudyn,
}  # fmt: skip


def _filled(template: str, **given: Any) -> str:
    environment = Environment(  # nothing here is HTML
        undefined=StrictUndefined, trim_blocks=True, lstrip_blocks=True, autoescape=False
    )
    text = (files(__name__.rpartition(".")[0]) / "templates" / template).read_text(encoding="utf-8")
    return environment.from_string(text).render(number=_number, numbers=_numbers, **given).strip("\n")


def _number(value: float) -> str:
    """The shortest decimal that reads back to the same float64."""
    return repr(float(value)).removesuffix(".0")


def _numbers(values: Sequence[float]) -> str:
    return " ".join(map(_number, values))
