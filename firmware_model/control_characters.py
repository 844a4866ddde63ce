"""Shows control characters in texts of others: a terminal would obey an escape sequence, and write over other lines."""

from __future__ import annotations

_SHOWN = {code: f"\\x{code:02x}" for code in (*range(32), *range(127, 160)) if chr(code) not in "\n\t"}


def shown(text: str) -> str:
    """The text with each control character but the line's end and the tab as its escape in Python, as `\\x1b`."""
    return text.translate(_SHOWN)
