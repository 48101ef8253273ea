"""The paper, claim by claim: its figures drawn again, its numbers judged by stated rules."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from trebucheck.api.mechanics import TrebuchetParameters
    from trebucheck.api.studies import Progress

    from .evidence.claims import Study

__all__ = ["paper"]


def paper(
    engines: Sequence[str] | None = None,
    parameters: TrebuchetParameters | None = None,
    *,
    sections: Sequence[str] | None = None,
    timeout: float = 600.0,
    progress: Progress | None = None,
) -> Study:
    """Judge every claim of the paper that a solver can reach; see :func:`.study.study`.

    >>> import trebucheck as tb
    >>> judged = tb.paper(["mujoco"], sections=["sweep"])  # doctest: +SKIP
    >>> judged.to_dataframe()["verdict"].value_counts()  # doctest: +SKIP
    """
    from .study import study

    return study(engines, parameters, sections=sections, timeout=timeout, progress=progress)
