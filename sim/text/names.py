"""Names that a user gives: files, tables, pictures, recordings and paths say them."""

from __future__ import annotations

LONGEST_NAME = 60
WHAT_A_NAME_IS = f"it must have 1 to {LONGEST_NAME} printable characters, without quotes / $ @, and not begin with _"


def is_a_name(name: str) -> bool:
    """Whether an observer, a loop or a window of time can be called so."""
    return bool(name.strip()) and len(name) <= LONGEST_NAME and name.isprintable() and not set(name) & set("/$@\"'") and name[0] != "_"
