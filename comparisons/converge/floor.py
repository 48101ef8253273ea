"""What sets a floor: decided by turning every other knob by one notch, there, and looking which one moves it."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from ...engines.registry import engine
from ...models.errors import InputError
from ...reference.certification.certificate import REFUSED_BELOW
from ..report.numbers import format_number
from .results import Floor

Settings = Mapping[str, Any]
Change = Callable[[Settings], dict[str, Any] | None]

MOVED = 0.8
"""A notch that leaves less than this of an error has moved it: the smallest notch, a halving at first order, leaves
0.5, and 0.8 where only two fifths of the error are of its making."""
_TOLD = 3  # notches in the evidence
GROWN = 1.5
"""An error this many times the floor, at a finer value, is one that grows."""


@dataclass(frozen=True)
class Notch:
    """One knob turned a little further, or set as the tuned preset has it."""

    cause: str
    words: str
    change: Change
    """The changed options; None where there is nothing to turn."""


def _softer(settings: Settings) -> dict[str, Any] | None:
    """Half the time constant of the limits."""
    if "solref" not in settings:
        return None
    h, solref = float(settings["timestep"]), settings["solref"]
    stiffness, damping = solref or (-1.0 / h**2, -2.0 / h)
    if stiffness < 0:
        return {"solref": (4.0 * stiffness, 2.0 * damping)}
    # MuJoCo does not go below two steps with the positive form.
    return {"solref": (stiffness / 2, damping)} if stiffness >= 4 * h else None


def _stiffer_impedance(settings: Settings) -> dict[str, Any] | None:
    solimp = settings.get("solimp")
    if solimp is None or min(1 - solimp[0], 1 - solimp[1]) < 2e-4:  # MuJoCo's own bound is 1e-4
        return None
    return {"solimp": ((1 + solimp[0]) / 2, (1 + solimp[1]) / 2, *solimp[2:])}


def _times(option: str, factor: float) -> Change:
    def change(settings: Settings) -> dict[str, Any] | None:
        value = settings.get(option)
        return None if not value else {option: type(value)(value * factor)}

    return change


NOTCHES: tuple[Notch, ...] = (
    Notch("time step", "half the time step", _times("timestep", 0.5)),
    Notch("softness of the limits", "half the limits' time constant", _softer),
    Notch("softness of the limits", "half the limits' 1 - d", _stiffer_impedance),
    Notch("solver's tolerance", "a hundredth of the tolerance", _times("tolerance", 0.01)),
    Notch("solver's iterations", "four times the iterations", _times("iterations", 4)),
    Notch("first step's iterations", "four times the first step's iterations", _times("start_iterations", 4)),
    Notch("mass of the pinned body", "ten times the pivot mass", _times("pivot_mass", 10.0)),
    Notch("Newton's tolerance", "a hundredth of Newton's relative tolerance", _times("newton_relative", 0.01)),
    Notch("Newton's tolerance", "a hundredth of Newton's absolute tolerance", _times("newton_absolute", 0.01)),
    Notch("softness of the stops", "twice the stops' stiffness", _times("stop_stiffness", 2.0)),
)


def notches(name: str, settings: Settings, turned: Sequence[str]) -> Iterator[tuple[Notch, dict[str, Any]]]:
    """Every notch there is at an engine's settings, and every option the tuned preset has otherwise, one at a time.

    Args:
        name: of the engine.
        turned: options of the study's own knob, which are left alone.
    """
    own = {"timestep"} if not settings else set(settings)
    for notch in NOTCHES:
        change = notch.change(settings)
        if change and not set(change) & set(turned) and set(change) <= own:
            yield notch, change
    for option, value in _tuned(name).items():
        if option in settings and settings[option] != value and option not in (*turned, "timestep"):
            yield Notch(f"option {option}", f"{option} as tuned", lambda _: None), {option: value}


def _tuned(name: str) -> dict[str, Any]:
    return engine(name, "tuned").settings


@dataclass(frozen=True)
class Site:
    """Where a floor is looked into."""

    engine: str
    settings: Settings
    turned: Sequence[str]
    error: float
    value: float | None
    measure: Callable[[dict[str, Any]], float | None]
    """The error with some options changed; None if the run fails."""


def floor(site: Site, uncertainty: float, finer: Sequence[tuple[float, float]] = ()) -> Floor:
    """Decide what sets an error that the study's own knob does not lower.

    Args:
        site: where, and how errors are measured there.
        uncertainty: of the reference, in the error's unit.
        finer: value and error of points beyond, towards finer values.
    """

    def because(cause: str, evidence: str) -> Floor:
        return Floor(error=site.error, value=site.value, cause=cause, evidence=evidence)

    if site.error <= REFUSED_BELOW * uncertainty:
        return because(
            "the reference's uncertainty", f"it is known to {format_number(uncertainty)}, a tenth of this or more"
        )
    grown = [(value, error) for value, error in finer if error >= GROWN * site.error]
    if grown and site.value is not None and "timestep" in site.turned:
        value, error = grown[-1]
        power = math.log(error / site.error) / math.log(value / site.value)
        return because("rounding", f"grows again as the step h shrinks, as h^{power:.1f} to {format_number(value)} s")
    return because(*_moved_most(site))


def _moved_most(site: Site) -> tuple[str, str]:
    left: list[tuple[float, Notch]] = []
    for notch, change in notches(site.engine, site.settings, site.turned):
        try:
            error = site.measure(change)
        except InputError:
            continue  # a notch beyond what the engine takes
        if error is not None:
            left.append((error / site.error, notch))
    moved = sorted(((share, notch) for share, notch in left if share <= MOVED), key=lambda found: found[0])
    if not moved:
        return "not found", f"none of {len(left)} other knobs, turned one notch, lowers it by a fifth"
    told = "; ".join(f"{notch.words} leaves {share:.2g}" for share, notch in moved[:_TOLD])
    return moved[0][1].cause, told
