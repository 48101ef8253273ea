"""Limits of an engine that holds stops itself, under a law by which they release for good.

Where a limit stays in the model it is met again. An adapter that takes it out has an option for it.
"""

from __future__ import annotations

from typing import Annotated

from pydantic import Field
from trebucheck.engines.supplied import Assistance, Part, has_stops

HELD_FROM_BOTH_SIDES = Assistance(
    Part.EVENTS,
    "holds a stop from both sides while it pushes, and lets it go where it would pull",
    "hold",
    off=False,
    acts_on=has_stops,
)
"""Work of the option `hold` of an adapter that has it."""

KeepLimits = Annotated[
    bool,
    Field(
        description="keep the limit of every stop for the whole run, whatever the law: otherwise a "
        "stop that releases for good is taken out where its limit no longer pushes",
    ),
]
"""The option `keep_limits`."""

LIMITS_TAKEN_OUT = Assistance(
    Part.EVENTS,
    "takes the limits of stops that are open for good out of the model",
    "keep_limits",
    off=True,
    acts_on=has_stops,
)
"""What the adapter does where it is off."""
