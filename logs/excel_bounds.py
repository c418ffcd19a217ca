"""How much memory a workbook needs in its reader, found before the reader opens it.

The reader makes a table of all cells up to the furthest one, and copies a shared text into each
cell that has it. So one cell at XFD1048576, in a file of 2 KB, requests 549 GB, and without this
memory the process ends. So every sheet is first scanned as a stream for its furthest cell and the
uses of its shared texts. The result is never less than what the reader allocates: a cell counts as
at least one column beyond the last one, whatever position it states.

The reader gets a new archive of the scanned parts, so it reads what was checked, even if the file
is several archives or formats at once.
"""

import io
import re
import zipfile
from collections import Counter
from collections.abc import Callable, Sequence
from pathlib import Path
from xml.parsers import expat

from zwidth.logs.source import RecordingError
from zwidth.logs.unpacked import most_bytes, refuse_bomb

MOST_BYTES = 1 << 31  # of an unpacked workbook, and of its tables
CELL_BYTES = 32  # of a cell in the reader, even if it is empty
COPIES = 2  # of a text in a cell: the reader's and Python's
PARTS = (".xml", ".rels")  # the parts of an XLSX that the reader reads
BINARY = "xl/workbook.bin"  # present in an XLSB
SHARED = re.compile(rb"[<:]si[\s/>]")  # a shared text
CELL, MARK = re.compile(rb"[<:]c[\s/>]"), re.compile(rb"[\"']s[\"']")  # of any prefix
COLUMN = re.compile(rb'<(?:x:)?c r="([A-Z]{1,3})[0-9]{1,7}"')
ROW = re.compile(rb'<(?:x:)?c r="[A-Z]{1,3}([0-9]{1,7})"')
NUMBER = re.compile(rb't="s"><(?:x:)?v>([0-9]{1,9})</')
DIGITS = "0123456789"
LONGEST = 18  # letters or digits of a cell's position

Start = Callable[[str, dict[str, str]], object]


def bounded(path: Path, data: bytes) -> bytes:
    """Return a new archive with the parts of a workbook that the reader may read.

    Raises RecordingError if it or its tables unpack to more than a file of its size may.
    """
    with zipfile.ZipFile(io.BytesIO(data)) as archive:
        every = archive.infolist()
        refuse_bomb(path, sum(entry.file_size for entry in every), len(data), MOST_BYTES)
        names = Counter(entry.filename.lower() for entry in every)
        if BINARY in names:
            raise RecordingError(
                f"{path.name} is an Excel workbook in binary form (.xlsb), which is not read; save"
                " it as .xlsx or CSV"
            )
        for name, count in names.items():
            if count > 1:
                raise RecordingError(
                    f"{path.name} has {count} parts named {name!r}, but the names in a workbook"
                    " are unique; save it again"
                )
        entries = [entry for entry in every if entry.filename.lower().endswith(PARTS)]
        lengths: list[int] = []
        for entry in entries:
            if SHARED.search(part := archive.read(entry)):
                found = _lengths(path, entry.filename, part)
                lengths += [0] * (len(found) - len(lengths))
                lengths[: len(found)] = map(max, found, lengths)
        allowed = most_bytes(len(data), MOST_BYTES)
        made = io.BytesIO()
        with zipfile.ZipFile(made, "w", zipfile.ZIP_DEFLATED, compresslevel=1) as anew:
            for entry in entries:
                if b"sheetData" in (part := archive.read(entry)):
                    allowed -= _table(path, entry.filename, part, lengths, len(data), allowed)
                anew.writestr(entry.filename, part)
    return made.getvalue()


def _table(
    path: Path, name: str, part: bytes, lengths: Sequence[int], size: int, allowed: int
) -> int:
    """Return the bytes that a sheet becomes; raises RecordingError if they are more than allowed.

    lengths: of the shared texts. size: of the file. allowed: after the sheets before this one.
    """
    if (found := _plain(part, lengths)) is None or found > allowed:
        sheet = _Sheet(path, name, lengths)
        _go_through(path, name, part, sheet.start, sheet.text)
        sheet.end()
        found = sheet.cells + sheet.texts
        most = f"and all sheets of a workbook of {size} bytes may have at most"
        if found > allowed and sheet.texts > sheet.cells:
            raise RecordingError(
                f"{name} of {path.name} repeats shared texts in its cells, which makes"
                f" {sheet.texts // COPIES >> 20} MiB, {most}"
                f" {most_bytes(size, MOST_BYTES) // COPIES >> 20} MiB; shorten the texts, or save"
                " the sheet as CSV"
            )
        if found > allowed:
            raise RecordingError(
                f"{name} of {path.name} has its furthest cell in row {sheet.rows}, column"
                f" {sheet.columns}, {most} {most_bytes(size, MOST_BYTES) // CELL_BYTES} cells, with"
                " the empty ones; delete the cells outside of the table, or save the sheet as CSV"
            )
    return found


def _plain(part: bytes, lengths: Sequence[int]) -> int | None:
    """Return the bytes that a sheet becomes at most, None if it is not written as by programs.

    Those write the place of a cell first, and the number of a text directly after its mark. Where
    all cells and marks are so, whatever reads them reads the same, and no parser is needed.
    """
    columns = COLUMN.findall(part)
    if len(columns) != len(CELL.findall(part)):
        return None
    texts = 0
    if lengths:
        numbers = NUMBER.findall(part)
        if len(numbers) != len(MARK.findall(part)):
            return None
        longest = max(lengths)
        for number, uses in Counter(map(int, numbers)).items():
            texts += COPIES * uses * (lengths[number] if number < len(lengths) else longest)
    last = max((_column(letters.decode()) for letters in set(columns)), default=0)
    return CELL_BYTES * last * max(map(int, ROW.findall(part)), default=0) + texts


def _column(letters: str) -> int:
    """Return the column of "AB", from 1 on."""
    column = 0
    for letter in letters.upper():
        column = 26 * column + ord(letter) - ord("A") + 1
    return column


class _Sheet:
    """The furthest cell of a sheet, and the bytes of the shared texts in its cells."""

    def __init__(self, path: Path, name: str, lengths: Sequence[int]) -> None:
        self.path, self.name, self.lengths = path, name, lengths
        self.longest = max(lengths, default=0)
        self.rows, self.columns, self.texts = 0, 0, 0
        self._row, self._column = 0, 0  # counted upwards from 1
        self._place = 0  # the row that the cell states
        self._shared = False  # whether its value is the index of a shared text
        self._number: list[str] | None = None
        self._known: dict[str, int] = {}

    @property
    def cells(self) -> int:
        """The bytes of all cells up to the furthest one; a row more, which may be unsaid."""
        return CELL_BYTES * (self.rows + 1) * self.columns

    def end(self) -> None:
        """Count the last shared text; one whose number is not read alike by all, as the longest."""
        if self._number is None:
            return
        number = "".join(self._number).strip()
        self._number = None
        plain = number.isascii() and number.isdigit() and len(number) < 10
        at = int(number) if plain else len(self.lengths)
        self.texts += COPIES * (self.lengths[at] if at < len(self.lengths) else self.longest)

    def start(self, tag: str, own: dict[str, str]) -> None:
        """Take the start of an element; of a million cells two million, so without detours."""
        if tag == "c":
            if self._number is not None:
                self.end()
            self._column += 1
            self._place = self._row
            self._shared = own.get("t") == "s"
            if (place := own.get("r")) is not None:
                letters = place.rstrip(DIGITS)
                column = self._known.get(letters) or self._column_of(letters, place)
                self._column = max(self._column, column)
                self._place = max(self._row, self._row_of(place[len(letters) :], place))
        elif tag == "v" or tag == "is":  # a cell without a value does not enlarge the table
            self.end()
            self.rows = max(self.rows, self._place)
            self.columns = max(self.columns, self._column)
            self._number = [] if self._shared else None
        elif tag == "row":
            self.end()
            self._row, self._column = self._row + 1, 0
            if (place := own.get("r")) is not None:
                self._row = max(self._row, self._row_of(place, place))
        else:
            self.text("?")  # readers disagree on other elements within a number

    def text(self, piece: str) -> None:
        """Take a piece of a text."""
        if self._number is not None:
            self._number.append(piece)

    def _row_of(self, digits: str, place: str) -> int:
        if len(digits) > LONGEST or not (digits.isdigit() and digits.isascii()):
            raise self._no_place(place)
        return int(digits)

    def _column_of(self, letters: str, place: str) -> int:
        """Return the column of "AB", from 1 on."""
        if len(letters) > LONGEST or not (letters.isalpha() and letters.isascii()):
            raise self._no_place(place)
        return self._known.setdefault(letters, _column(letters))

    def _no_place(self, place: str) -> RecordingError:
        return RecordingError(
            f"{self.name} of {self.path.name} has a cell or row {place[:40]!r}, which is no place"
            " in a sheet; save the workbook again"
        )


def _lengths(path: Path, name: str, part: bytes) -> list[int]:
    """Return the length of each shared text [bytes]."""
    found: list[int] = []

    def start(tag: str, _: dict[str, str]) -> None:
        if tag == "si":
            found.append(0)

    def text(piece: str) -> None:
        if found:
            found[-1] += len(piece.encode())

    _go_through(path, name, part, start, text)
    return found


def _go_through(
    path: Path, name: str, part: bytes, start: Start, text: Callable[[str], object]
) -> None:
    """Have the starts of elements and the texts of a part told; raises RecordingError."""
    parser = expat.ParserCreate("UTF-8")  # as the reader does, whatever the file declares

    def local(tag: str, own: dict[str, str]) -> None:
        start(tag.rpartition(":")[2] if ":" in tag else tag, own)

    def odd(*_: object) -> None:  # readers disagree on whether this ends the text
        text("?")

    def doctype(*_: object) -> None:
        raise RecordingError(
            f"{name} of {path.name} declares a DOCTYPE, which no workbook needs; save the"
            " workbook again"
        )

    parser.StartElementHandler, parser.CharacterDataHandler = local, text
    parser.CommentHandler = parser.StartCdataSectionHandler = odd
    parser.ProcessingInstructionHandler, parser.StartDoctypeDeclHandler = odd, doctype
    try:
        parser.Parse(part, True)
    except expat.ExpatError as error:
        raise RecordingError(
            f"{name} of {path.name} is not XML ({error}); save the workbook again"
        ) from None
