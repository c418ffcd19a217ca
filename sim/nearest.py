"""Suggestions of error messages for an unknown word."""

import re
from collections.abc import Iterable
from difflib import SequenceMatcher, get_close_matches


def nearest(word: str, known: Iterable[str]) -> str:
    """Return "did you mean 'x'?" for the nearest known word, or the list of all of them."""
    words = list(known)
    near = get_close_matches(word, words, max(1, len(words)), 0.5)
    if not near:
        return f"choose from {', '.join(words)}"
    best = min(near, key=lambda other: (-_alike(word, other), *_apart(word, other)))
    return f"did you mean {best!r}?"


def _alike(word: str, other: str) -> float:
    """The measure of `get_close_matches`, which leaves ties to the alphabet."""
    return SequenceMatcher(None, other, word).ratio()


def _apart(word: str, other: str) -> tuple[int, int]:
    """How far the number in a word lies from the one asked for, and that number: "m1" for "m0"."""
    asked, there = (re.search(r"\d+", text) for text in (word, other))
    if asked is None or there is None:
        return 0, 0
    return abs(int(there[0]) - int(asked[0])), int(there[0])
