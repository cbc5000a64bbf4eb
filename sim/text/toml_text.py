"""TOML that a user wrote, read, with every complaint in one line; and values written as TOML."""

from __future__ import annotations

import tomllib
from pathlib import Path
from typing import Any

import tomlkit

from sim.bad_input import BadInput


def read(path: Path, label: str) -> dict[str, Any]:
    """A file's tables, with or without a byte-order mark; raises BadInput, which begins with `label`."""
    try:
        return tomllib.loads(path.read_text(encoding="utf-8-sig"))
    except OSError as refused:
        raise BadInput(f"{label}: cannot be read: {refused.strerror}") from None
    except ValueError as broken:  # of the encoding, the syntax, or a number with thousands of digits
        raise BadInput(f"{label}: cannot be read as TOML: {broken}") from None
    except RecursionError:
        raise BadInput(f"{label}: cannot be read as TOML: nested too deeply") from None


def is_there(path: Path) -> bool:
    """Whether there is such a file; one whose name is too long or no name at all is not there."""
    try:
        return path.is_file()
    except (OSError, ValueError):
        return False


def value(text: str) -> Any:
    """A single value; what is no TOML is text. Raises BadInput if it can be neither."""
    try:
        return tomllib.loads(f"value = {text}")["value"]
    except tomllib.TOMLDecodeError:
        return text.strip()
    except ValueError as broken:
        raise BadInput(f"{text[:40]}: cannot be read: {broken}") from None
    except RecursionError:
        raise BadInput(f"{text[:40]}: is nested too deeply") from None


def written(value: Any) -> str:
    """A value as TOML says it, in one line; raises BadInput if TOML has no word for it."""
    try:
        return _item(value).as_string()
    except (TypeError, ValueError):
        raise BadInput(f"{value!r:.80}: cannot be written as TOML; give a number, a text, a list or a dictionary") from None


def key_written(key: str) -> str:
    """A key as TOML says it, in quotes where it must be."""
    return tomlkit.item({key: 0}).as_string().rpartition("=")[0].strip()


def _item(value: Any) -> Any:
    if isinstance(value, dict):
        table = tomlkit.inline_table()
        for key, part in value.items():
            table.append(str(key), _item(part))
        return table
    if isinstance(value, list | tuple):
        array = tomlkit.array()
        for part in value:
            array.append(_item(part))
        return array
    return tomlkit.item(value.item() if hasattr(value, "item") and callable(value.item) else value)
