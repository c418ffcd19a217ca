"""Limits of the depth and length of a formula in a file, checked before it is used.

Python's parser, and everything that walks its tree, is recursive and fails or crashes at thousands
of nested operations. Integer powers are multiplied out, so `((q**8)**8)**8` has 512 factors.
"""

import ast
import math
import tomllib
from pathlib import Path

LONGEST = 10_000  # characters
DEEPEST = 100  # nested operations; each gets parentheses, and Python accepts 200
MOST = 5_000  # operations and operands, with integer powers multiplied out
MOST_POWER = 8  # largest integer exponent that is multiplied out


def refuse_endless_file(file: Path, text: bytes) -> None:
    """Raise ValueError, which names the file, as `refuse_endless` does for the formula in it."""
    try:
        formula = tomllib.loads(text.decode("utf-8")).get("formula")
    except RecursionError:
        raise ValueError(
            f"{file}: this is not TOML that can be read: its values nest too deep; an effect's file"
            " has a table in a table at most"
        ) from None
    except ValueError:  # not TOML; its reader reports this
        return
    try:
        refuse_endless(formula if isinstance(formula, str) else "")
    except ValueError as error:
        raise ValueError(f"{file}: {error}") from None


def refuse_endless(formula: str) -> None:
    """Raise ValueError for a formula that is too long or too deep, or has an infinite number.

    Text that is not an expression passes; its reader reports this.
    """
    if len(formula) > LONGEST:
        raise ValueError(
            f"formula has {len(formula)} characters, and may have {LONGEST}; write it shorter, or"
            " as several effects"
        )
    deep = ValueError(
        f"formula {formula[:20]!r}... has more than {DEEPEST} operations within each other; write"
        " it shorter, or as several effects"
    )
    try:
        tree = ast.parse(formula.strip(), mode="eval").body
    except SyntaxError:
        return
    except (RecursionError, MemoryError):  # the parser's stack has its own limit
        raise deep from None
    order, depths = [tree], [1]
    for node, depth in zip(order, depths, strict=False):  # both grow during the loop
        if depth > DEEPEST:
            raise deep
        if isinstance(node, ast.Constant) and not _finite(node.value):
            raise ValueError(
                "formula has a number above 1.8e308, the largest possible; write a smaller one"
            )
        order += (within := _within(node))
        depths += [depth + 1] * len(within)
    sizes: dict[int, int] = {}
    for node in reversed(order):
        size = 1 + sum(sizes[id(inner)] for inner in _within(node))
        if isinstance(node, ast.BinOp) and isinstance(node.op, ast.Pow):
            exponent = node.right.value if isinstance(node.right, ast.Constant) else 0
            size *= next((n for n in range(1, MOST_POWER + 1) if n == exponent), 1)
        sizes[id(node)] = size
    if sizes[id(tree)] > MOST:
        raise ValueError(
            f"formula has {sizes[id(tree)]} operations and operands, whole powers multiplied out,"
            f" and may have {MOST}; write it shorter, or as several effects"
        )


def _within(node: ast.expr) -> list[ast.expr]:
    return [inner for inner in ast.iter_child_nodes(node) if isinstance(inner, ast.expr)]


def _finite(value: object) -> bool:
    """Whether a number is one that a computation can begin with; True for what is no number."""
    try:
        return not isinstance(value, int | float) or math.isfinite(value)
    except OverflowError:  # an integer beyond the range of floats
        return False
