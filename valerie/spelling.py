"""Names that people give, spelled so that every file system, address and tool takes them."""

from __future__ import annotations

import re
import unicodedata
from hashlib import sha256
from typing import Final

#: Letters that stay recognisable in others; what is a letter with a mark (é, ç, ő) loses the mark.
_SPELLED: Final = str.maketrans(
    {
        "ä": "ae", "ö": "oe", "ü": "ue", "ß": "ss", "Ä": "Ae", "Ö": "Oe", "Ü": "Ue", "ẞ": "SS",
        "æ": "ae", "œ": "oe", "ø": "o", "Æ": "Ae", "Œ": "Oe", "Ø": "O",
        "ł": "l", "đ": "d", "ð": "d", "þ": "th", "ı": "i", "Ł": "L", "Đ": "D", "Ð": "D", "Þ": "Th",
    }
)  # fmt: skip
_MARK: Final = 6


def plain_name(text: str, *, also: str = "", longest: int | None = None) -> str:
    """A name of ASCII letters and digits; whatever stands between them becomes one hyphen.

    Letters of other scripts have no such spelling: a name that loses some ends with six hexadecimal digits of its SHA-256, so
    that two of them differ.

    Args:
        text: as it was given.
        also: punctuation that stays, except at both ends.
        longest: characters at most; None: as many as it takes.

    Returns:
        The name; empty where nothing of ``text`` is a letter or a digit.
    """
    composed = unicodedata.normalize("NFC", text)
    parts = unicodedata.normalize("NFKD", composed.translate(_SPELLED))
    spelled = "".join(part for part in parts if not unicodedata.combining(part))
    lost = any(character.isalnum() and not character.isascii() for character in spelled)
    mark = sha256(composed.encode("utf-8", "surrogatepass")).hexdigest()[:_MARK] if lost else ""
    plain = re.sub(f"[^A-Za-z0-9{re.escape(also)}]+", "-", spelled).strip("-" + also)
    room = None if longest is None else longest - len(mark) - 1 if mark else longest
    return "-".join(part for part in (plain[:room].strip("-" + also), mark) if part)


def package_name(text: str) -> str:
    """The name of a Python package as indexes spell it, so that ``My_Package`` and ``my-package`` are one."""
    return re.sub(r"[-_.]+", "-", text.strip()).lower()
