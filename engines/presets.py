"""Names of presets: how the numerical options of an engine are chosen, alike for every engine.

:data:`DEFAULT` shows what somebody gets who sets nothing, :data:`SETTINGS` what the engine can do,
:data:`ASSISTED` what it can do with the help of trebucheck. The first two are runs of the engine
alone: its adapter builds the model, calls the engine's own step and reads.
"""

from __future__ import annotations

import warnings
from collections.abc import Collection, Mapping

DEFAULT = "default"
SETTINGS = "settings"
ASSISTED = "assisted"
GIVEN = "given"
"""A model file as it is, for mechanisms that were read from one; run where it is asked for."""
PRESETS = (DEFAULT, SETTINGS, ASSISTED)
"""The presets of every mechanism, in the order in which they are shown."""

MEANINGS: Mapping[str, str] = {
    DEFAULT: "what the engine does where nothing is set",
    SETTINGS: "the best that options of the engine itself reach at the stated step",
    ASSISTED: "the same with what trebucheck does in the engine's place",
    GIVEN: "the model file that the mechanism was read from, moved with its own options",
}
FORMER_NAMES: Mapping[str, str] = {"stock": DEFAULT, "tuned": ASSISTED}
"""Presets by the names that they had in an earlier release, which are read for one more."""
_WHAT_CHANGED = {
    "stock": "it is what the engine does where nothing is set, with the engine's own step; 'stock' "
    "was a choice of trebucheck",
    "tuned": "its options are those of 'tuned'; trebucheck's part in it is said in each row",
}


def resolved(asked: str, known: Collection[str]) -> str:
    """The name of an engine's preset, asked for by its present or its former name.

    A former name is taken with a warning that says what the preset is now. A plug-in of an earlier
    release has the former names, and is asked by either.

    Args:
        asked: a name; one that is none comes back as it is.
        known: presets of the engine.
    """
    if asked in known:
        return asked
    current = FORMER_NAMES.get(asked)
    if current is not None and current in known:
        message = f"the preset {asked!r} is called {current!r} now: {_WHAT_CHANGED[asked]}."
        warnings.warn(message, FutureWarning, stacklevel=2)
        return current
    former = next((name for name, now in FORMER_NAMES.items() if now == asked), asked)
    return former if former in known else asked
