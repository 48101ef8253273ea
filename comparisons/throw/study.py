"""Derivatives of a named machine's launch, for the report of a throw."""

from __future__ import annotations

import math
import re

from ...models.machines.parameters import TrebuchetParameters
from ...models.machines.registry import model
from ...reference.throw.throw import Sensitivity


def sensitivities_of(name: str, parameters: TrebuchetParameters) -> tuple[Sensitivity, ...]:
    """Derivatives of a named machine's launch at 45 degrees, in vacuum, by all its parameters and start values.

    Raises:
        InputError: there is no such machine, or it does not launch.
    """
    from ...reference.throw.sensitivity import sensitivities

    model(name, parameters)  # refuses an unknown name before long work
    found = sensitivities(lambda p: model(name, p), parameters)
    return tuple(
        Sensitivity(
            name=each,
            value=float(found.values[i]),
            unit=_unit(each),
            launch_time=float(found.d_launch_time[i]),
            launch_speed=float(found.d_launch_speed[i]),
            range=None if math.isnan(found.d_range[i]) else float(found.d_range[i]),
        )
        for i, each in enumerate(found.names)
    )


def _unit(name: str) -> str:
    """Of a parameter, from its own description; of a start speed or start slide, by its name."""
    if name in TrebuchetParameters.model_fields:
        unit = re.search(r"\[(.+)\]", TrebuchetParameters.model_fields[name].description or "")
        return unit.group(1) if unit else ""
    slide = "x_p" in name
    return ("m/s" if slide else "rad/s") if name.startswith("u_") else "m" if slide else "rad"
