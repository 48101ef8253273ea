"""All claims, judged: each group of rows by what it needs; a study that failed leaves its rows open."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable
from typing import Any

from .evidence.results import Claim, Unreached
from .evidence.verdicts import Evidence, Row, undecided
from .rows import fitted, machine, machines, release, rolling, sweep, torques

THROWS = (machine, torques, release, rolling)
"""Modules of the rows on the two machines and their throws."""
_SECTIONS: dict[str, tuple[str, Callable[[Any, Evidence], Iterable[Row]]]] = {
    "drag": ("Table II", fitted.drag_rows),
    "sweep": ("Sec. V, Fig. 5", sweep.rows),
    "design": ("Sec. VI", lambda found, _: machines.design_rows(found)),
    "identification": ("Sec. II", lambda found, _: fitted.start_rows(found)),
    "machines": ("Secs. I, VI", lambda found, _: machines.efficiency_rows(found)),
}
"""Of each further study: its place in the paper, and its rows."""

_INPUT = "what the machine is made of: the solvers start from it"
UNREACHED = (
    Unreached(where="Table I", printed="l1 10, l2 4, h 10, r 6 m; m_a 1000, m_b 60, m_cw 3000 kg", why=_INPUT),
    Unreached(where="Table I", printed="g 9.81 m/s²", why="a fact of nature, given to the solvers"),
    Unreached(
        where="Table II",
        printed="g 1.62, 3.71, 9.81, 8.87 m/s²; ρ 0, 0.02, 1.2, 65",
        why="facts of other worlds, given to the solvers; the unit of ρ, printed m/kg³, is taken as kg/m³",
    ),
    Unreached(
        where="Sec. V",
        printed="3 to 5",
        why="of a machine in another publication; the row on it says what is missing",
    ),
    Unreached(
        where="Figs. 2 to 7",
        printed="axes and curves",
        why="pictures without a table: only what text and captions say of them can be held against ours",
    ),
    Unreached(where="Eqs. (1), (6), (7), (11)", printed="λ, γ, G1, G2, R", why="definitions, which are followed here"),
)
"""The numbers of the paper that no solver can reach, and why: with them, every number in it is accounted for."""


def claims(evidence: Evidence) -> tuple[Claim, ...]:
    """Every claim of the paper that a solver can reach, in the order of the paper."""
    found = [row.claim(evidence) for group in THROWS for row in group.rows(evidence)]
    for name in _SECTIONS:
        found += _of_section(name, evidence)
    return tuple(sorted(found, key=lambda claim: order(claim.where)))


def _of_section(name: str, evidence: Evidence) -> list[Claim]:
    (where, rows), why = _SECTIONS[name], evidence.failures.get(name)
    if name in evidence.sections:
        try:
            return [row.claim(evidence) for row in rows(evidence.sections[name], evidence)]
        except Exception as error:  # rows of other studies must not be lost with these
            why = f"{type(error).__name__}: {error}"
    if why is None:
        return []  # the study was not wanted
    quantity, failed = f"everything that the study '{name}' computes", undecided(f"its computation failed: {why}")
    return [Row(f"all of {name}", where, "", quantity, None, failed).claim(evidence)]


_PLACES = ("I", "Eq", "II", "III", "IV", "Fig", "Table", "V", "VI", "VII")
_PLACE = re.compile(r"Secs?\. ([IV]+)|(Eq|Fig|Table)")


def order(where: str) -> int:
    """Place in the paper: of the first section, equation, figure or table named."""
    found = _PLACE.match(where)
    return len(_PLACES) if found is None else _PLACES.index(found[1] or found[2])
