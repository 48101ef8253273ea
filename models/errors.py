"""The errors that this package raises; each text is one sentence for the user."""

from __future__ import annotations

_LONGEST, _TAIL = 1000, 300


def shortened(text: str) -> str:
    """Cut a text of more than some thousand characters in its middle."""
    if len(text) <= _LONGEST:
        return text
    left_out = f" [... {len(text) - _LONGEST} characters ...] "
    return text[: _LONGEST - _TAIL - len(left_out)] + left_out + text[-_TAIL:]


class TrebucheckError(Exception):
    """Base of every error this package raises on purpose; its text is a short sentence."""

    def __init__(self, *arguments: object) -> None:
        texts = [shortened(text) if isinstance(text, str) else text for text in arguments]
        super().__init__(*texts)


class InputError(TrebucheckError, ValueError):
    """A value, option, name or file is not usable: the text names it and says what is valid."""


class StudyEndedError(InputError):
    """A study cannot go on, and no engine is at fault: it ends with this sentence."""


class UnwritableError(StudyEndedError):
    """A file or folder cannot be written."""


class EngineNotInstalledError(TrebucheckError, ImportError):
    """An engine is known but its package cannot be imported here."""


class UnsupportedProblemError(TrebucheckError, ValueError):
    """An engine cannot build the mechanism, or cannot follow the law of its stops."""


class SimulationError(TrebucheckError, RuntimeError):
    """An engine gave up, crashed or diverged while it ran."""
