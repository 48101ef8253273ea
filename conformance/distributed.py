"""The suite in several processes of pytest-xdist: which of them has which check."""

from __future__ import annotations

from typing import Any

import pytest

ROWS = "trebucheck_rows"
"""What a process of pytest-xdist says in the end: the rows of the file of deviations that were chosen."""
_SLASHES = 3  # engine/preset/problem/check


def scheduler(config: pytest.Config, log: Any) -> Any:
    """A scheduler that gives all checks of a problem to one process, and other tests as `--dist` says."""
    from xdist.scheduler import LoadFileScheduling, LoadGroupScheduling, LoadScopeScheduling

    dist = str(config.getoption("dist"))
    by_dist: dict[str, type[LoadScopeScheduling]] = {
        "loadfile": LoadFileScheduling,
        "loadgroup": LoadGroupScheduling,
    }
    known = by_dist.get(dist, LoadScopeScheduling)

    class ByProblem(known):  # type: ignore[misc,valid-type]
        def _split_scope(self, nodeid: str) -> str:
            if "::" not in nodeid and nodeid.count("/") == _SLASHES:
                return nodeid.rpartition("/")[0]
            return nodeid if dist in ("load", "worksteal") else str(super()._split_scope(nodeid))

    return ByProblem(config, log)
