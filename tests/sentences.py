# SPDX-License-Identifier: GPL-3.0-or-later
"""What refusals must be: sentences."""

from __future__ import annotations


def check_sentence(refusal: BaseException) -> str:
    """The text of a refusal, if that is a sentence; else AssertionError."""
    text = str(refusal)
    assert len(text) > 15 and " " in text, f"no sentence: {text!r}"
    return text
