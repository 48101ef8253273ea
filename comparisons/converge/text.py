"""Texts that page and terminal share."""

from __future__ import annotations

from ..report.numbers import format_number as figure
from .results import Curve, Limit, LimitPair, MachineStudies, Point, PowerLaw, Studies, Study


def exponent(law: PowerLaw | None) -> str:
    """Exponent and half width of its confidence interval."""
    return "none" if law is None else f"{law.exponent:.3f} ± {law.half_width:.3f}"


def span(law: PowerLaw | None) -> str:
    """The range a law was seen over."""
    return "" if law is None else f"{figure(law.high)} to {figure(law.low)}"


def floor(curve: Curve) -> str:
    """A floor's error, or that there is none."""
    if curve.floor is not None:
        return f"{figure(curve.floor.error)} {curve.unit}"
    return "not reached"


def cause(curve: Curve) -> str:
    """What sets a floor."""
    return "" if curve.floor is None else curve.floor.cause


def distance(limit: Limit | None) -> str:
    """A limit's distance from the reference [m]."""
    return "none" if limit is None else figure(limit.position)


def is_of_the_step(study: Study) -> bool:
    """Whether a study turns the time step of a preset as it is."""
    return study.knob == "timestep"


def of_the_step(machine: MachineStudies) -> list[Study]:
    """The headline's studies."""
    return [study for study in machine.studies if is_of_the_step(study)]


def of_others(machine: MachineStudies) -> list[Study]:
    """Every other knob's study."""
    return [study for study in machine.studies if not is_of_the_step(study)]


def knob(study: Study) -> str:
    """A knob's option, or the integrator under which steps are turned, where that is not the preset's."""
    return str(study.base.get("integrator", study.knob))


def tuned_pairs(machine: MachineStudies) -> list[LimitPair]:
    """Limits of the tuned presets against each other."""
    return [pair for pair in machine.pairs if pair.first.endswith(" tuned") and pair.second.endswith(" tuned")]


def value(study: Study, point: Point) -> str:
    """A setting with its unit."""
    return f"{point.value:.3g}" if study.unit == "1" else f"{point.value:.3g} {study.unit}"


def failures(studies: Studies) -> list[str]:
    """One sentence a failed point, and one an engine that is not installed."""
    said = [
        f"{machine.model}, {study.label}, {study.title} = {value(study, point)}: {point.message}"
        for machine in studies.machines
        for study in machine.studies
        for point in study.points
        if point.message is not None
    ]
    absent = dict.fromkeys(name for machine in studies.machines for name in machine.absent)
    return [f"{name} is not installed here." for name in absent] + said
