"""Output in encodings with few characters, such as ASCII: hdplan's own characters are spelt out, and those of names are
escaped. Nothing is lost, and nothing fails."""

from __future__ import annotations

import codecs

WRITTEN = {
    **{"²": "^2", "³": "^3", "½": "1/2", "°": "deg", "µ": "u", "μ": "u", "±": "+-", "×": "x", "·": ".", "−": "-"},
    **{"–": "-", "—": "-", "…": "...", "’": "'", "→": "->", "≤": "<=", "≥": ">=", "≈": "~", "█": "#", "▏": "|"},
}


def register() -> str:
    """Register what stands for a character that an encoding does not have, as a handler of errors; return its name."""
    codecs.register_error("hdplan", _plainly)
    return "hdplan"


def _plainly(error: UnicodeError) -> tuple[str, int]:
    if not isinstance(error, UnicodeEncodeError):
        raise error
    lacking = error.object[error.start : error.end]
    plain = (WRITTEN.get(each) or each.encode("ascii", "backslashreplace").decode() for each in lacking)
    return "".join(plain), error.end
