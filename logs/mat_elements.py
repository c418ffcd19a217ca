"""Checks the elements of a MAT file of v5 to v7 before scipy reads it.

scipy looks up the type of a data element in a table of 20 entries without a bounds check
(read_numeric and read_char in _mio5_utils.pyx), and joins characters along the last dimension of an
array that has none (chars_to_strings in _mio_utils.pyx), so one damaged byte ends the interpreter.
This check visits the elements in the same order as scipy, and stops where scipy would not return.
Layout: MAT-File Format, MathWorks, chapter 1, Level 5.
"""

import math
import struct
import zlib

HEADER = 128
DATA = frozenset({1, 2, 3, 4, 5, 6, 7, 9, 12, 13, 16, 17, 18})  # int8 ... uint64, UTF-8 ... UTF-32
MATRIX, COMPRESSED = 14, 15
CELL, STRUCT, OBJECT, CHAR, SPARSE, FUNCTION, OPAQUE = 1, 2, 3, 4, 5, 16, 17
NUMERIC = range(6, 16)
DEEPEST = 64


class BrokenElements(ValueError):
    """The elements of the file are not valid."""


class TooLarge(ValueError):
    """The variables unpack to more than they may."""


def check_elements(data: bytes, most: int) -> None:
    """Raise BrokenElements where scipy would read beyond its table of types, or without end.

    most: largest unpacked size of all variables together [bytes]; raises TooLarge beyond it.
    """
    order = "<" if data[126:128] == b"IM" else ">"
    top = _Walk(data, order, HEADER)
    while top.at < len(data):
        kind, size = top.tag()
        following = top.at + size
        if kind == COMPRESSED:
            unpacked = _inflated(data[top.at : following], most)
            most -= len(unpacked)
            _Walk(unpacked, order, 0).matrix(0)
        elif kind == MATRIX:
            top.body(0)
        else:
            raise BrokenElements(f"a variable has the type {kind}, which is not that of an array")
        if size == 0:
            raise BrokenElements("a variable is empty")
        top.at = following


def _inflated(data: bytes, most: int) -> bytes:
    try:
        found = zlib.decompressobj().decompress(data, most + 1)
    except zlib.error as error:
        raise BrokenElements(f"a variable cannot be decompressed ({error})") from None
    if len(found) > most:
        raise TooLarge
    return found


class _Walk:
    """The position of scipy's reader; at: the offset of the next element."""

    def __init__(self, data: bytes, order: str, at: int) -> None:
        self.data, self.at = data, at
        self.words = struct.Struct(order + "II")
        self.order = order

    def tag(self) -> tuple[int, int]:
        """Read two words: type and size of an element, or its flags."""
        if self.at + 8 > len(self.data):
            raise BrokenElements("the file ends within a variable")
        found = self.words.unpack_from(self.data, self.at)
        self.at += 8
        return found[0], found[1]

    def element(self) -> bytes:
        """Read a data element of a known type, small or padded to eight bytes."""
        first, size = self.tag()
        if first >> 16:
            kind, size, start = first & 0xFFFF, first >> 16, self.at - 4
        else:
            kind, start = first, self.at
            self.at += size + -size % 8
        if kind not in DATA:
            raise BrokenElements(f"a variable has data of type {kind}, which does not exist")
        if start + size > len(self.data) or (first >> 16 and size > 4):
            raise BrokenElements("the file ends within a variable")
        return self.data[start : start + size]

    def numbers(self) -> list[int]:
        """Read an element of signed words, such as dimensions."""
        content = self.element()
        return list(
            struct.unpack(f"{self.order}{len(content) // 4}i", content[: len(content) // 4 * 4])
        )

    def matrix(self, depth: int) -> None:
        """Pass over one matrix."""
        kind, size = self.tag()
        if kind != MATRIX:
            raise BrokenElements(f"a value has the type {kind}, where only an array is allowed")
        if depth > DEEPEST:
            raise BrokenElements(f"a structure is nested more than {DEEPEST} levels deep")
        if size:
            self.body(depth)

    def body(self, depth: int) -> None:
        """Skip the content after the tag of a matrix, by its class."""
        self.tag()
        flags, _ = self.tag()
        kind, parts = flags & 0xFF, 1 + (flags >> 11 & 1)  # real, and imaginary
        if kind == OPAQUE:
            for _ in range(3):  # name, type system, class
                self.element()
            self.matrix(depth + 1)
            return
        dimensions = self.numbers()
        if len(dimensions) < 2 or min(dimensions) < 0:
            raise BrokenElements(f"an array has the impossible dimensions {dimensions}")
        count = math.prod(dimensions)
        self.element()  # name
        if kind == OBJECT:
            self.element()  # class
        if kind in NUMERIC or kind in (SPARSE, CHAR):
            for _ in range(parts + 2 if kind == SPARSE else 1 if kind == CHAR else parts):
                self.element()
        elif kind in (CELL, STRUCT, OBJECT):
            for _ in range(count if kind == CELL else count * self.fields()):
                self.matrix(depth + 1)
        elif kind == FUNCTION:
            self.matrix(depth + 1)
        else:
            raise BrokenElements(f"an array has the unknown class {kind}")

    def fields(self) -> int:
        """Read the names of a structure's fields; return how many there are."""
        lengths, names = self.numbers(), self.element()
        if len(lengths) != 1 or lengths[0] <= 0:
            raise BrokenElements("the length of the field names of a structure is missing")
        return len(names) // lengths[0]
