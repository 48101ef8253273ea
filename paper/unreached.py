"""The numbers of the paper that no solver can reach, and why: with them, every number in it is accounted for."""

from __future__ import annotations

from .results import Unreached

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
