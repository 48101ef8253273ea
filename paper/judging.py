"""All claims, judged: each group of rows by what it needs; a study that failed leaves its rows open."""

from __future__ import annotations

import re
from collections.abc import Callable
from typing import Any

from .evidence import Evidence, made
from .results import Claim
from .rows import design as rows_design
from .rows import drag as rows_drag
from .rows import equations as rows_equations
from .rows import identification as rows_identification
from .rows import machine as rows_machine
from .rows import machines as rows_machines
from .rows import release as rows_release
from .rows import rolling as rows_rolling
from .rows import sweep as rows_sweep
from .rows import torques
from .verdicts import not_told

_OF_SECTIONS: dict[str, Callable[[Any, Evidence], list[Claim]]] = {
    "drag": rows_drag.claims,
    "sweep": rows_sweep.claims,
    "design": lambda found, _: rows_design.claims(found),
    "identification": lambda found, _: rows_identification.claims(found),
    "machines": lambda found, _: rows_machines.claims(found),
}
_WHERE = {"drag": "Table II", "sweep": "Sec. V, Fig. 5", "design": "Sec. VI", "identification": "Sec. II",
          "machines": "Secs. I, VI"}  # fmt: skip


def claims(evidence: Evidence) -> tuple[Claim, ...]:
    """Every claim of the paper that a solver can reach, in the order of the paper."""
    rows = [row for group in (torques, rows_release, rows_rolling) for row in group.rows(evidence)]
    found = [*rows_machine.claims(evidence), *rows_equations.claims(evidence), *(row.claim(evidence) for row in rows)]
    for name in _OF_SECTIONS:
        found += _of_section(name, evidence)
    return tuple(sorted(found, key=lambda claim: _order(claim.where)))


def _of_section(name: str, evidence: Evidence) -> list[Claim]:
    why = evidence.failures.get(name)
    if name in evidence.sections:
        try:
            return _OF_SECTIONS[name](evidence.sections[name], evidence)
        except Exception as error:  # rows of other studies must not be lost with these
            why = f"{type(error).__name__}: {error}"
    if why is None:
        return []  # it was not asked for
    return [
        made(
            f"all of {name}",
            _WHERE[name],
            "",
            f"everything that the study '{name}' computes",
            None,
            not_told(f"its computation failed: {why}"),
        )
    ]


_PLACES = ("I", "Eq", "II", "III", "IV", "Fig", "Table", "V", "VI", "VII")
_PLACE = re.compile(r"Secs?\. ([IV]+)|(Eq|Fig|Table)")


def _order(where: str) -> int:
    """Place in the paper: of the first section, equation, figure or table named."""
    found = _PLACE.match(where)
    return len(_PLACES) if found is None else _PLACES.index(found[1] or found[2])
