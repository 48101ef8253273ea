"""Arrays that carry their derivatives along several directions: forward differentiation.

NumPy's functions, applied to such arrays, apply the chain rule (Griewank and Walther, Evaluating
Derivatives, 2008, Chapter 3), so that what is written once for numbers gives derivatives as well,
exact but for rounding. Real and complex arrays are alike; |z|, Re z and conj z are differentiated
as functions of two real numbers, for the directions are real.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from numpy.lib.mixins import NDArrayOperatorsMixin


class Dual(NDArrayOperatorsMixin):
    """An array of one or two axes (or a number) and its derivatives.

    Args:
        value: shape (...,).
        tangents: derivatives along m directions, shape (..., m).
    """

    def __init__(self, value: Any, tangents: Any) -> None:
        self.value: Any = np.asarray(value)
        self.tangents: Any = tangents

    def __array_ufunc__(self, ufunc: np.ufunc, method: str, *operands: Any, **_: Any) -> Any:
        """A new array; one that is to be written into an array of numbers replaces that."""
        rule = _RULES.get(ufunc) if method == "__call__" else None
        return NotImplemented if rule is None else rule(*operands)

    def __array_function__(self, function: Any, types: Any, args: Any, kwargs: Any) -> Any:
        rule = _FUNCTIONS.get(function)
        return NotImplemented if rule is None else rule(*args, **kwargs)

    def __getitem__(self, key: Any) -> Dual:
        return Dual(self.value[key], self.tangents[_with_directions(key)])

    def __setitem__(self, key: Any, item: Any) -> None:
        self.value[key], self.tangents[_with_directions(key)] = value_of(item), _tangents(item)

    @property
    def shape(self) -> tuple[int, ...]:
        """Shape of the value."""
        return self.value.shape

    @property
    def ndim(self) -> int:
        """Number of the value's axes."""
        return self.value.ndim

    @property
    def real(self) -> Dual:
        """Real part."""
        return Dual(self.value.real, self.tangents.real)

    @property
    def imag(self) -> Dual:
        """Imaginary part."""
        return Dual(self.value.imag, self.tangents.imag)

    @property
    def T(self) -> Dual:  # noqa: N802 (NumPy's name)
        """Transpose of a matrix."""
        return Dual(self.value.T, np.swapaxes(self.tangents, 0, -2))

    def conj(self) -> Dual:
        """Complex conjugate."""
        return Dual(self.value.conj(), self.tangents.conj())

    conjugate = conj


def value_of(operand: Any) -> Any:
    """The value of an array with or without derivatives."""
    return operand.value if isinstance(operand, Dual) else operand


def _tangents(operand: Any) -> Any:
    return operand.tangents if isinstance(operand, Dual) else 0.0


def _with_directions(key: Any) -> Any:
    return (*key, slice(None)) if isinstance(key, tuple) and Ellipsis in key else key


def _each(operand: Any) -> Any:
    """The value beside an axis of directions."""
    return np.asarray(value_of(operand))[..., None]


def _of_shape(value: Any, tangents: Any) -> Dual:
    shape = (*np.shape(value), tangents.shape[-1])
    return Dual(
        value, tangents if tangents.shape == shape else np.broadcast_to(tangents, shape).copy()
    )


def _add(a: Any, b: Any) -> Dual:
    return _of_shape(value_of(a) + value_of(b), _tangents(a) + _tangents(b))


def _subtract(a: Any, b: Any) -> Dual:
    return _of_shape(value_of(a) - value_of(b), _tangents(a) - _tangents(b))


def _multiply(a: Any, b: Any) -> Dual:
    if not isinstance(b, Dual):
        return _of_shape(a.value * b, a.tangents * _each(b))
    if not isinstance(a, Dual):
        return _of_shape(a * b.value, _each(a) * b.tangents)
    return _of_shape(a.value * b.value, a.tangents * _each(b) + _each(a) * b.tangents)


def _divide(a: Any, b: Any) -> Dual:
    value = value_of(a) / value_of(b)
    return _of_shape(value, (_tangents(a) - _each(value) * _tangents(b)) / _each(b))


def _matmul(a: Any, b: Any) -> Dual:
    left, right = value_of(a), value_of(b)
    parts = list[Any]()
    if isinstance(a, Dual):
        part = np.swapaxes(a.tangents, -1, -2) @ right
        parts.append(part if right.ndim == 1 else np.swapaxes(part, -1, -2))
    if isinstance(b, Dual):
        parts.append(
            left @ b.tangents if right.ndim == 1 else np.tensordot(left, b.tangents, axes=1)
        )
    return Dual(left @ right, parts[0] if len(parts) == 1 else parts[0] + parts[1])


def _power(a: Dual, exponent: int) -> Dual:
    return Dual(a.value**exponent, exponent * _each(a) ** (exponent - 1) * a.tangents)


def _exp(a: Dual) -> Dual:
    value = np.exp(a.value)
    return Dual(value, value[..., None] * a.tangents)


def _absolute(a: Dual) -> Dual:
    size = np.abs(a.value)
    return Dual(size, (_each(a).conj() * a.tangents).real / size[..., None])


def _negative(a: Dual) -> Dual:
    return Dual(-a.value, -a.tangents)


def _where(condition: Any, a: Any, b: Any) -> Dual:
    tangents = np.where(np.asarray(condition)[..., None], _tangents(a), _tangents(b))
    return _of_shape(np.where(condition, value_of(a), value_of(b)), tangents)


def _sum(a: Dual, axis: int) -> Dual:
    return Dual(a.value.sum(axis), a.tangents.sum(axis - 1 if axis < 0 else axis))


def _stack(items: Sequence[Any], axis: int = 0) -> Dual:
    empty = np.zeros_like(next(item.tangents for item in items if isinstance(item, Dual)))
    tangents = [item.tangents if isinstance(item, Dual) else empty for item in items]
    return Dual(
        np.stack([value_of(item) for item in items], axis),
        np.stack(tangents, axis - 1 if axis < 0 else axis),
    )


def _transposed(a: Dual, *_: int) -> Dual:
    return a.T


_RULES: dict[np.ufunc, Callable[..., Dual]] = {
    np.add: _add,
    np.subtract: _subtract,
    np.negative: _negative,
    np.multiply: _multiply,
    np.divide: _divide,
    np.matmul: _matmul,
    np.power: _power,
    np.exp: _exp,
    np.absolute: _absolute,
    np.conjugate: Dual.conj,
}
_FUNCTIONS: dict[Any, Callable[..., Dual]] = {
    np.where: _where,
    np.sum: _sum,
    np.stack: _stack,
    np.swapaxes: _transposed,
}
