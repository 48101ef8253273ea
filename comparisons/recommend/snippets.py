"""Settings as texts to paste: into the MJCF, the pymunk or the Exudyn script, and for trebucheck itself."""

from __future__ import annotations

import json
import shlex
from collections.abc import Mapping, Sequence
from typing import Any

from ...engines.registry import engine, engine_study
from ...models.mechanism import Mechanism
from ...reference.solver import characteristic_time

COMMAND, PYTHON = "trebucheck on the command line", "trebucheck in Python"
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
    duration = float(f"{_TO_A_LAUNCH * characteristic_time(mechanism):.3g}")
    return {
        **engine_study(name).snippets(settings, mechanism, duration),
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
