r"""Faults of mechanisms and forces that fit a deviation.

First all of them are fitted to first order, to the first part of the motion, to more of it, and to
all of it: what is wrong by much is still small at first. Then those that fit best are solved with
the size found, which is corrected until it fits. Only what has been solved is reported, with the
share of the deviation that it then explains.

First order is that of the variational equations along the reference motion. With y = (q, u) and the
accelerations a(y) under the stops that are closed, a fault of size e moves the state by e s(t):

    s' = da/dy s + (a_fault - a) / e,        s(0) = (start_fault - start) / e.

A stop opens where its torque is zero, so that the accelerations have no jump there, and neither has
s: a shift of the release is of second order. Impacts have a jump of s; motions with impacts are
solved anew instead. All faults are integrated together, by the classical Runge-Kutta method on the
times asked for, the events, and the steps of the reference's own integrator, which are fine where
the motion is fast.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from ...models.arrays import FloatArray
from ...models.errors import TrebucheckError
from ...models.kinematics import initial_state
from ...models.mechanism import Mechanism
from ...models.problem import Problem
from ...reference.equations import Equations
from ...reference.solution import MotionSamples, Segment, Solution
from ..runs.results import RankedCause
from .case import PATIENCE, Case, fit, match
from .faults import Hypothesis, gross_faults, hypotheses, once_a_mechanism
from .rank import EXACT

_STEP = 1e-6  # of a state, in parts of its size, for central differences


@dataclass(frozen=True)
class _Path:
    """The reference in one segment, at the ends and the middles of its m intervals."""

    times: FloatArray
    y: FloatArray
    closed: tuple[str, ...]


def first_order(solution: Solution, faulty: Sequence[Equations], t: FloatArray) -> FloatArray:
    """Change of the state (q, u) that each fault causes, shape (n_faulty, n_t, 2 n_q).

    Args:
        solution: the reference's, without impacts up to the last time.
        faulty: equations of mechanisms with a small fault; their starts count.
        t: ascending times [s], shape (n_t,).
    """
    start = np.concatenate(initial_state(solution.problem.mechanism))
    s = np.stack(
        [np.concatenate(initial_state(equations.mechanism)) - start for equations in faulty], axis=1
    )
    times, states = [np.zeros(1)], [s[None]]
    for path in _paths(solution, t):
        grown = _integrated(solution.equations, faulty, path, s)
        times.append(path.times[2::2])
        states.append(grown)
        s = grown[-1]
    nodes, grown = np.concatenate(times), np.concatenate(states)
    return np.moveaxis(grown[np.searchsorted(nodes, t)], 2, 0)


def _paths(solution: Solution, t: FloatArray) -> list[_Path]:
    return [_path(segment, t) for segment in solution.segments if segment.start < t[-1]]


def _path(segment: Segment, t: FloatArray) -> _Path:
    end = min(segment.end, float(t[-1]))
    inside = [
        values[(values > segment.start) & (values < end)] for values in (t, segment.interpolant.ts)
    ]
    nodes = np.unique(np.concatenate([[segment.start, end], *inside]))
    times = np.empty(2 * len(nodes) - 1)
    times[::2], times[1::2] = nodes, 0.5 * (nodes[1:] + nodes[:-1])
    return _Path(times, np.asarray(segment.interpolant(times)).T, segment.closed)


def _integrated(
    right: Equations, faulty: Sequence[Equations], path: _Path, s: FloatArray
) -> FloatArray:
    """The change at the end of each interval, shape (m, 2 n_q, n_faulty), from that at first."""
    jacobian, forcing = _jacobian(right, path), _forcing(right, faulty, path)
    results: list[FloatArray] = []
    for i, h in zip(
        range(0, len(path.times) - 2, 2), path.times[2::2] - path.times[:-2:2], strict=True
    ):
        k1 = jacobian[i] @ s + forcing[i]
        k2 = jacobian[i + 1] @ (s + 0.5 * h * k1) + forcing[i + 1]
        k3 = jacobian[i + 1] @ (s + 0.5 * h * k2) + forcing[i + 1]
        k4 = jacobian[i + 2] @ (s + h * k3) + forcing[i + 2]
        s = s + h / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
        results.append(s)
    return np.array(results)


def _accelerations(equations: Equations, y: FloatArray, closed: tuple[str, ...]) -> FloatArray:
    n = y.shape[-1] // 2
    return equations.solve(y[..., :n], y[..., n:], closed)[0]


def _jacobian(right: Equations, path: _Path) -> FloatArray:
    """D(u, a)/dy, shape (2 m + 1, 2 n_q, 2 n_q), by central differences."""
    n = path.y.shape[1] // 2
    size = np.concatenate([np.ones(n), np.full(n, np.abs(path.y[:, n:]).max() or 1.0)])
    jacobian = np.zeros((len(path.y), 2 * n, 2 * n))
    jacobian[:, :n, n:] = np.eye(n)
    for k, step in enumerate(_STEP * size):
        shift = np.zeros(2 * n)
        shift[k] = step
        ahead, behind = (
            _accelerations(right, path.y + sign * shift, path.closed) for sign in (1, -1)
        )
        jacobian[:, n:, k] = (ahead - behind) / (2 * step)
    return jacobian


def _forcing(right: Equations, faulty: Sequence[Equations], path: _Path) -> FloatArray:
    """Rates that each fault adds in the same state, shape (2 m + 1, 2 n_q, n_faulty)."""
    n = path.y.shape[1] // 2
    own = _accelerations(right, path.y, path.closed)
    forcing = np.zeros((len(path.y), 2 * n, len(faulty)))
    for k, equations in enumerate(faulty):
        forcing[:, n:, k] = _accelerations(equations, path.y, path.closed) - own
    return forcing


_WINDOWS = (0.08, 0.3, 1.0)  # parts of the motion to which suspects are fitted to first order
_SOLVED = 3  # suspects of each window that are then solved
_ALIKE = 6  # that are, where so many account for all of it
_CORRECTIONS = 6
_WORTH_SOLVING = 0.98  # of the best share in its group: of a member of it
_HOPELESS = 0.5  # share to first order, below which a size is not corrected
_IMPATIENCE = 3  # times the reference's steps: what fits badly is not solved where it is stiff
_GAIN = 0.003  # in share: corrections that gain less are at an end
_STILL = 1e-10  # of the accelerations: rounding
# A fault of two numbers must leave less than this part of what one of them alone leaves
_PARSIMONY = 0.5


@dataclass(frozen=True)
class _Lead:
    """A hypothesis, as fitted to first order."""

    hypothesis: Hypothesis
    signatures: FloatArray
    """Signatures of its components, shape (n, m)."""
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
    def cause(self) -> RankedCause:
        """The cause as reported."""
        text = self.hypothesis.text(self.factors.tolist())
        return RankedCause(
            name=self.hypothesis.name,
            kind=self.hypothesis.kind,
            amount=text,
            explained=self.explained,
        )


def fitting_faults(case: Case) -> list[RankedCause]:
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


def faults_at_the_same_motion(case: Case) -> Iterator[RankedCause]:
    """Faults that change forces or energies and no motion, as mistakes of reading do."""
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
            yield RankedCause(name=name, kind="law", explained=max(shares))


def _unmoved(case: Case, equations: Equations | None) -> FloatArray | None:
    """Both readings of the reference's motion by other equations; None if those move it."""
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
    """The better fit; a fault of two numbers has to leave much less than one of one number."""
    simple, general = sorted((one, other), key=lambda found: len(found.factors))
    if simple.explained >= EXACT:
        return simple
    left = 1 - simple.explained
    if len(general.factors) > len(simple.factors):
        left *= _PARSIMONY
    return general if 1 - general.explained < left else simple


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
    """The lead fitted to the first part of the motion, by the reading that fits better."""
    n = _first(case, part)
    fits = [fit(case.deviation[:n], signatures[:, :n]) for signatures in readings]
    best = max(range(len(fits)), key=lambda k: fits[k][1])
    return _Lead(hypothesis, readings[best], best, *fits[best])


def _signatures(case: Case) -> list[tuple[Hypothesis, FloatArray]]:
    """Each hypothesis with the signatures of its components by both readings.

    These are of shape (2, n_components, m).
    """
    small = _small_faults(case.mechanism)
    rows = iter(_responses(case, [each for _, equations in small for each in equations]))
    return [
        (hypothesis, np.array([next(rows) for _ in equations]).swapaxes(0, 1))
        for hypothesis, equations in small
    ]


@once_a_mechanism
def _small_faults(mechanism: Mechanism) -> tuple[tuple[Hypothesis, tuple[Equations, ...]], ...]:
    """Hypotheses with their equations, of the small size of each component alone."""
    found: list[tuple[Hypothesis, tuple[Equations, ...]]] = []
    for hypothesis in hypotheses(mechanism):
        made = [hypothesis.make(unit.tolist()) for unit in np.eye(len(hypothesis.components))]
        equations = tuple(each for each in made if each is not None)
        if len(equations) == len(made):
            found.append((hypothesis, equations))
    return tuple(found)


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
    """The same from the solved motion, for motions with impacts; zero where it has none."""
    solution = case.solved(equations)
    if solution is None:
        return np.zeros((2, len(case.deviation)))
    return np.array(case.seen(solution, solution.motion(case.t)))


def _solved(case: Case, lead: _Lead, part: float) -> Found | None:
    """The hypothesis of the size that fits best; None where no size can be solved.

    It is corrected by that part of the motion to which it was fitted, then by more of it: what is
    wrong by much may be of no use as a measure of a size at the end.
    """
    best: Found | None = None
    factors, windows = lead.factors, [other for other in _WINDOWS if other >= part]
    corrections, patience = _CORRECTIONS, PATIENCE
    if lead.explained <= _HOPELESS:
        corrections, patience = 1, _IMPATIENCE
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
    """Share of the deviation in the first part of the motion that a signature explains."""
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
    motion: MotionSamples = solution.motion(case.t)
    signature = case.seen(solution, motion)[lead.reading]
    return signature if np.isfinite(signature).all() else None


def _corrected(
    case: Case, lead: _Lead, factors: FloatArray, signature: FloatArray, part: float
) -> FloatArray:
    """The corrected size: one number by the secant through zero, several to first order."""
    n = _first(case, part)
    if len(factors) == 1:
        return factors * fit(case.deviation[:n], signature[None, :n])[0]
    return factors + fit(case.deviation[:n] - signature[:n], lead.signatures[:, :n])[0]
