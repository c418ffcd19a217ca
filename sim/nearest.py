"""What to say to a word that nobody knows."""

from collections.abc import Iterable
from difflib import get_close_matches


def nearest(word: str, known: Iterable[str]) -> str:
    """Return "did you mean 'x'?" for the nearest known word, or the list of all of them."""
    words = list(known)
    near = get_close_matches(word, words, 1, 0.5)
    return f"did you mean {near[0]!r}?" if near else f"known are {', '.join(words)}"
