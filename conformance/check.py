"""`tb.check`: one engine on one problem, as an assertion."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from ..comparisons.compare import MachineRuns, RunKey
from ..comparisons.report.pages.tables import complaints, diagnosis
from ..comparisons.runs.quantities import QUANTITIES, judged_quantity
from ..comparisons.runs.results import COMPARED, Run
from ..comparisons.runs.study import Study
from ..engines.protocol import Engine
from ..engines.registry import engine_class
from ..models.errors import EngineNotInstalledError, InputError
from ..models.library.registry import Model, model_of
from ..models.problem import StopLaw
from .suite import Target, absence


def check(
    engine: str | Engine,
    model: Model = "fixed",
    *,
    duration: float | None = None,
    until: str | float | None = None,
    stop_law: StopLaw | str | None = None,
    options: Mapping[str, Any] | None = None,
    timestep: float | None = None,
    timeout: float = 600.0,
    isolate: bool = True,
    diagnose: bool = True,
    **tolerances: float | str,
) -> Run:
    """Assert that an engine agrees with the reference: `tb.check("mujoco", "fixed", energy=1e-6)`.

    Args:
        engine: NAME, NAME/PRESET, or the same with 'package.module:Class' for the name; or an
            engine as `tb.engine` makes it.
        model: name of a machine or of a problem of the library, path of a mechanism's .json file, a
            mechanism, or a problem.
        duration: end of the compared motion [s]; a problem's own, else the launch, if left out.
        until: the end in other words, as `compare` takes it.
        stop_law: 'release-once' or 'unilateral'; a problem's own, else 'release-once', if left out.
        options: of the engine, over its preset's.
        timestep: of the engine [s]; its preset's own if left out.
        timeout: longest wait for the run [s].
        isolate: run the engine in a process of its own, so that its crash fails only the check.
        diagnose: look for the cause of what is broken, which runs the engine again, several times.
        tolerances: by quantity as `trebucheck compare --tolerance` takes them, with '_' for '-': in
            the quantity's unit, or in parts of its scale as '0.1%'. Only these quantities are
            judged; where none is named all are, by the engine's claims and the default.

    Returns:
        The run with all its metrics.

    Raises:
        AssertionError: a tolerance does not hold, a quantity could not be judged, or the engine
            failed, refused the problem or built another mechanism; the text names quantity, error,
            tolerance and, where known, the cause.
        InputError: a name, a quantity or a value is not valid.
        EngineNotInstalledError: the engine is not here.
    """
    __tracebackhide__ = True
    target = Target.of(engine) if isinstance(engine, str) else Target(engine.name, engine.preset)
    if not engine_class(target.engine).is_installed():
        raise EngineNotInstalledError(absence(engine_class(target.engine)))
    study = Study.of(
        model_of(model),
        target.engine if isinstance(engine, str) else engine,
        target.preset,
        options=options,
        timestep=timestep,
        duration=duration,
        until=until,
        stop_law=stop_law,
        tolerances={_title(name): value for name, value in tolerances.items()},
        timeout=timeout,
        isolate=isolate,
        diagnose=diagnose,
    )
    with study.worker() as worker:
        runs = MachineRuns(study, study.mechanisms[0], worker)
        made = study.engine(target.engine, target.preset)
        name = runs.runner.mechanism.name
        runner = study.engine_for(name, runs.machine.scales, made)
        run = runs.run(RunKey(name, target.engine, target.preset), runner).run
    faults = _faults(run, frozenset(study.needs.by_quantity))
    if faults:
        faults[0] = f"{target.label} on {name!r}: {faults[0]}"
        raise AssertionError("\n".join([*faults, *diagnosis(run)]))
    return run


def _title(name: str) -> str:
    """Title of a quantity: 'launch_time' and 'stop-torque:sling rest' both name one."""
    title, colon, subject = name.partition(":")
    plain = title if title in QUANTITIES else title.replace("_", "-")
    if plain == "default":
        return name
    try:
        judged_quantity(plain)
    except InputError as error:
        raise InputError(str(error).replace("tolerance ", "quantity ", 1)) from None
    return f"{plain}{colon}{subject}"


def _faults(run: Run, wanted: frozenset[tuple[str, str | None]]) -> list[str]:
    """Sentences; none where the check holds."""
    if run.outcome not in COMPARED:
        return [f"{run.outcome.value}: {run.message}"]
    metrics = [
        m for m in run.metrics if not wanted or {(m.name, m.subject), (m.name, None)} & wanted
    ]
    absent = sorted({name for name, _ in wanted} - {m.name for m in metrics})
    chosen = run.model_copy(update={"metrics": tuple(metrics)})
    faults = [
        *complaints(chosen),
        *(f"{m.label}: not judged: {m.note or 'it has no tolerance'}" for m in chosen.unjudged),
        *(f"{QUANTITIES[name].title}: not judged: this motion has none" for name in absent),
    ]
    if not (chosen.judged or absent or chosen.unjudged):
        faults.append("nothing was judged")
    return faults
