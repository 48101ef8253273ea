"""Completion in shells: machines, engines, presets and options, also within a comma list."""

from __future__ import annotations

from collections.abc import Callable, Iterable

Complete = Callable[[str], list[str]]


def _last_of(names: Callable[[], Iterable[str]]) -> Complete:
    """Completes the last name of a comma list."""

    def complete(incomplete: str) -> list[str]:
        before, comma, last = incomplete.rpartition(",")
        given = before.split(",")
        return [
            f"{before}{comma}{name}"
            for name in names()
            if name.startswith(last) and name not in given
        ]

    return complete


def _machines() -> list[str]:
    from ..models.library.registry import benchmarks, models

    return [*models(), *(each.name for each in benchmarks(None))]


def _problems() -> list[str]:
    from ..models.library.registry import benchmarks

    return [each.name for each in benchmarks(None)]


def _engines() -> tuple[str, ...]:
    from ..engines.registry import engine_names

    return engine_names()


def _presets() -> list[str]:
    from ..engines.registry import engine_class

    return list(
        dict.fromkeys(preset for name in _engines() for preset in engine_class(name).presets())
    )


def _options() -> list[str]:
    from ..engines.registry import option_names

    return [f"{name}.{option}=" for name in _engines() for option in option_names(name) or ()]


machines, problems, engines = _last_of(_machines), _last_of(_problems), _last_of(_engines)
presets, options = _last_of(_presets), _last_of(_options)
