"""The files of a picture, by name: known before matplotlib is loaded and anything is drawn."""

from pathlib import Path

KINDS = ("png", "svg")


def picture_files(stem: Path) -> list[Path]:
    """Return STEM.png and STEM.svg; a dot in STEM begins no suffix."""
    return [stem.with_name(f"{stem.name}.{kind}") for kind in KINDS]
