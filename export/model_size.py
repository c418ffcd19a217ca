"""How large a model of MuJoCo becomes, found before MuJoCo compiles it.

A few lines of MJCF can declare any number of bodies (nested counts, attached models), numbers and
pixels. MuJoCo cannot be interrupted, and its time grows with the square of the bodies: 10 000 of
them, joints and shapes included, take it some 20 s.
"""

import math
import re
import struct
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from xml.etree.ElementTree import Element

from zwidth.files.protection import reading
from zwidth.logs.unpacked import most_bytes

MOST_PARTS = 10_000  # bodies, joints, shapes, sites, and points of flexible parts
MOST_ELEMENTS = 1_000_000  # of XML, each counted as often as it is copied
MOST_PARAMETER = 360  # of a generated shape: points along an edge, degrees
MOST_MEMORY = 1 << 32  # bytes that a model may request; MuJoCo uses only what it needs
PARTS = frozenset((
    "body", "joint", "freejoint", "geom", "site", "camera", "light", "frame", "replicate", "link",
))  # fmt: skip
POINTS = {"composite": ("count",), "flexcomp": ("count", "cellcount"), "flex": ("cellcount",)}
USUAL_POINTS = 1000  # of a flexcomp without a count
POINT_BYTES = 100  # per point of a file of points
# Bytes per unit of an attribute: of an actuator or sensor, of other elements, of the model.
OF_ONE = {"nsample": 32, "actdim": 32}
OF_TAG = {("user", "dim"): 8, ("contact", "num"): 512, ("numeric", "size"): 8}
OF_ALL = {"nuserdata": 8, "njmax": 1000, "nconmax": 1000, "nstack": 8}
PIXEL = {"hfield": 16, "texture": 6}  # bytes per pixel while it is read
SIDES = 6  # of a texture that is not declared as a plane; each is a square
RAY = 64  # bytes per pixel of a camera that measures distances
KEYS_OF_PART = 100  # this many stored states take as long as one part
PNG, PNG_STARTS = struct.Struct(">8s8xII"), b"\x89PNG\r\n\x1a\n"
MEMORY = re.compile(r"\s*\+?(\d{1,18})([KMGTPE]?)\s*", re.IGNORECASE)
POWERS = ("", *"KMGTPE")


class ModelTooLarge(ValueError):
    """A model that MuJoCo would compile for ever, or that needs too much memory."""


@dataclass
class Size:
    """The size of a compiled model: parts, elements of XML, bytes, and bytes per part."""

    parts: int = 0
    elements: int = 0
    bytes: int = 0
    of_part: int = 0

    def add(self, other: "Size", times: int) -> None:
        """Add another size a number of times."""
        self.parts += times * other.parts
        self.elements += times * other.elements
        self.bytes += times * other.bytes
        self.of_part += times * other.of_part


class Sizes:
    """The sizes of a model and of those that it attaches.

    roots: the XML roots of the file and of all that it includes or attaches, by resolved path.
    folders: where MuJoCo looks for files.
    """

    def __init__(self, file: Path, roots: Mapping[Path, Element], folders: set[Path]) -> None:
        self.file, self.roots, self.folders = file, roots, folders
        self.files = set(roots)  # all files that contribute to the size
        self.largest = (MOST_PARTS // 100, "")  # the largest count worth reporting, and its element
        self._known: dict[Path, Size] = {}
        self._open: list[Path] = []
        self._usual = dict.fromkeys(("width", "height", *OF_ONE), 0)  # from the defaults
        self._pixels = 0  # pixels of the largest camera
        for root in roots.values():
            for camera in root.iter("camera"):
                self._pixels = max(self._pixels, self._count(camera, "resolution"))
            for part in (part for default in root.iter("default") for part in default):
                for key in self._usual:
                    self._usual[key] = max(self._usual[key], self._count(part, key))

    def refuse(self) -> None:
        """Raise ModelTooLarge if the model is too large for MuJoCo."""
        whole = self._of(self.file.resolve())
        size = sum(path.stat().st_size for path in self.files)
        needed, allowed = whole.bytes + whole.of_part * whole.parts, most_bytes(size)
        if needed > allowed:
            raise self._refused(
                f"its numbers and pictures take {needed >> 20} MiB",
                f"{allowed >> 20} MiB may come of {size} bytes of files",
            )

    def _of(self, path: Path) -> Size:
        """Return the size of a model with what it includes and attaches."""
        if path in self._known:
            return self._known[path]
        if path in self._open:
            raise ModelTooLarge(
                f"{path.name} has itself among the models that it attaches; take it out of them"
            )
        self._open.append(path)
        found, attached = Size(), 0
        models, included = set[Path](), {path}
        waiting = [(self.roots[path], 1)]
        while waiting:
            part, times = waiting.pop()
            found.add(self._of_one(part), times)
            self._refuse_parts(found)
            if part.tag == "model":
                models |= self._named(part)
            elif part.tag == "attach":
                attached += times
            elif part.tag == "include":
                more = self._named(part) - included
                included |= more
                waiting += [(self.roots[one], times) for one in more]
            if part.tag == "replicate":
                times *= max(1, self._count(part, "count"))
            waiting += [(inner, times) for inner in part]
        inner = [self._of(model) for model in sorted(models)]
        largest = Size(*(max(getattr(one, key) for one in [*inner, Size()]) for key in vars(found)))
        found.add(largest, max(attached, 1))
        self._refuse_parts(found)
        self._open.pop()
        self._known[path] = found
        return found

    def _of_one(self, part: Element) -> Size:
        """Return what one element makes, without those within it."""
        found = Size(int(part.tag in PARTS), 1)
        for key in POINTS.get(part.tag, ()):
            found.parts += self._count(part, key, int(key == "cellcount"))
        if part.tag == "flexcomp":
            found.parts += self._points(part)
        for key, size in OF_ONE.items():
            found.bytes += size * (self._count(part, key) or self._usual[key])
        for (tag, key), size in OF_TAG.items():
            found.bytes += size * self._count(part, key) if part.tag == tag else 0
        if part.tag == "size":
            self._refuse_memory(part)
            found.parts += self._count(part, "nkey") // KEYS_OF_PART
            found.bytes += sum(size * self._count(part, key) for key, size in OF_ALL.items())
            each = [key for key in part.attrib if key.startswith("nuser_") or key == "nkey"]
            found.of_part += 8 * sum(self._count(part, key) for key in each)
        elif part.tag == "config" and part.get("key") == "size":  # the size of a grid of sensors
            found.bytes += 8 * self._count(part, "value")
        elif part.tag == "rangefinder" and "camera" in part.attrib:
            found.bytes += RAY * self._pixels
        elif part.tag == "hfield":
            found.bytes += PIXEL["hfield"] * self._count(part, "nrow") * self._count(part, "ncol")
        elif part.tag == "texture":
            width, height = (
                self._count(part, key) or self._usual[key] for key in ("width", "height")
            )
            area = width * height if part.get("type") == "2d" else SIDES * width**2
            found.bytes += PIXEL["texture"] * area
        elif part.tag == "mesh" and "builtin" in part.attrib:
            self._refuse_parameters(part)
        if part.tag in PIXEL:
            found.bytes += sum(PIXEL[part.tag] * pixels for pixels in self._pictures(part))
        return found

    def _numbers(self, part: Element, key: str) -> list[float]:
        text = part.get(key, "")
        try:
            found = [float(one) for one in text.split()]
        except ValueError:
            found = [math.nan]
        if not all(map(math.isfinite, found)):
            raise ValueError(f"the {key} of its <{part.tag}> is {text[:40]!r}, and must be numbers")
        return found

    def _count(self, part: Element, key: str, more: int = 0) -> int:
        """Return the product of an attribute's numbers, each with this many more; 0 for none."""
        numbers = self._numbers(part, key)
        product = math.prod(max(1, int(one) + more) for one in numbers) if numbers else 0
        if product > self.largest[0]:
            said = f"the {key} of its <{part.tag}> is {part.get(key, '')[:40]!r}"
            self.largest = (product, said)
        return product

    def _named(self, part: Element) -> set[Path]:
        """Return the models that an element may name."""
        name = part.get("file")
        if name is None:
            return set()
        return {(folder / name).resolve() for folder in self.folders} & self.roots.keys()

    def _files(self, part: Element) -> Iterator[Path]:
        """Yield the files that an element may name."""
        for name in (name for key, name in part.attrib.items() if key.startswith("file")):
            for path in {folder / n for folder in self.folders for n in (name, Path(name).name)}:
                if path.is_file():
                    self.files.add(path.resolve())
                    yield path

    def _points(self, part: Element) -> int:
        """Return the points of a flexcomp that no count says, at most."""
        of_files = sum(path.stat().st_size // POINT_BYTES for path in self._files(part))
        said = USUAL_POINTS if not part.attrib.keys() & {"count", "file", "point"} else 0
        return of_files + said + len(self._numbers(part, "point")) // 3

    def _pictures(self, part: Element) -> Iterator[int]:
        """Yield the pixels of the PNG files that an element may name."""
        for path in self._files(part):
            with reading(path).open("rb") as file:
                start = file.read(PNG.size)
            if start.startswith(PNG_STARTS) and len(start) == PNG.size:
                _, width, height = PNG.unpack(start)
                if width * height > self.largest[0]:
                    said = f"its {part.tag} {path.name} has {width} x {height} pixels"
                    self.largest = (width * height, said)
                yield width * height

    def _refuse_parts(self, size: Size) -> None:
        if size.parts > MOST_PARTS:
            raise self._refused(
                f"it has at least {size.parts} bodies, joints and shapes", f"{MOST_PARTS} are read"
            )
        if size.elements > MOST_ELEMENTS:
            raise self._refused(
                f"it has at least {size.elements} elements of XML", f"{MOST_ELEMENTS} are read"
            )

    def _refuse_memory(self, part: Element) -> None:
        text = part.get("memory", "-1").strip()
        if text == "-1":
            return
        if (found := MEMORY.fullmatch(text)) is None:
            raise ValueError(f"the memory of its <size> is {text[:40]!r}; give it as 64M or 1G")
        if int(found[1]) << 10 * POWERS.index(found[2].upper()) > MOST_MEMORY:
            raise ModelTooLarge(
                f"{self.file} has {text[:40]!r} for the memory of its <size>, and at most 4G are"
                " given; leave the attribute out"
            )

    def _refuse_parameters(self, part: Element) -> None:
        if any(one > MOST_PARAMETER for one in self._numbers(part, "params")):
            raise ModelTooLarge(
                f"{self.file} has {part.get('params', '')[:40]!r} for the params of a <mesh>, and"
                f" they may be up to {MOST_PARAMETER}; give the mesh fewer points"
            )

    def _refused(self, what: str, most: str) -> ModelTooLarge:
        why = f", as {self.largest[1]}" if self.largest[1] else ""
        return ModelTooLarge(
            f"{self.file} is too large for MuJoCo: {what}{why}, and at most {most}; take out what"
            " the joint does not need"
        )
