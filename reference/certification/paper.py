"""The paper's own Lagrangian, Eqs. (1) to (10), written out once more: the independent derivation.

Nothing here knows of `Mechanism`. SymPy (a test dependency) differentiates the Lagrangian as printed; the result
must agree with :mod:`..equations` at any state. The paper's angles are ours; its multipliers relate to our stop
torques by lambda_(G1) = -torque(sling rest) and lambda_(G2) = +torque(hanger rest), because it writes
G1 = theta - phi + phi_0, which is minus the sling's gap.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
import sympy as sp

from ...models.arrays import FloatArray
from ...models.machines.parameters import TrebuchetParameters

_PARAMETERS = ("l1", "l2", "m_b", "m_cw", "m_a", "h", "r", "g")


@dataclass(frozen=True)
class PaperEquations:
    """The Euler-Lagrange equations of the paper's Eq. (1), fixed (Sec. II) or rolling (Sec. VI)."""

    rolling: bool

    @cached_property
    def _symbols(self) -> dict[str, Any]:
        return {name: sp.Symbol(name, positive=True) for name in _PARAMETERS}

    @cached_property
    def _coordinates(self) -> list[Any]:
        t = sp.Symbol("t")
        names = ("theta", "phi", "alpha", "x_p") if self.rolling else ("theta", "phi", "alpha")
        return [sp.Function(name)(t) for name in names]

    def _energies(self) -> tuple[Any, Any]:
        """T and U, Eqs. (2)-(5) fixed, Eqs. (3), (4), (8)-(10) rolling."""
        s, t = self._symbols, sp.Symbol("t")
        theta, phi, alpha = self._coordinates[:3]
        x_p = self._coordinates[3] if self.rolling else sp.Integer(0)
        x_b = x_p + s["l1"] * sp.cos(theta) + s["r"] * sp.cos(phi)  # (4a), (10a)
        y_b = -s["l1"] * sp.sin(theta) - s["r"] * sp.sin(phi)  # (4b)
        x_cw = x_p - s["l2"] * sp.cos(theta) + s["h"] * sp.cos(alpha)  # (4c), (10b)
        y_cw = s["l2"] * sp.sin(theta) - s["h"] * sp.sin(alpha)  # (4d)
        x_a = x_p + (s["l1"] - s["l2"]) / 2 * sp.cos(theta)  # (10c)
        y_a = -(s["l1"] - s["l2"]) / 2 * sp.sin(theta)  # (4e)

        def square(x: Any, y: Any) -> Any:
            return sp.diff(x, t) ** 2 + sp.diff(y, t) ** 2

        kinetic = s["m_b"] * square(x_b, y_b) + s["m_cw"] * square(x_cw, y_cw)
        if self.rolling:
            inertia = s["m_a"] * (s["l1"] + s["l2"]) ** 2 / 12  # (9)
            kinetic += s["m_a"] * square(x_a, y_a)  # (8)
        else:
            inertia = s["m_a"] * (s["l1"] ** 3 + s["l2"] ** 3) / (s["l1"] + s["l2"]) / 3  # (5)
        kinetic += inertia * sp.diff(theta, t) ** 2  # (2), (8)
        potential = s["g"] * (s["m_cw"] * y_cw + s["m_b"] * y_b + s["m_a"] * y_a)  # (3)
        return kinetic / 2, potential

    @cached_property
    def _functions(self) -> tuple[Callable[..., Any], Callable[..., Any]]:
        """M(q) and the forces f(q, u) of M a = f + (dG/dq)^T lambda, as NumPy functions."""
        t, q = sp.Symbol("t"), self._coordinates
        kinetic, potential = self._energies()
        lagrangian = kinetic - potential  # (1), the constraint terms being linear in q
        u = [sp.diff(c, t) for c in q]
        plain_q, plain_u = sp.symbols(f"q0:{len(q)}"), sp.symbols(f"u0:{len(q)}")
        plain_a = sp.symbols(f"a0:{len(q)}")
        swap: dict[Any, Any] = dict(zip([sp.diff(v, t) for v in u], plain_a, strict=True))
        swap |= dict(zip(u, plain_u, strict=True)) | dict(zip(q, plain_q, strict=True))
        left = [sp.diff(sp.diff(lagrangian, v), t) - sp.diff(lagrangian, c) for c, v in zip(q, u, strict=True)]
        residual = sp.Matrix([sp.sympify(expression).subs(swap) for expression in left])
        mass = residual.jacobian(list(plain_a))
        forces = -residual.subs(dict.fromkeys(plain_a, 0))
        arguments = [list(self._symbols.values()), list(plain_q), list(plain_u)]
        return sp.lambdify(arguments, mass, "numpy"), sp.lambdify(arguments, forces, "numpy")

    def solve(
        self, parameters: TrebuchetParameters, q: FloatArray, u: FloatArray, sling_held: bool, hanger_held: bool
    ) -> tuple[FloatArray, FloatArray]:
        """Accelerations (n_q,), and the multipliers of the held constraints, G1 (sling) before G2 (hanger)."""
        values = [getattr(parameters, name) for name in _PARAMETERS]
        mass, forces = (np.array(function(values, q, u), dtype=np.float64) for function in self._functions)
        g1, g2 = np.zeros(len(q)), np.zeros(len(q))
        g1[:2] = 1.0, -1.0  # (6): G1 = theta - phi + phi_0
        g2[[0, 2]] = 1.0, -1.0  # (7): G2 = theta - alpha + alpha_0
        held = [row for row, is_held in ((g1, sling_held), (g2, hanger_held)) if is_held]
        jacobian = np.array(held).reshape(len(held), len(q))
        kkt = np.block([[mass, -jacobian.T], [jacobian, np.zeros((len(held), len(held)))]])
        right = np.concatenate([forces.ravel(), np.zeros(len(held))])
        solution = np.asarray(np.linalg.solve(kkt, right), dtype=np.float64)
        return solution[: len(q)], solution[len(q) :]
