"""Reports as self-contained HTML pages: one style, pictures inside."""

import base64
from typing import Any


def page(template: str, filters: dict[str, Any], **values: Any) -> str:
    """Return a template of this package, filled in; it includes `report_style.css`.

    template: path inside `zwidth/`; filters: name -> function, for this page.
    """
    from jinja2 import Environment, PackageLoader, StrictUndefined  # loaded only to write a page

    environment = Environment(
        loader=PackageLoader("zwidth", "."),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.filters.update(filters)
    # A unit stays on the same line as its number.
    return environment.get_template(template).render(**values).replace(" %", "\u00a0%")


def embedded(svg: bytes) -> str:
    """Return a picture as a data URL."""
    return "data:image/svg+xml;base64," + base64.b64encode(svg).decode()
