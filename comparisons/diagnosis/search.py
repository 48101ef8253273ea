"""The faults of mechanisms and forces that fit a deviation, each measured by solving the equations with it.

First all of them are fitted to first order, to the first part of the motion, to more of it, and to
all of it: what is wrong by much is still small at first. Then those that fit best are solved with
the size found, which is corrected until it fits. Only what has been solved is reported, with the
share of the deviation that is then accounted for.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from ...models.arrays import FloatArray
from ...models.errors import TrebucheckError
from ...models.problem import Problem
from ...reference.equations import Equations
from ...reference.solution import Motion
from ..runs.results import Cause
from .case import PATIENCE, Case
from .hypotheses import Hypothesis, gross_faults, hypotheses
from .ranking import EXACT
from .response import first_order
from .signatures import fit, match

_WINDOWS = (0.08, 0.3, 1.0)  # parts of the motion to which suspects are fitted to first order
_SOLVED = 3  # suspects of each window that are then solved
_ALIKE = 6  # that are, where so many account for all of it
_CORRECTIONS = 6
_WORTH_SOLVING = 0.98  # of the best share in its group: of a member of it
_HOPELESS = 0.5  # share to first order, below which a size is not corrected
_IMPATIENCE = 3  # times the reference's steps: what fits so badly to first order is not solved where it is stiff
_GAIN = 0.003  # in share: corrections that gain less are at an end
_STILL = 1e-10  # of the accelerations: rounding
_PARSIMONY = (
    0.5  # a fault of two numbers must leave less than this part of what one of them alone leaves
)


@dataclass(frozen=True)
class _Lead:
    """A hypothesis, as fitted to first order."""

    hypothesis: Hypothesis
    signatures: FloatArray
    """Of its components, shape (n, m)."""
    reading: int
    """0: as an engine reads it that believes in the fault; 1: as others do."""
    factors: FloatArray
    explained: float


@dataclass(frozen=True)
class Found:
    """A hypothesis of a size, with the share of the deviation that its motion accounts for."""

    hypothesis: Hypothesis
    factors: FloatArray
    explained: float

    @property
    def cause(self) -> Cause:
        """As reported."""
        text = self.hypothesis.text(self.factors.tolist())
        return Cause(
            name=self.hypothesis.name,
            kind=self.hypothesis.kind,
            amount=text,
            explained=self.explained,
        )


def fitting_faults(case: Case) -> list[Cause]:
    """The faults that fit the deviation, each as large as it fits best."""
    every = _signatures(case)
    found: dict[str, Found] = {}
    for part in _WINDOWS:
        for lead in _leads(case, every, part):
            result, group = _solved(case, lead, part), lead.hypothesis.group
            if result is not None:
                found[group] = better(found[group], result) if group in found else result
        if any(each.explained > EXACT for each in found.values()):
            break
    order = list(dict.fromkeys(hypothesis.group for hypothesis, _ in every))
    return [found[group].cause for group in order if group in found]


def faults_at_the_same_motion(case: Case) -> Iterator[Cause]:
    """Faults that change forces or energies and no acceleration: no motion tells them from a mistake of reading."""
    for hypothesis in hypotheses(case.mechanism):
        units = np.eye(len(hypothesis.components)).tolist()
        found = [_unmoved(case, hypothesis.make(unit)) for unit in units]
        signatures = [signature for signature in found if signature is not None]
        if len(signatures) < len(found):
            continue
        for reading in range(2):
            factors, _ = fit(case.deviation, np.array([each[reading] for each in signatures]))
            sized = (
                _unmoved(case, hypothesis.equations(factors.tolist())) if factors.any() else None
            )
            if sized is not None:
                share = match(case.deviation, sized[reading], fixed=True).explained
                yield Found(hypothesis, factors, share).cause
    for name, equations in gross_faults(case.mechanism):
        found = _unmoved(case, equations)
        if found is not None:
            shares = [match(case.deviation, signature, fixed=True).explained for signature in found]
            yield Cause(name=name, kind="law", explained=max(shares))


def _unmoved(case: Case, equations: Equations | None) -> FloatArray | None:
    """Both readings of the reference's own motion by other equations; None if those would not move it so."""
    if equations is None or equations.mechanism.start != case.mechanism.start:
        return None
    wrong = replace(case.solution, problem=_problem(case, equations), equations=equations)
    try:
        motion = wrong.motion_of(case.t, case.motion.q, case.motion.u)
    except (TrebucheckError, np.linalg.LinAlgError, ValueError):
        return None
    moved = np.abs(motion.a - case.motion.a).max() > _STILL * np.abs(case.motion.a).max(initial=0.0)
    return None if moved else np.array(case.seen(wrong, motion))


def better(one: Found, other: Found) -> Found:
    """That which leaves less; two numbers have to leave much less than one."""
    simple, general = sorted((one, other), key=lambda found: len(found.factors))
    allowance = _PARSIMONY if len(simple.factors) < len(general.factors) else 1.0
    left = max(1 - simple.explained, 1 - EXACT) if allowance < 1 else 1 - simple.explained
    return (
        general if 1 - general.explained < allowance * left and simple.explained < EXACT else simple
    )


def _leads(
    case: Case, every: Sequence[tuple[Hypothesis, FloatArray]], part: float
) -> Iterator[_Lead]:
    """The groups that fit the first part of the motion best, each by the best of its hypotheses."""
    fitted = sorted((_fitted(case, h, s, part) for h, s in every), key=lambda lead: -lead.explained)
    groups = dict.fromkeys(lead.hypothesis.group for lead in fitted)
    alike = dict.fromkeys(lead.hypothesis.group for lead in fitted if lead.explained > EXACT)
    for group in list(groups)[: min(max(_SOLVED, len(alike)), _ALIKE)]:
        members = [lead for lead in fitted if lead.hypothesis.group == group]
        yield from (m for m in members if m.explained > _WORTH_SOLVING * members[0].explained)


def _fitted(case: Case, hypothesis: Hypothesis, readings: FloatArray, part: float) -> _Lead:
    """To the first part of the motion, by whichever reading fits better."""
    n = _first(case, part)
    fits = [fit(case.deviation[:n], signatures[:, :n]) for signatures in readings]
    best = max(range(len(fits)), key=lambda k: fits[k][1])
    return _Lead(hypothesis, readings[best], best, *fits[best])


def _signatures(case: Case) -> list[tuple[Hypothesis, FloatArray]]:
    """Each hypothesis with the signatures of its components by both readings, shape (2, n_components, m)."""
    kept: list[tuple[Hypothesis, list[Equations]]] = []
    for hypothesis in hypotheses(case.mechanism):
        units = np.eye(len(hypothesis.components))
        equations = [hypothesis.make(unit.tolist()) for unit in units]
        if all(each is not None for each in equations):
            kept.append((hypothesis, [each for each in equations if each is not None]))
    rows = iter(_responses(case, [each for _, equations in kept for each in equations]))
    return [
        (hypothesis, np.array([next(rows) for _ in equations]).swapaxes(0, 1))
        for hypothesis, equations in kept
    ]


def _responses(case: Case, faulty: Sequence[Equations]) -> Iterator[FloatArray]:
    """The signatures of small faults by both readings, each of shape (2, m)."""
    if case.has_impacts:
        yield from (_solved_response(case, equations) for equations in faulty)
        return
    n = case.motion.q.shape[1]
    for equations, change in zip(faulty, first_order(case.solution, faulty, case.t), strict=True):
        wrong = replace(case.solution, problem=_problem(case, equations), equations=equations)
        motion = wrong.motion_of(
            case.t, case.motion.q + change[:, :n], case.motion.u + change[:, n:]
        )
        yield np.array(case.seen(wrong, motion))


def _problem(case: Case, equations: Equations) -> Problem:
    return case.solution.problem.model_copy(update={"mechanism": equations.mechanism})


def _solved_response(case: Case, equations: Equations) -> FloatArray:
    """The same from the solved motion, for motions with impacts; nothing where it cannot be solved."""
    solution = case.solved(equations)
    if solution is None:
        return np.zeros((2, len(case.deviation)))
    return np.array(case.seen(solution, solution.motion(case.t)))


def _solved(case: Case, lead: _Lead, part: float) -> Found | None:
    """The hypothesis as large as it fits best, by solving and correcting; None where no size can be solved.

    It is corrected by that part of the motion to which it was fitted, then by more of it: what is
    wrong by much may be of no use as a measure of a size at the end.
    """
    best: Found | None = None
    factors, windows = lead.factors, [other for other in _WINDOWS if other >= part]
    corrections, patience = (
        (_CORRECTIONS, PATIENCE) if lead.explained > _HOPELESS else (1, _IMPATIENCE)
    )
    before = 0.0
    for _ in range(corrections):
        signature = _measured(case, lead, factors, patience)
        if signature is None:
            if best is not None:
                break
            factors = 0.5 * factors  # the size makes no sense: perhaps half of it does
            continue
        share = _share(case, signature, 1.0)
        if best is None or share > best.explained:
            best = Found(lead.hypothesis, factors, share)
        while len(windows) > 1 and _share(case, signature, windows[0]) > EXACT:
            windows, before = windows[1:], 0.0
        here = _share(case, signature, windows[0])
        if share > EXACT or (before and here < before + _GAIN):
            break
        before = max(before, here)
        factors = _corrected(case, lead, factors, signature, windows[0])
    return best


def _share(case: Case, signature: FloatArray, part: float) -> float:
    """Of the deviation in the first part of the motion, that a signature accounts for."""
    n = _first(case, part)
    return match(case.deviation[:n], signature[:n], fixed=True).explained


def _first(case: Case, part: float) -> int:
    """How many values of a signature belong to the first part of the motion."""
    return max(1, round(part * len(case.t))) * (len(case.deviation) // len(case.t))


def _measured(case: Case, lead: _Lead, factors: FloatArray, patience: int) -> FloatArray | None:
    """Signature of the motion with the fault of a size, read as the lead has it."""
    equations = lead.hypothesis.equations(factors.tolist())
    solution = None if equations is None else case.solved(equations, patience)
    if solution is None:
        return None
    motion: Motion = solution.motion(case.t)
    signature = case.seen(solution, motion)[lead.reading]
    return signature if np.isfinite(signature).all() else None


def _corrected(
    case: Case, lead: _Lead, factors: FloatArray, signature: FloatArray, part: float
) -> FloatArray:
    """The size corrected: of one number by the secant through zero, of several by the first-order signatures."""
    n = _first(case, part)
    if len(factors) == 1:
        return factors * fit(case.deviation[:n], signature[None, :n])[0]
    return factors + fit(case.deviation[:n] - signature[:n], lead.signatures[:, :n])[0]
