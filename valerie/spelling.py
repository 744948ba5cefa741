"""Spell names so that every file system, URL and tool accepts them."""

from __future__ import annotations

import re
import unicodedata
from hashlib import sha256
from typing import Final

#: Spellings of letters in ASCII. Letters with a mark (é, ç, ő) lose the mark instead.
_SPELLED: Final = str.maketrans(
    {
        "ä": "ae", "ö": "oe", "ü": "ue", "ß": "ss", "Ä": "Ae", "Ö": "Oe", "Ü": "Ue", "ẞ": "SS",
        "æ": "ae", "œ": "oe", "ø": "o", "Æ": "Ae", "Œ": "Oe", "Ø": "O",
        "ł": "l", "đ": "d", "ð": "d", "þ": "th", "ı": "i", "Ł": "L", "Đ": "D", "Ð": "D", "Þ": "Th",
    }
)  # fmt: skip
_MARK: Final = 6


def plain_name(text: str, *, also: str = "", longest: int | None = None) -> str:
    """Return a name of ASCII letters and digits. Other characters between them become one hyphen.

    Letters of other scripts are dropped. A name that loses letters ends with six hexadecimal digits of its SHA-256, so that
    different names stay different.

    Args:
        also: punctuation to keep, except at both ends.
        longest: largest number of characters; None for no limit.

    Returns:
        The spelled name; empty if ``text`` has no letter or digit.
    """
    composed = unicodedata.normalize("NFC", text)
    parts = unicodedata.normalize("NFKD", composed.translate(_SPELLED))
    spelled = "".join(part for part in parts if not unicodedata.combining(part))
    loses_letters = any(character.isalnum() and not character.isascii() for character in spelled)
    mark = sha256(composed.encode("utf-8", "surrogatepass")).hexdigest()[:_MARK] if loses_letters else ""
    plain = re.sub(f"[^A-Za-z0-9{re.escape(also)}]+", "-", spelled).strip("-" + also)
    room = None if longest is None else longest - len(mark) - 1 if mark else longest
    return "-".join(part for part in (plain[:room].strip("-" + also), mark) if part)


def package_name(text: str) -> str:
    """Return the normalized name of a Python package, the same for ``My_Package`` and ``my-package``."""
    return re.sub(r"[-_.]+", "-", text.strip()).lower()
