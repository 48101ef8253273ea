"""The reference motion: equations, stops, events."""

TOLERANCE = 3e-14
"""Local error bound of DOP853 and of Radau's method, relative and absolute [rad, m, rad/s, m/s].

Just above the least of SciPy (100 machine epsilons): energy then varies by some 1e-13.
"""
