"""`tb.converge`, `tb.explain`, `tb.recommend` and `tb.certify`: what the commands of these names do, in a session."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from functools import partial
from typing import Any, TypedDict, Unpack

from ...models.errors import InputError
from ...models.machines.parameters import TrebuchetParameters
from ...models.machines.registry import library_problem
from ...models.mechanism import Mechanism
from ...models.problem import Problem, StopLaw
from ...models.spec import Spec
from ...reference.certification import certify as certification
from ...reference.certification.certificate import Certificate
from ..converge import study as convergence
from ..converge.results import Studies
from ..explain import study as explanation
from ..explain.results import Explanation
from ..recommend import Advice, Asked
from ..recommend import study as advice
from ..recommend.search import read_torque
from ..runs.process import Worker
from ..runs.store import Store
from ..runs.study import PRESETS, Progress, Study

Given = str | Mechanism | Problem
"""Name of a machine or of a problem of the library, a mechanism of your own, or a problem."""


class How(TypedDict, total=False):
    """How runs are made; fields as those of :class:`..runs.study.Study`."""

    parameters: Spec | None
    """Of the named machines; their defaults if left out."""
    until: str | float | None
    """End of the compared motion: 'launch:MARKER', 'release:STOP', or a time [s]; the launch if left out."""
    stop_law: StopLaw | str | None
    """'release-once' or 'unilateral'."""
    store: Store | None
    """Where finished runs are kept."""
    isolate: bool
    """Simulate in a process of its own; true if left out."""
    timeout: float
    """Longest wait for one run [s]."""
    jobs: int
    """Engine runs made at once; 1 if left out."""
    progress: Progress | None
    """Called before each part with what it is, the number of parts done and of all parts."""


def converge(
    models: Given | Iterable[Given] = ("fixed", "rolling"),
    engines: Iterable[str] | None = None,
    *,
    knobs: Iterable[str] | None = None,
    options: Mapping[str, Any] | None = None,
    **how: Unpack[How],
) -> Studies:
    """Turn each engine's knobs and see how its error falls: orders, floors and their causes, Richardson limits.

        >>> import trebucheck as tb
        >>> studies = tb.converge("fixed", ["pymunk"], knobs=["timestep"])  # doctest: +SKIP
        >>> studies.plot("fixed-errors")  # doctest: +SKIP

    Args:
        models: names of machines or of the library's problems, mechanisms of your own, or problems;
        one or several.
        engines: names; all known ones if left out.
        knobs: names of the parameters to be swept, such as 'timestep'; all if left out.
        options: over each preset's, of every engine that has them, or of one, as 'mujoco.solref'.
        how: runs are made; see :class:`How`.

    Raises:
        InputError: a name or value is not valid, or there is nothing to do. A failed run is a
            failed point.
    """
    chosen = None if knobs is None else tuple(knobs)
    return convergence.converge(
        Study(_several(models), engines, options=options or {}, **how), chosen
    )


def explain(
    models: Given | Iterable[Given] = ("fixed", "rolling"),
    engines: Iterable[str] | None = None,
    presets: Iterable[str] = PRESETS,
    *,
    timestep: float | None = None,
    **how: Unpack[How],
) -> Explanation:
    """Split each engine's error among its causes, each measured by a run without it.

        >>> import trebucheck as tb
        >>> budget = tb.explain("fixed", ["mujoco"], ["stock"])  # doctest: +SKIP
        >>> budget.to_dataframe()[["cause", "fraction"]]  # doctest: +SKIP

    Args:
        models: names of machines or of the library's problems, mechanisms of your own, or problems;
        one or several.
        engines: names; all known ones if left out.
        presets: for which a budget is made: 'tuned', 'stock', or both.
        timestep: of every engine [s]; each preset's own if left out.
        how: runs are made; see :class:`How`.

    Raises:
        InputError: a name or value is not valid. A run that fails becomes a budget without shares.
    """
    options = {} if timestep is None else {"timestep": timestep}
    return explanation.explain(Study(_several(models), engines, presets, options=options, **how))


def recommend(
    model: Given = "fixed",
    engines: Iterable[str] | None = None,
    *,
    position: float | None = None,
    torque: float | str | None = None,
    release: float | None = None,
    neighbours: int = advice.NEIGHBOURS,
    **how: Unpack[How],
) -> Advice:
    """For each engine the cheapest measured settings that reach an accuracy, or what stands in the way.

        >>> import trebucheck as tb
        >>> advice = tb.recommend("rolling", ["mujoco"], position=1e-3)  # doctest: +SKIP
        >>> print(advice.engine("mujoco").snippets["trebucheck in Python"])  # doctest: +SKIP

    Args:
        model: name of a machine or of a problem of the library, a mechanism of your own, or a
        problem.
        engines: names; all known ones if left out.
        position: largest distance of any marker from the reference that is allowed [m].
        torque: largest error of any stop's torque [N m, or N on points], or a share of the largest:
        '0.1%'.
        release: largest error of any stop's release [s].
        neighbours: machines of the same kind that the settings must hold on, too; 0: only the
        machine itself.
        how: runs are made; see :class:`How`.

    Raises:
        InputError: nothing is asked, or a name or value is not valid. A run that fails raises
            nothing.
    """
    if position is None and torque is None and release is None:
        raise InputError("nothing is asked; give at least one of position, torque and release.")
    torques = (
        {}
        if torque is None
        else read_torque(torque if isinstance(torque, str) else repr(float(torque)))
    )
    return advice.recommend(Study([model], engines, **how), Asked(position=position, release=release, **torques),
                            neighbours)  # fmt: skip


def certify(
    model: Given = "fixed",
    parameters: TrebuchetParameters | None = None,
    *,
    duration: float | None = None,
    stop_law: StopLaw | str | None = None,
    timeout: float = 600.0,
    progress: Progress | None = None,
) -> Certificate:
    """Compute a machine's figures in every independent way there is: values and uncertainties.

        >>> import trebucheck as tb
        >>> certificate = tb.certify("fixed")  # doctest: +SKIP
        >>> certificate.figure("launch_time").texts  # doctest: +SKIP
        ('2.74281775577146', '4.0e-13')

    Args:
        model: name of a machine or of a problem of the library, a mechanism of your own, or a
        problem.
        parameters: of the paper's machines ('fixed' and 'rolling'); Table I if left out.
        duration: of the certified motion [s]; a problem's own, else up to the launch, if left out.
        stop_law: a problem's own, else 'release-once', if left out.
        timeout: longest wait for one computation [s].
        progress: called before each computation.

    Raises:
        InputError: a name or value is not valid.
        SimulationError: the motion could not be computed.
    """
    study = Study([model], [], parameters=parameters, stop_law=stop_law)
    (mechanism,) = study.mechanisms
    problem = (
        model
        if isinstance(model, Problem)
        else library_problem(model)
        if isinstance(model, str)
        else None
    )
    end = problem.duration if problem is not None and duration is None else duration
    with Worker(timeout) as worker:
        make = partial(
            certification.certify,
            mechanism,
            parameters,
            duration=end,
            stop_law=study.law_of(mechanism),
        )
        return make(progress=progress, call=worker.compute)


def _several(models: Given | Iterable[Given]) -> tuple[Given, ...]:
    return (models,) if isinstance(models, str | Mechanism | Problem) else tuple(models)
