"""Whether `models`, `estimation`, `control` and `sim` are the twin's: others have packages of these names too, such as python-control."""

from __future__ import annotations

import re
from importlib.util import find_spec
from pathlib import Path

DISTRIBUTION = "nacs-twin"
NAMES = ("models", "estimation", "control", "sim", "nacs")
ROOT = Path(__file__).resolve().parents[1]  # where the twin's packages lie side by side
WAY_OUT = f"{DISTRIBUTION} needs an environment of its own: `pipx install {DISTRIBUTION}`, `uv tool install {DISTRIBUTION}`, or a new venv"


def what_is_foreign() -> str | None:
    """One line about a package that is not, or not only, the twin's; None: all are its own."""
    return misplaced() or shared()


def misplaced() -> str | None:
    """The same of a package that Python finds elsewhere than beside this one; nothing of the packages is imported."""
    for name in NAMES:
        if (place := _place(name)) != ROOT / name / "__init__.py":
            return f"the package `{name}` that Python finds is not the twin's but {place or 'nowhere'}; {WAY_OUT}"
    return None


def shared() -> str | None:
    """The same of a package into which another distribution was installed, before the twin or after it."""
    owners = _owners()
    name = next((name for name in NAMES if name in owners), None)
    if name is None:
        return None
    return f"the distribution {owners[name]} has a package `{name}` too, and one has spoilt the other in {ROOT / name}; {WAY_OUT}"


def _place(name: str) -> Path | None:
    """The file that an import of the name would run, or its folder if there is none."""
    try:
        spec = find_spec(name)
    except (ImportError, ValueError):  # it was put into sys.modules by hand
        return None
    if spec is None:
        return None
    if spec.origin is not None:
        return Path(spec.origin).resolve()
    return next((Path(folder).resolve() for folder in spec.submodule_search_locations or ()), None)


def _owners() -> dict[str, str]:
    """Of the names, those that another distribution installed beside the twin's packages, and which that is."""
    from importlib.metadata import distributions  # noqa: PLC0415  # it takes as long as all else here

    wanted = re.compile(rf"^({'|'.join(NAMES)})/__init__\.py,", re.MULTILINE)
    owners: dict[str, str] = {}
    for one in distributions():
        listed = one.read_text("RECORD")
        found = wanted.findall(listed) if listed else ()
        if found and Path(str(one.locate_file(""))).resolve() == ROOT and (name := one.metadata["Name"]) != DISTRIBUTION:
            owners |= dict.fromkeys(found, name)
    return owners
