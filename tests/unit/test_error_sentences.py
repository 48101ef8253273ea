"""Sentences of errors stay short, however long what they quote is."""

from __future__ import annotations

import pytest
from trebucheck.models.errors import InputError, shortened


@pytest.mark.parametrize("length", [0, 999, 1000])
def test_up_to_a_thousand_characters_all_are_kept(length: int) -> None:
    text = "ab" * (length // 2) + "c" * (length % 2)
    assert shortened(text) == text


@pytest.mark.parametrize("length", [1001, 1500, 123_456])
def test_longer_ones_lose_their_middle(length: int) -> None:
    text = "".join(chr(0x4E00 + k % 20_000) for k in range(length))
    short = shortened(text)
    assert len(short) == 1000
    assert short.endswith(text[-300:])
    assert str(length - 1000) in short
    kept = next(k for k in range(1000) if short[k] != text[k])
    assert kept > 600
    assert str(InputError(text)) == short
