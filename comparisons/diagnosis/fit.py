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

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from ...models.arrays import FloatArray
from ...models.errors import TrebucheckError
from ...models.kinematics import initial_state
from ...models.mechanism import Mechanism
from ...reference.equations import Equations
from ...reference.solution import Segment, Solution
from ..runs.results import RankedCause
from .case import PATIENCE, Case, fit, share_of
from .faults import Fault, gross_faults, hypotheses, once_a_mechanism
from .rank import EXACT

_STEP = 1e-6  # of a state, in parts of its size, for central differences
WINDOWS = (0.08, 0.3, 1.0)  # parts of the motion to which suspects are fitted to first order
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


# -------------------------------------------------------------------------------- first order


def first_order(solution: Solution, faulty: Sequence[Equations], t: FloatArray) -> FloatArray:
    """Change of the state (q, u) that each fault causes, shape (n_faulty, n_t, 2 n_q).

    Args:
        solution: the reference's, without impacts up to the last time.
        faulty: equations of mechanisms with a small fault; their starts count.
        t: ascending times [s], shape (n_t,).
    """
    start = np.concatenate(initial_state(solution.problem.mechanism))
    starts = [np.concatenate(initial_state(equations.mechanism)) for equations in faulty]
    s = np.stack([wrong - start for wrong in starts], axis=1)

    def forcing(segment: Segment, times: FloatArray, y: FloatArray) -> FloatArray:
        """Rates that each fault adds in the same state."""
        n = y.shape[1] // 2
        own = solution.equations.solve(y[:, :n], y[:, n:], segment.closed)[0]
        added = np.zeros((len(times), 2 * n, len(faulty)))
        for k, equations in enumerate(faulty):
            added[:, n:, k] = equations.solve(y[:, :n], y[:, n:], segment.closed)[0] - own
        return added

    return response(solution, s, forcing, t)


Forcing = Callable[[Segment, FloatArray, FloatArray], FloatArray]
"""Rates that are added in states y (n, 2 n_q) of a segment at times (n,); (n, 2 n_q, n_added)."""


def response(solution: Solution, s: FloatArray, forcing: Forcing, t: FloatArray) -> FloatArray:
    """Change of the state (q, u) by small rates that are added, shape (n_added, n_t, 2 n_q).

    Args:
        solution: the reference's, without impacts up to the last time.
        s: change at the start, shape (2 n_q, n_added).
        forcing: the rates.
        t: ascending times [s], shape (n_t,).
    """
    nodes, changes = [np.zeros(1)], [s[None]]
    for segment in solution.segments:
        if segment.start < t[-1]:
            ends, grown = _along(segment, solution.equations, forcing, t, s)
            nodes.append(ends)
            changes.append(grown)
            s = grown[-1]
    at_nodes = np.searchsorted(np.concatenate(nodes), t)
    return np.moveaxis(np.concatenate(changes)[at_nodes], 2, 0)


def _along(
    segment: Segment, right: Equations, forcing: Forcing, t: FloatArray, s: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Ends of m intervals of a segment [s], and the change there, shape (m, 2 n_q, n_added)."""
    end = min(segment.end, float(t[-1]))
    ends = [np.array([segment.start, end])]
    for inside in (t, segment.interpolant.ts):
        ends.append(inside[(inside > segment.start) & (inside < end)])
    nodes = np.unique(np.concatenate(ends))
    times = np.empty(2 * len(nodes) - 1)  # ends and middles of the intervals
    times[::2], times[1::2] = nodes, 0.5 * (nodes[1:] + nodes[:-1])
    y = np.asarray(segment.interpolant(times)).T
    n = y.shape[1] // 2

    def accelerations(y: FloatArray) -> FloatArray:
        return right.solve(y[:, :n], y[:, n:], segment.closed)[0]

    # d(u, a)/dy by central differences, shape (2 m + 1, 2 n_q, 2 n_q)
    size = np.concatenate([np.ones(n), np.full(n, np.abs(y[:, n:]).max() or 1.0)])
    jacobian = np.zeros((len(y), 2 * n, 2 * n))
    jacobian[:, :n, n:] = np.eye(n)
    for k, step in enumerate(_STEP * size):
        shift = np.zeros(2 * n)
        shift[k] = step
        ahead, behind = (accelerations(y + sign * shift) for sign in (1, -1))
        jacobian[:, n:, k] = (ahead - behind) / (2 * step)
    added = forcing(segment, times, y)
    grown: list[FloatArray] = []
    for m, h in enumerate(times[2::2] - times[:-2:2]):
        i = 2 * m
        k1 = jacobian[i] @ s + added[i]
        k2 = jacobian[i + 1] @ (s + 0.5 * h * k1) + added[i + 1]
        k3 = jacobian[i + 1] @ (s + 0.5 * h * k2) + added[i + 1]
        k4 = jacobian[i + 2] @ (s + h * k3) + added[i + 2]
        s = s + h / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
        grown.append(s)
    return nodes[1:], np.array(grown)


# -------------------------------------------------------------------------------------- fits


@dataclass(frozen=True)
class Fit:
    """A fault of a size, with the share of the deviation that it accounts for."""

    fault: Fault
    factors: FloatArray
    explained: float

    @property
    def cause(self) -> RankedCause:
        """The cause as reported."""
        return RankedCause(
            name=self.fault.name,
            kind=self.fault.kind,
            amount=self.fault.text(self.factors.tolist()),
            explained=self.explained,
        )


@dataclass(frozen=True)
class _Lead(Fit):
    """A fit to first order."""

    signatures: FloatArray
    """Signatures of its components, shape (n, m)."""
    reading: int
    """0: as an engine reads it that believes in the fault; 1: as others do."""


def better(one: Fit, other: Fit) -> Fit:
    """The better fit; a fault of two numbers has to leave much less than one of one number."""
    simple, general = sorted((one, other), key=lambda found: len(found.factors))
    if simple.explained >= EXACT:
        return simple
    left = 1 - simple.explained
    if len(general.factors) > len(simple.factors):
        left *= _PARSIMONY
    return general if 1 - general.explained < left else simple


def fitting_faults(case: Case) -> list[RankedCause]:
    """The faults that fit the deviation, each as large as it fits best."""
    signatures = _signatures(case)
    best: dict[str, Fit] = {}
    for part in WINDOWS:
        for lead in _leads(case, signatures, part):
            solved, group = _solved(case, lead, part), lead.fault.group
            if solved is not None:
                best[group] = better(best[group], solved) if group in best else solved
        if any(fitted.explained > EXACT for fitted in best.values()):
            break
    groups = dict.fromkeys(fault.group for fault, _ in signatures)
    return [best[group].cause for group in groups if group in best]


def _signatures(case: Case) -> list[tuple[Fault, FloatArray]]:
    """Pair each fault with its components' signatures by both readings, (2, n_components, m)."""
    small = _small_faults(case.mechanism)
    faulty = [equations for _, several in small for equations in several]
    rows: list[FloatArray] = []
    if case.has_impacts:
        # From the solved motion; zero where it has none.
        for equations in faulty:
            solution, row = case.solved(equations), np.zeros((2, len(case.deviation)))
            if solution is not None:
                row = np.array(case.seen(solution, solution.motion(case.t)))
            rows.append(row)
    else:
        n = case.motion.q.shape[1]
        changes = first_order(case.solution, faulty, case.t)
        for equations, change in zip(faulty, changes, strict=True):
            wrong = _with_equations(case, equations)
            q, u = case.motion.q + change[:, :n], case.motion.u + change[:, n:]
            rows.append(np.array(case.seen(wrong, wrong.motion_of(case.t, q, u))))
    left = iter(rows)
    return [
        (fault, np.array([next(left) for _ in several]).swapaxes(0, 1)) for fault, several in small
    ]


@once_a_mechanism
def _small_faults(mechanism: Mechanism) -> tuple[tuple[Fault, tuple[Equations, ...]], ...]:
    """Faults with their equations, of the small size of each component alone."""
    small: list[tuple[Fault, tuple[Equations, ...]]] = []
    for fault in hypotheses(mechanism):
        made = [fault.make(unit.tolist()) for unit in np.eye(len(fault.components))]
        equations = tuple(each for each in made if each is not None)
        if len(equations) == len(made):
            small.append((fault, equations))
    return tuple(small)


def _with_equations(case: Case, equations: Equations) -> Solution:
    """The reference's segments under other equations, to read states by."""
    changed = {"mechanism": equations.mechanism}
    problem = case.solution.problem.model_copy(update=changed)
    return case.solution.by_other_equations(problem, equations)


def _leads(
    case: Case, signatures: Sequence[tuple[Fault, FloatArray]], part: float
) -> Iterator[_Lead]:
    """The groups that fit the first part of the motion best, each by the best of its faults."""
    n, leads = first_part(case, part), list[_Lead]()
    for fault, readings in signatures:
        fits = [fit(case.deviation[:n], components[:, :n]) for components in readings]
        best = max(range(len(fits)), key=lambda k: fits[k][1])
        leads.append(_Lead(fault, *fits[best], readings[best], best))
    leads.sort(key=lambda lead: -lead.explained)
    groups: dict[str, list[_Lead]] = {}
    for lead in leads:
        groups.setdefault(lead.fault.group, []).append(lead)
    alike = {lead.fault.group for lead in leads if lead.explained > EXACT}
    for members in list(groups.values())[: min(max(_SOLVED, len(alike)), _ALIKE)]:
        worth = _WORTH_SOLVING * members[0].explained
        yield from (member for member in members if member.explained > worth)


def first_part(case: Case, part: float) -> int:
    """Tell how many values of a signature belong to the first part of the motion."""
    return max(1, round(part * len(case.t))) * (len(case.deviation) // len(case.t))


def _share(case: Case, signature: FloatArray, part: float) -> float:
    """Share of the deviation in the first part of the motion that a signature explains."""
    n = first_part(case, part)
    return share_of(case.deviation[:n], signature[:n])


def _solved(case: Case, lead: _Lead, part: float) -> Fit | None:
    """The fault of the size that fits best; None where no size can be solved.

    It is corrected by that part of the motion to which it was fitted, then by more of it: what is
    wrong by much may be of no use as a measure of a size at the end.
    """
    best: Fit | None = None
    factors, windows = lead.factors, [other for other in WINDOWS if other >= part]
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
            best = Fit(lead.fault, factors, share)
        while len(windows) > 1 and _share(case, signature, windows[0]) > EXACT:
            windows, before = windows[1:], 0.0
        here = _share(case, signature, windows[0])
        if share > EXACT or (before and here < before + _GAIN):
            break
        before = max(before, here)
        # One number is corrected by the secant through zero, several to first order.
        n = first_part(case, windows[0])
        if len(factors) == 1:
            factors = factors * fit(case.deviation[:n], signature[None, :n])[0]
        else:
            left = case.deviation[:n] - signature[:n]
            factors = factors + fit(left, lead.signatures[:, :n])[0]
    return best


def _measured(case: Case, lead: _Lead, factors: FloatArray, patience: int) -> FloatArray | None:
    """Signature of the motion with the fault of a size, read as the lead has it."""
    equations = lead.fault.equations(factors.tolist())
    solution = None if equations is None else case.solved(equations, patience)
    if solution is None:
        return None
    signature = case.seen(solution, solution.motion(case.t))[lead.reading]
    return signature if np.isfinite(signature).all() else None


def faults_at_the_same_motion(case: Case) -> Iterator[RankedCause]:
    """Faults that change forces or energies and no motion, as mistakes of reading do."""
    for fault in hypotheses(case.mechanism):
        units = np.eye(len(fault.components)).tolist()
        found = [_unmoved(case, fault.make(unit)) for unit in units]
        signatures = [signature for signature in found if signature is not None]
        if len(signatures) < len(found):
            continue
        for reading in range(2):
            factors, _ = fit(case.deviation, np.array([each[reading] for each in signatures]))
            if not factors.any():
                continue
            sized = _unmoved(case, fault.equations(factors.tolist()))
            if sized is not None:
                share = share_of(case.deviation, sized[reading])
                yield Fit(fault, factors, share).cause
    for fault in gross_faults(case.mechanism):
        found = _unmoved(case, fault.make(()))
        if found is not None:
            shares = [share_of(case.deviation, signature) for signature in found]
            yield RankedCause(name=fault.name, kind=fault.kind, explained=max(shares))


def _unmoved(case: Case, equations: Equations | None) -> FloatArray | None:
    """Read the reference's motion by other equations, in both ways; None if those move it."""
    if equations is None or equations.mechanism.start != case.mechanism.start:
        return None
    wrong = _with_equations(case, equations)
    try:
        motion = wrong.motion_of(case.t, case.motion.q, case.motion.u)
    except (TrebucheckError, np.linalg.LinAlgError, ValueError):
        return None
    moved = np.abs(motion.a - case.motion.a).max() > _STILL * np.abs(case.motion.a).max(initial=0.0)
    return None if moved else np.array(case.seen(wrong, motion))
