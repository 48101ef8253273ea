"""Claims on the rolling machine against the fixed one, and on the computation's own error: Secs. VI and VII."""

from __future__ import annotations

import numpy as np

from ...models.machines.trebuchet import COUNTERWEIGHT
from ..evidence import Evidence, Row, Values
from ..printed import parse
from ..results import Quantity
from ..throws.headline import SIDEWAYS, SLANT
from ..verdicts import Cause, Judgement, as_printed, below, coincides, positive, vanishes

_FIXED, _ROLLING = "fixed", "rolling"
_R = {_FIXED: "1.42", _ROLLING: "1.83"}


def rows(evidence: Evidence) -> list[Row]:
    """All of them."""
    return [*_ratios(), *_why_better(), *_paths(evidence), *_peaks(evidence), *_errors(evidence)]


def _ratios() -> list[Row]:
    return [
        Row(
            f"R, {name}",
            "Sec. VI, Fig. 7",
            _R[name],
            "projectile's kinetic over the total energy at 45 deg",
            "",
            lambda f, name=name: f[f"{name}: energy_ratio, launch"],
            lambda q, name=name: as_printed(q, _R[name]),
            name,
        )
        for name in (_FIXED, _ROLLING)
    ] + [
        Row(
            "kinetic energy, rolling to fixed",
            "Sec. VI",
            "1.3",
            "ratio of the projectiles' kinetic energies at 45 deg",
            "",
            lambda f: f["rolling: energy_ratio, launch"] / f["fixed: energy_ratio, launch"],
            lambda q: as_printed(q, "1.3"),
        ),
        Row(
            "speed, rolling less fixed",
            "Sec. VI",
            "13 m/s",
            "difference of the launch speeds",
            "m/s",
            lambda f: f["rolling: launch_speed"] - f["fixed: launch_speed"],
            lambda q: as_printed(q, "13"),
        ),
        Row(
            "same total energy",
            "Sec. VI",
            "equal",
            "total energy at the start, rolling less fixed",
            "J",
            lambda f: f["rolling: total_energy, start"] - f["fixed: total_energy, start"],
            lambda q: vanishes(q, 0.0, "the same start, at rest"),
        ),
        Row(
            "R beyond 1 is physical",
            "Sec. VI",
            "U < 0",
            "potential energy at the launch",
            "J",
            lambda f: f["fixed: potential_energy, launch"],
            lambda q: positive(
                Quantity(value=-q.value, uncertainty=q.uncertainty, unit=q.unit), "minus the potential energy"
            ),
            _FIXED,
        ),
    ]


def _why_better() -> list[Row]:
    return [
        Row(
            "wheels increase the range",
            "Secs. I, VI",
            "> 0",
            "longest range, rolling less fixed",
            "m",
            lambda f: f["rolling: best_range, longest range"] - f["fixed: best_range, longest range"],
            lambda q: positive(q, "the gain"),
        ),
        Row(
            "less energy left in the counterweight",
            "Sec. VI",
            "> 0",
            "counterweight's kinetic energy at the launch, fixed less rolling",
            "J",
            lambda f: (
                f["fixed: kinetic_energy (counterweight), launch"]
                - f["rolling: kinetic_energy (counterweight), launch"]
            ),
            lambda q: positive(q, "what the rolling machine wastes less"),
        ),
        Row(
            "machine moves forward at the launch",
            "Sec. VI",
            "> 0",
            "speed of the pivot at the launch",
            "m/s",
            lambda f: f["rolling: pivot_speed, launch"],
            lambda q: positive(q, "the speed, forwards,"),
            _ROLLING,
        ),
    ]


def _paths(evidence: Evidence) -> list[Row]:
    def apart(f: Values) -> float:
        name = "position_x_max (counterweight), before launch"
        return f[f"fixed: {name}"] - f[f"rolling: {name}"]

    return [
        Row(
            "counterweight swings out further",
            "Sec. VI, Fig. 6",
            "3.3 m",
            "rightmost x of the counterweight, fixed less rolling",
            "m",
            apart,
            lambda q: as_printed(q, "3.3"),
        ),
        Row(
            "counterweight's additional way, there and back",
            "Sec. VI",
            "6.6 m",
            "twice how much further it swings out",
            "m",
            lambda f: 2 * apart(f),
            lambda q: as_printed(q, "6.6"),
        ),
        Row(
            "counterweight's additional way, up to the launch",
            "Sec. VI",
            "6.6 m",
            "all it has travelled sideways when the velocity is at 45 deg, fixed less rolling",
            "m",
            lambda f: f[f"fixed: {SIDEWAYS}"] - f[f"rolling: {SIDEWAYS}"],
            lambda q: as_printed(q, "6.6", causes=[_not_back(evidence)]),
        ),
        Row(
            "counterweight falls straighter on wheels",
            "Sec. VI, Fig. 6",
            "> 0",
            "how far it swings out per metre it has fallen by the launch, fixed less rolling",
            "",
            lambda f: f[f"fixed: {SLANT}"] - f[f"rolling: {SLANT}"],
            lambda q: positive(q, "the difference"),
        ),
    ]


def _not_back(evidence: Evidence) -> Cause:
    throw = evidence.throws[_FIXED]
    x = float(throw.at(np.array([throw.launch_time])).marker(COUNTERWEIGHT).position[0, 0])
    start = float(throw.trajectory.marker(COUNTERWEIGHT).position[0, 0])
    furthest = throw.figures["position_x_max (counterweight), before launch"]
    return Cause(
        furthest - x < furthest - start,
        f"by then the fixed machine's counterweight has come back {furthest - x:.3g} m of the "
        f"{furthest - start:.3g} m it swung out",
    )


def _peaks(evidence: Evidence) -> list[Row]:
    half = parse(_R[_FIXED]).half

    def missed(name: str) -> Row:
        return Row(
            f"R at 45 deg is the largest, {name}",
            "Secs. VI, VII, Fig. 7a",
            "same instant",
            "largest R less R at 45 deg",
            "",
            lambda f: f[f"{name}: largest_ratio, fastest"] - f[f"{name}: energy_ratio, launch"],
            lambda q: coincides(q, half, "half a unit of the last digit R is printed to", [_later(evidence, name)]),
            name,
        )

    return [
        missed(_FIXED),
        Row(
            "R peaks after 45 deg, rolling",
            "Sec. VI, Fig. 7b",
            "> 0",
            "largest R less R at 45 deg, beyond what the print can tell",
            "",
            lambda f: f["rolling: largest_ratio, fastest"] - f["rolling: energy_ratio, launch"],
            lambda q: positive(_beyond(q, half), "the excess over half a unit of the last digit of R"),
            _ROLLING,
        ),
        Row(
            "fastest after 45 deg, rolling",
            "Sec. VI, Fig. 7b",
            "> 0",
            "time of the largest speed less that of 45 deg",
            "s",
            lambda f: f["rolling: largest_ratio_time, fastest"] - f["rolling: launch_time"],
            lambda q: positive(q, "the delay"),
            _ROLLING,
        ),
        Row(
            "45 deg is not the rolling machine's best",
            "Sec. VI",
            "> 0",
            "longest range less that at 45 deg",
            "m",
            lambda f: f["rolling: range gain, longest range"],
            lambda q: positive(q, "the gain"),
            _ROLLING,
        ),
    ]


def _later(evidence: Evidence, name: str) -> Cause:
    ours = evidence.ours
    later = ours[f"{name}: largest_ratio_time, fastest"] - ours[f"{name}: launch_time"]
    return Cause(later > 0, f"R peaks {later:.3g} s after 45 deg")


def _beyond(q: Quantity, half: float) -> Quantity:
    return Quantity(value=q.value - half, uncertainty=q.uncertainty, unit=q.unit)


def _errors(evidence: Evidence) -> list[Row]:
    def judge_share(q: Quantity) -> Judgement:
        return below(q, "0.0005")

    found: list[Row] = []
    for name in evidence.throws:
        found += [
            Row(
                f"energy's deviation, {name}",
                "Sec. VII",
                "< 1 J",
                "largest change of the total energy up to the launch",
                "J",
                lambda f, name=name: f[f"{name}: energy drift"],
                lambda q: below(q, "1"),
                name,
            ),
            Row(
                f"energy's deviation in percent, {name}",
                "Sec. VII",
                "< 0.0005 %",
                "the same, of the total energy",
                "%",
                lambda f, name=name: 100 * f[f"{name}: energy drift, share"],
                judge_share,
                name,
            ),
        ]
    return [
        *found,
        Row(
            "1 J in percent",
            "Sec. VII",
            "0.0005 %",
            "1 J as a share of the total energy",
            "%",
            lambda f: 100 / abs(f["fixed: total_energy, start"]),
            lambda q: as_printed(q, "0.0005"),
        ),
    ]
