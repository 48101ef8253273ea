"""The paper, claim by claim: its figures drawn again, its numbers judged by stated rules.

The public function `trebucheck.paper()` and this subpackage share one name; why it is a module that
can be called is said in :mod:`..engines`.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence
from types import ModuleType
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from ..comparisons.runs.study import Progress
    from ..models.machines.parameters import TrebuchetParameters
    from .evidence.claims import Study


class _CallableModule(ModuleType):
    def __call__(
        self,
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


sys.modules[__name__].__class__ = _CallableModule
