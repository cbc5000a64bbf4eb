"""The house as its rules see it: modules, their rooms, and who imports whom, read off the source.

A house can be made of any tree of files, so that the rules can be tried on made-up ones.
"""

from __future__ import annotations

import ast
import subprocess
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from functools import cached_property
from graphlib import CycleError, TopologicalSorter
from pathlib import Path
from typing import NamedTuple

ROOT = Path(__file__).resolve().parents[1]

# What each floor stands on; estimation and control stand beside each other.
FLOORS = {
    "models": (),
    "estimation": ("models",),
    "control": ("models",),
    "sim": ("models", "estimation", "control"),
    "nacs_twin": ("sim",),  # what is loaded first
    "nacs": ("models", "estimation", "control", "sim", "nacs_twin"),
}
# Rooms from the ground up; `ground` are the modules that lie directly in the floor's folder. A room imports from rooms before it only.
ROOMS = {
    "nacs_twin": ("ground", "entry"),
    "models": ("ground", "attitude", "dynamics", "plants"),
    "sim": (
        *(
            "ground",
            "text",
            "faults",
            "plant",
            "sensors",
            "network",
            "estimators",
            "controllers",
            "user_code",
            "scenario",
            "loop",
            "linear",
            "fmu",
            "metrics",
        ),
        *("series", "replay", "convert", "campaign", "crosscheck", "tables", "report", "rerun", "outputs", "export", "cli"),
    ),
}
ORDER = [f"{floor}.{room}" if room else floor for floor in FLOORS for room in ROOMS.get(floor, ("",))]


class Import(NamedTuple):
    """One import: anywhere in a file, also in a function or for type checking only."""

    line: int
    name: str
    relative: bool = False


@dataclass(frozen=True, eq=False)
class Module:
    """A Python file of a floor; it is parsed once."""

    root: Path
    path: Path

    @cached_property
    def place(self) -> str:
        return self.path.relative_to(self.root).as_posix()

    @cached_property
    def is_package(self) -> bool:
        return self.path.name == "__init__.py"

    @cached_property
    def name(self) -> str:
        """As it is imported."""
        parts = self.path.relative_to(self.root).with_suffix("").parts
        return ".".join(parts[:-1] if self.is_package else parts)

    @cached_property
    def floor(self) -> str:
        return self.path.relative_to(self.root).parts[0]

    @cached_property
    def room(self) -> str:
        """Floor and room, as in ORDER, whether it has a place there or not; a floor without rooms is one room."""
        if self.floor not in ROOMS:
            return self.floor
        parts = self.path.relative_to(self.root).parts
        return f"{self.floor}.{parts[1] if len(parts) > 2 else 'ground'}"

    @cached_property
    def tree(self) -> ast.Module:
        return ast.parse(self.path.read_text(encoding="utf-8"))

    @cached_property
    def nodes(self) -> list[ast.AST]:
        return list(ast.walk(self.tree))

    @cached_property
    def imports(self) -> list[Import]:
        """All names that are imported, `from a import b` as a.b."""
        return [found for node in self.nodes for found in self._imported(node)]

    def _imported(self, node: ast.AST) -> Iterator[Import]:
        if isinstance(node, ast.Import):
            yield from (Import(node.lineno, alias.name) for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            package = self.name.split(".") if self.is_package else self.name.split(".")[:-1]
            start = package[: len(package) + 1 - node.level] if node.level else []
            source = ".".join([*start, *([node.module] if node.module else [])])
            yield from (Import(node.lineno, f"{source}.{alias.name}", node.level > 0) for alias in node.names)
        elif isinstance(node, ast.Call) and getattr(node.func, "attr", getattr(node.func, "id", "")) in {"import_module", "__import__"}:
            literal = node.args[0] if node.args else None
            yield Import(node.lineno, literal.value if isinstance(literal, ast.Constant) and isinstance(literal.value, str) else "?")

    @cached_property
    def roots(self) -> set[str]:
        """Top-level packages that it imports."""
        return {one.name.split(".")[0] for one in self.imports}


class Arrow(NamedTuple):
    """One module of the house imports another."""

    importer: Module
    imported: Module
    line: int

    def __str__(self) -> str:
        return f"{self.importer.place}:{self.line} imports {self.imported.name} ({self.importer.room} -> {self.imported.room})"


class House:
    """All modules of the floors that lie among some files."""

    def __init__(self, root: Path, paths: Iterable[Path]) -> None:
        inside = (path for path in paths if path.suffix == ".py" and path.relative_to(root).parts[0] in FLOORS)
        self.modules = [Module(root, path) for path in sorted(inside)]
        self.named = {module.name: module for module in self.modules}

    @classmethod
    def in_folder(cls, root: Path) -> House:
        """Of everything that lies in a folder."""
        return cls(root, (path for path in root.rglob("*.py") if "__pycache__" not in path.parts))

    @cached_property
    def arrows(self) -> list[Arrow]:
        """Who imports whom; a name that a module defines leads to that module."""
        found = []
        for module in self.modules:
            for line, name, _ in module.imports:
                known = next((at for at in _outwards(name) if at in self.named), None)
                if known is not None:
                    found.append(Arrow(module, self.named[known], line))
        return found

    @cached_property
    def rooms(self) -> dict[str, list[Module]]:
        found: dict[str, list[Module]] = {}
        for module in self.modules:
            found.setdefault(module.room, []).append(module)
        return found

    def graph_of_modules(self) -> dict[str, set[str]]:
        graph: dict[str, set[str]] = {module.name: set() for module in self.modules}
        for arrow in self.arrows:
            graph[arrow.importer.name].add(arrow.imported.name)
        return graph

    def graph_of_rooms(self) -> dict[str, set[str]]:
        graph: dict[str, set[str]] = {room: set() for room in self.rooms}
        for arrow in self.arrows:
            if arrow.importer.room != arrow.imported.room:
                graph[arrow.importer.room].add(arrow.imported.room)
        return graph


def _outwards(name: str) -> Iterator[str]:
    """`a.b.c`, `a.b`, `a`."""
    parts = name.split(".")
    return (".".join(parts[:count]) for count in range(len(parts), 0, -1))


def circles(graph: dict[str, set[str]]) -> list[list[str]]:
    """Circles, one after another: each is opened before the next is looked for."""
    graph = {node: set(below) for node, below in graph.items()}
    found = []
    while True:
        try:
            tuple(TopologicalSorter(graph).static_order())
        except CycleError as circle:
            around = circle.args[1][::-1]  # importer first
            found.append(around)
            graph[around[0]].discard(around[1])
        else:
            return found


def storeys(graph: dict[str, set[str]]) -> dict[str, int]:
    """How many nodes the longest chain of imports that ends at each has; raises CycleError."""
    level: dict[str, int] = {}
    for node in TopologicalSorter(graph).static_order():
        level[node] = 1 + max((level[below] for below in graph[node]), default=0)
    return level


def repository_files(root: Path = ROOT) -> list[Path]:
    """Everything that is, or would be, in the repository; without git, whatever lies in the house's folders."""
    listing = ["git", "-C", str(root), "ls-files", "--cached", "--others", "--exclude-standard", "-z"]
    try:
        names = subprocess.run(listing, capture_output=True, check=True).stdout.decode().split("\0")
        return [root / name for name in names if name and (root / name).is_file()]
    except (OSError, subprocess.CalledProcessError):
        folders = (*FLOORS, "tests", "docs", "benchmarks")
        return [path for folder in folders for path in (root / folder).rglob("*") if path.is_file() and "__pycache__" not in path.parts]
