"""How the commands of `benchmarks` end, and how they write the made part of a page."""

import sys
from collections.abc import Callable

from zwidth.errors import explain

END = "<!-- until here -->\n"


def ended(work: Callable[[], None]) -> int:
    """Do the work, and return the exit status: 0, or 2 after a sentence for bad input."""
    try:
        work()
    except (OSError, ValueError) as error:
        status, sentence = explain(error)
        print(f"Error: {sentence}", file=sys.stderr)
        return int(status)
    return 0


def begin(by: str) -> str:
    """Return the mark at which the part of a page begins that a program makes."""
    return f"<!-- made by {by} -->\n"


def between_marks(page: str, made: str, by: str) -> str:
    """Return a page with what a program made between its two marks.

    Raises ValueError if a mark is missing.
    """
    before, mark, rest = page.partition(begin(by))
    _, end, after = rest.partition(END)
    if not (mark and end):
        raise ValueError(
            f"the page lacks {begin(by).strip()!r} or {END.strip()!r}; put them where the table is"
            " to stand"
        )
    return before + mark + made + end + after
