"""Scenario files that extend others: a base's content, over which the file's own keys are laid."""

from __future__ import annotations

import difflib
from pathlib import Path
from typing import Any

from sim.bad_input import BadInput
from sim.scenario.catalogue import SCENARIOS, scenario_names
from sim.text import toml_text

KEY = "extends"
KINDS = ("type", "kind")  # keys that say which settings a table has
DEEPEST = 20  # files, one extending the other


def find(name: str, folder: Path | None = None) -> Path:
    """File of a scenario by name or path, relative paths being from a folder; raises BadInput if there is none."""
    path = (folder or Path()) / name if name.endswith(".toml") else SCENARIOS / f"{name}.toml"
    if toml_text.is_there(path):
        return path
    if name.endswith(".toml"):
        raise BadInput(f"no scenario file {name if folder is None else path}")
    near = difflib.get_close_matches(name, scenario_names(), n=1)
    hint = f"did you mean {near[0]}?" if near else "`nacs list` shows what there is"
    raise BadInput(f"no scenario {name!r}; {hint}")


def read(path: Path, label: str) -> dict[str, Any]:
    """A file's tables over those of the file that it extends; raises BadInput, which begins with `label`."""
    return extended(toml_text.read(path, label), label, path.parent, (path,))


def extended(data: dict[str, Any], label: str, folder: Path | None = None, above: tuple[Path, ...] = ()) -> dict[str, Any]:
    """Tables over those of the file that they extend; without the key `extends` as they are.

    Args:
      data: a file's tables.
      label: of the file, for complaints.
      folder: that a path of a base is relative to; None: the working folder.
      above: files that extend each other down to this one.

    Raises:
      BadInput: there is no such base, it cannot be read, or it extends this file again.
    """
    if KEY not in data:
        return data
    name = data[KEY]
    if not isinstance(name, str) or not name.strip():
        raise BadInput(f"{label}: {KEY}: must be the name of a scenario, or the path of a file that ends with .toml")
    try:
        base = find(name, folder)
    except BadInput as absent:
        raise BadInput(f"{label}: {KEY}: {absent}") from None
    chain = (*above, base)
    if base.resolve() in {path.resolve() for path in above}:
        raise BadInput(f"{label}: {KEY}: goes in a circle: {' -> '.join(str(path) for path in chain)}")
    if len(chain) > DEEPEST:
        raise BadInput(f"{label}: {KEY}: more than {DEEPEST} files extend each other")
    below = extended(toml_text.read(base, f"{label}: {KEY}: {name}"), f"{label}: {KEY}: {name}", base.parent, chain)
    return laid_over(below, {key: value for key, value in data.items() if key != KEY})


def laid_over(base: dict[str, Any], own: dict[str, Any]) -> dict[str, Any]:
    """Tables merged key by key, what is no table taken from `own`; a table of another type or kind is taken as a whole."""
    merged = dict(base)
    for key, value in own.items():
        there = base.get(key)
        merged[key] = laid_over(there, value) if isinstance(there, dict) and isinstance(value, dict) and _alike(there, value) else value
    return merged


def _alike(base: dict[str, Any], own: dict[str, Any]) -> bool:
    """Whether two tables are of one type and kind, as far as the second says."""
    return all(key not in own or key not in base or own[key] == base[key] for key in KINDS)
