"""HTML from Python without surprises: plain text is always escaped, only `Html` is markup."""

from __future__ import annotations

import base64
from collections.abc import Iterable
from html import escape
from typing import Final


class Html(str):
    """Text that is markup already."""

    __slots__ = ()


Content = str | Html | Iterable["str | Html"] | None
_VOID: Final = frozenset({"img", "br", "hr", "meta", "link", "col"})


def tag(name: str, /, *content: Content, **attributes: str | float | bool | None) -> Html:
    """One element: ``tag("td", "a < b", class_="number")``.

    Plain text is escaped, `Html` stays as it is, iterables may hold both, None is nothing. ``class_`` is ``class``,
    ``aria_label`` is ``aria-label``; an attribute that is None or False is left out, one that is True is bare.
    """
    written = "".join(
        _attribute(key, value) for key, value in attributes.items() if value is not None and value is not False
    )
    if name in _VOID:
        return Html(f"<{name}{written}>")
    return Html(f"<{name}{written}>{join(*content)}</{name}>")


def join(*content: Content) -> Html:
    """Contents one after another."""
    parts: list[str] = []
    for item in content:
        if isinstance(item, Html):
            parts.append(item)
        elif isinstance(item, str):
            parts.append(escape(item.replace(" %", "\u00a0%"), quote=False))  # no line break before the sign
        elif item is not None:
            parts.append(join(*item))
    return Html("".join(parts))


def data_url(data: bytes) -> str:
    """A picture file as a data URL; the type is read from its first bytes (PNG, JPEG, WebP)."""
    if data.startswith(b"\x89PNG"):
        kind = "png"
    elif data.startswith(b"RIFF") and data[8:12] == b"WEBP":
        kind = "webp"
    else:
        kind = "jpeg"
    return f"data:image/{kind};base64,{base64.b64encode(data).decode('ascii')}"


def _attribute(key: str, value: str | float | bool) -> str:
    name = key.rstrip("_").replace("_", "-")
    return f" {name}" if value is True else f' {name}="{escape(str(value), quote=True)}"'
