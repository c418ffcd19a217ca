"""Links from the documentation to files that are not pages become plain text on the site."""

import re
from pathlib import PurePosixPath
from typing import Any

LINK = re.compile(r"(?<!!)\[([^\]]+)\]\(([^)#\s]+)(#[^)\s]*)?\)")


def on_page_markdown(markdown: str, page: Any, **_: Any) -> str:
    """Return a page whose links out of the documentation, and to sources, are plain text."""
    folder = PurePosixPath(page.file.src_uri).parent

    def within(match: re.Match[str]) -> str:
        words, target = match[1], match[2]
        if "://" in target or target.startswith("mailto:"):
            return match[0]
        depth = 0
        for part in (folder / target).parts:
            depth += -1 if part == ".." else 1
            if depth < 0:
                return f"{words} (`{PurePosixPath(target).name}` in the repository)"
        return words if target.endswith((".py", ".ipynb")) else match[0]

    return LINK.sub(within, markdown)
