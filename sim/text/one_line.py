"""Any text as one line that a terminal can be given."""

from __future__ import annotations

LONGEST = 1000  # characters; what a person wrote can be a book


def one_line(text: str, longest: int = LONGEST) -> str:
    """The text without line breaks and control characters, its middle left out if it is longer."""
    flat = " ".join("".join(c if c.isprintable() else " " for c in text).split(" "))
    half = (longest - 5) // 2
    return flat if len(flat) <= longest else f"{flat[:half]} ... {flat[-half:]}"
