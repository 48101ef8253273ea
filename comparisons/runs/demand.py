"""Values that are made when they are asked for."""

from __future__ import annotations

from collections.abc import Callable, Generator, Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import TypeVar

_K = TypeVar("_K")
_V = TypeVar("_V")


class OnDemand(Mapping[_K, _V]):
    """A mapping whose values are made, once, when they are first asked for."""

    def __init__(self, makers: Mapping[_K, Callable[[], _V]]) -> None:
        self._makers, self._values = dict(makers), dict[_K, _V]()

    def __getitem__(self, key: _K) -> _V:
        if key not in self._values:
            self._values[key] = self._makers[key]()
        return self._values[key]

    def __iter__(self) -> Iterator[_K]:
        return iter(self._makers)

    def __len__(self) -> int:
        return len(self._makers)


def in_order(function: Callable[[_K], _V], items: Sequence[_K], jobs: int) -> Generator[_V]:
    """The function's values in the order of the items, each computed when asked for, or by that many threads."""
    if jobs == 1:
        yield from map(function, items)
        return
    threads = ThreadPoolExecutor(jobs)
    try:
        yield from threads.map(function, items)
    finally:  # no further run is started when this is left early
        threads.shutdown(wait=False, cancel_futures=True)
