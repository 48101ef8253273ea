"""The studies beside the throws, by name: each computed from the paper's parameters alone."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from ..comparisons.runs.worker import Worker
from ..models.machines.parameters import TrebuchetParameters
from ..models.machines.trebuchet import fixed
from ..models.spec import Spec

Compute = Callable[[TrebuchetParameters, Sequence[str]], Spec]


def identification(parameters: TrebuchetParameters, engines: Sequence[str]) -> Spec:
    """The start angles from the printed figures."""
    from .identification.study import identify

    return identify(parameters)


def drag(parameters: TrebuchetParameters, engines: Sequence[str]) -> Spec:
    """The drag area from Table II."""
    from .drag.study import drag_study

    return drag_study(fixed(parameters))


def sweep(parameters: TrebuchetParameters, engines: Sequence[str]) -> Spec:
    """The fulcrum's place."""
    from .sweep.study import PAPER_PEAK, WITH_ENGINES, fulcrum_sweep

    places = (*WITH_ENGINES, PAPER_PEAK)  # a number in print is every engine's to confirm
    with Worker() as worker:
        return fulcrum_sweep(parameters, engines=_others(engines), worker=worker, with_engines=places)


def design(parameters: TrebuchetParameters, engines: Sequence[str]) -> Spec:
    """A rolling machine whose peak and best angle coincide."""
    from .design.study import design_rolling

    with Worker() as worker:
        return design_rolling(parameters, engines=_others(engines), worker=worker)


def machines(parameters: TrebuchetParameters, engines: Sequence[str]) -> Spec:
    """Every machine the paper names, and what it makes of its energy."""
    from .machines.study import efficiencies

    return efficiencies(_others(engines))


def _others(engines: Sequence[str]) -> tuple[str, ...]:
    return tuple(name for name in engines if name != "reference")


# The longest first: two run at a time.
SECTIONS: dict[str, Compute] = {
    "design": design,
    "machines": machines,
    "sweep": sweep,
    "identification": identification,
    "drag": drag,
}
