"""Balance of energy, T + V - W: W is the work of dampers, constant forces and torques.

Between impacts it is constant, whatever acts. W is the time integral of the power of these
elements: over an engine's own samples by Simpson's rule, from impact to impact, as the power jumps
there; over the reference by Gauss's rule on its dense output, to rounding.
"""

from __future__ import annotations

from itertools import pairwise

import numpy as np
from scipy.integrate import cumulative_simpson, cumulative_trapezoid

from ...models.applied_forces import AppliedForces
from ...models.arrays import FloatArray
from ...models.elements import GROUND, refuse_unknown
from ...models.mechanism import Mechanism
from ...models.trajectory import Trajectory
from ...reference.solution import Segment, Solution

# Exact to order 9; a step's dense output is of order 7
_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(5)


def does_work(mechanism: Mechanism) -> bool:
    """Tell whether a damper, a constant force or a constant torque may change the energy."""
    refuse_unknown("The balance of energy", mechanism.force_elements)
    return any(element.works for element in mechanism.force_elements)


def keeps_horizontal_momentum(mechanism: Mechanism) -> bool:
    """Tell whether the momentum along x is an invariant: no joint, wall or force acts along it."""
    grounded = (joint for joint in mechanism.joints if joint.parent == GROUND)
    along = [direction.real for joint in grounded for direction in joint.held_directions]
    along += [stop.normal[0] for stop in mechanism.point_stops if stop.relative_to == GROUND]
    along.append(mechanism.gravity_vector[0])
    refuse_unknown("The balance of momentum", mechanism.force_elements)
    pushed = any(element.pushes_along_x for element in mechanism.force_elements)
    return not pushed and all(component == 0 for component in along)


def sampled_balance(trajectory: Trajectory) -> tuple[FloatArray, FloatArray]:
    """Computes T + V - W from samples alone, W being zero at the first, and the error of W.

    Returns:
        Both [J], shape (n,). The second never decreases: the difference between the integral and
        that over every second sample, fifteen times the error where the power is smooth.
    """
    if not does_work(trajectory.mechanism):
        return trajectory.total_energy, np.zeros(len(trajectory.t))
    power = np.empty(len(trajectory.t))
    for i, acting in AppliedForces(trajectory.kinematics).at_times(trajectory.t):
        power[i] = acting.power(trajectory.q[i], trajectory.u[i])
    breaks = {time for time, _ in trajectory.impacts}.union(trajectory.mechanism.instants)
    work, error = _integrated(trajectory.t, power, sorted(breaks))
    return trajectory.total_energy - work, error


def reference_balance(solution: Solution, reference: Trajectory) -> FloatArray:
    """T + V - W of the reference at a trajectory's times [J], shape (n,)."""
    if not does_work(reference.mechanism):
        return reference.total_energy
    return reference.total_energy - reference_work(solution, reference.t)


def reference_work(solution: Solution, t: FloatArray) -> FloatArray:
    """W from the start to ascending times t [s] of the solution [J], shape (n,)."""
    work, done = np.zeros(len(t)), 0.0
    for segment in solution.segments:
        forces = AppliedForces(segment.equations.kinematics)
        nodes = segment.interpolant.ts
        nodes = np.append(nodes[nodes < segment.end], segment.end)
        sums = np.concatenate([[0.0], np.cumsum(_gauss(forces, segment, nodes[:-1], nodes[1:]))])
        inside = (t >= segment.start) & ((t < segment.end) | (segment is solution.segments[-1]))
        steps = np.clip(np.searchsorted(nodes, t[inside], side="right") - 1, 0, len(nodes) - 2)
        work[inside] = done + sums[steps] + _gauss(forces, segment, nodes[steps], t[inside])
        done += float(sums[-1])
    return work


def _gauss(
    forces: AppliedForces, segment: Segment, starts: FloatArray, ends: FloatArray
) -> FloatArray:
    """Work from each start to its end [J], both within one step of the integrator."""
    if not len(starts):
        return starts
    half = 0.5 * (ends - starts)
    times = (0.5 * (ends + starts))[:, None] + half[:, None] * _NODES
    y = np.asarray(segment.interpolant(times.ravel())).T
    n = y.shape[1] // 2
    power = forces.power(y[:, :n], y[:, n:]).reshape(times.shape)
    return np.asarray(half * (power @ _WEIGHTS), dtype=np.float64)


def _integrated(
    t: FloatArray, power: FloatArray, impacts: list[float]
) -> tuple[FloatArray, FloatArray]:
    """Integral from the first sample to each, and its error, non-decreasing; shape (n,)."""
    work, error = np.zeros(len(t)), np.zeros(len(t))
    # First sample and the one after the last of each piece without impact
    bounds = [0, *np.searchsorted(t, impacts).tolist(), len(t)]
    for first, last in pairwise(bounds):
        if last == first:
            continue
        if first:
            work[first], error[first] = _across(t, power, first, impacts)
            work[first] += work[first - 1]
            error[first] += error[first - 1]
        sums, differences = _simpson(t[first:last], power[first:last])
        work[first:last] = work[first] + sums
        error[first:last] = error[first] + differences
    return work, error


def _across(
    t: FloatArray, power: FloatArray, after: int, impacts: list[float]
) -> tuple[float, float]:
    """Work from the last sample before an impact to the next one, and its error."""
    before, step = after - 1, float(t[after] - t[after - 1])
    times = [time for time in impacts if t[before] < time <= t[after]]
    value = power[before] * (times[0] - t[before]) + power[after] * (t[after] - times[0])
    slope_before = abs(power[before] - power[max(before - 1, 0)])
    slope_after = abs(power[after] - power[min(after + 1, len(t) - 1)])
    several = abs(power[after] - power[before]) if len(times) > 1 else 0.0
    return float(value), step * float(slope_before + slope_after + several)


def _simpson(t: FloatArray, power: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Integral over the samples of one piece, and the difference to that over every second one."""
    trapezoids = np.asarray(cumulative_trapezoid(power, t, initial=0), dtype=np.float64)
    if len(t) < 3:
        return trapezoids, np.abs(np.diff(power, prepend=power[:1]) * np.diff(t, prepend=t[:1]))
    fine = np.asarray(cumulative_simpson(power, x=t, initial=0.0), dtype=np.float64)
    if len(t) < 5:
        return fine, np.maximum.accumulate(np.abs(fine - trapezoids))
    coarse = np.asarray(cumulative_simpson(power[::2], x=t[::2], initial=0.0), dtype=np.float64)
    return fine, np.interp(t, t[::2], np.maximum.accumulate(np.abs(coarse - fine[::2])))
