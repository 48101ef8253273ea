"""Certificates of models: every figure with an uncertainty, computed in a process of its own."""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import Any

from ..models.errors import InputError, SimulationError
from ..models.library.registry import Model, model_of
from ..models.library.trebuchet import TrebuchetParameters
from ..models.problem import Problem, StopLaw
from ..reference.certification import certify as certification
from ..reference.certification.certificate import Certificate
from .runs.study import Progress, Study


def certify(
    model: Model = "fixed",
    parameters: TrebuchetParameters | None = None,
    *,
    duration: float | None = None,
    stop_law: StopLaw | str | None = None,
    timeout: float = 600.0,
    cluster: Any = None,
    progress: Progress | None = None,
    command: str = "",
) -> Certificate:
    """Compute a machine's figures in every independent way there is: values and uncertainties.

        >>> import trebucheck as tb
        >>> certificate = tb.certify("fixed")  # doctest: +SKIP
        >>> certificate.figure("launch_time").texts  # doctest: +SKIP
        ('2.74281775577146', '3.4e-13')

    Args:
        model: name of a machine or of a problem of the library, path of a mechanism's .json file, a
            mechanism, or a problem.
        parameters: of the paper's machines ('fixed' and 'rolling'); Table I if left out.
        duration: of the certified motion [s]; a problem's own, else up to the launch, if left out.
        stop_law: a problem's own, else 'release-once', if left out.
        timeout: longest wait for one computation [s].
        cluster: Dask cluster that computes instead, as :func:`cluster` takes it.
        progress: called before each computation.
        command: line that makes the same certificate, to be written into it.

    Raises:
        InputError: a name or value is not valid.
        SimulationError: the motion could not be computed.
    """
    given = model_of(model, parameters)
    study = Study([given], [], stop_law=stop_law, timeout=timeout, cluster=cluster)
    (mechanism,) = study.mechanisms
    if duration is None and isinstance(given, Problem):
        duration = given.duration
    with study.worker() as worker:
        make = partial(
            certification.certify,
            mechanism,
            parameters,
            duration=duration,
            stop_law=study.law_of(mechanism),
            command=command,
        )
        return make(progress=progress, call=worker.compute)


def refuse_contradicted(path: Path, certificate: Certificate) -> None:
    """Hold a file with an older certificate of the mechanism, if it is one, against a proof.

    Raises:
        SimulationError: the proof contradicts one of its figures.
    """
    try:
        older = Certificate.from_json(path.read_bytes())
    except (OSError, InputError):
        return  # no certificate
    if older.mechanism_hash != certificate.mechanism_hash:
        return
    for figure in older.figures:
        newer = certificate.figure(figure.name, figure.subject, figure.at)
        if newer is None:
            continue
        try:
            figure.with_fields(proved_value=newer.proved_value, proved_radius=newer.proved_radius)
        except InputError as error:
            raise SimulationError(f"{path}, which is kept: {error}") from None
