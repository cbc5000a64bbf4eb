"""Inputs that nobody meant: scenario files, settings, campaigns and their folders, logs and user files, each spoiled a little."""

from __future__ import annotations

import copy
import json
import random
import shutil
import tomllib
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pyarrow as pa
import pyarrow.parquet as pq

from sim.campaign.file import CAMPAIGNS
from sim.scenario.catalogue import SCENARIOS, scenario_names

Edit = tuple[Any, ...]  # (how, where, what)

LONG = "x" * 400
DEEP = "[" * 4000
WORDS = (
    "",
    " ",
    "[/red] x",
    "[bold]",
    "$\\frac{",
    "a\nb",
    "\x1b[31m",
    "../../x",
    "/",
    "nan",
    "ä ö 日本",
    LONG,
    "true",
    "loop",
    "truth",
    "_x",
    "-1",
)
NUMBERS = (
    *(0, 1, -1, 2, 3, 5, 7, 0.5, -0.5, 1e-3, 1e-9, 1e-15, 1e-300, 1e3, 1e6, 1e9, 1e15, 1e100, 1e300, -1e300),
    *(float("nan"), float("inf"), 2**31, 2**63 - 1, 2**63, 2**70, 10**30, 0.1000001, 37, 400),
)
SHAPES: tuple[Any, ...] = (
    [],
    {},
    [[]],
    [1],
    [0.0, 0.0, 0.0],
    [1, 2, 3, 4],
    ["x"],
    {"a": 1},
    {"type": "x"},
    {"kind": 3},
    {"uniform": [1, 0]},
    True,
    False,
)
FLOWN = sorted(path.stem for path in CAMPAIGNS.glob("*.toml") if "antenna" not in path.stem)  # whose identification takes a minute
QUIET = ("--without", "report", "--without", "recording")
SNIPPETS = (
    *("raise GeneratorExit", "raise SystemExit(7)", "raise BaseException('no')", "1 / 0", "import nowhere", "def f(:", "x = [" * 300),
    *("raise KeyError('[/red]')", "raise RecursionError", "raise MemoryError", "return None", "return 3", "self = None", "pass"),
    *("class E(Exception):\n  def __str__(self): raise ValueError\nraise E", "import warnings; warnings.warn('look')", "\0", "print('x')"),
)
FILTER = """{0}
import numpy as np
from estimation.gaussian import Belief, no_detection
class Mine:
    {1}
    def __init__(self, setting):
        {2}
        self.setting = setting
    def initial(self, reading):
        {3}
        zero = np.zeros(reading.shape[0])
        return type('B', (), dict(mean=np.nan_to_num(reading), covariance=None))()
    def step(self, belief, command, reading, dt):
        {4}
        return type('B', (), dict(mean=np.nan_to_num(reading) * {5}))()
"""


@dataclass(frozen=True)
class Case:
    """A spoiled input, made anew from its edits as often as is wanted, so that it can be made smaller.

    Attributes:
      kind: which builder makes it.
      base: what is spoiled.
      edits: how.
    """

    kind: str
    base: str
    edits: tuple[Edit, ...]

    def __str__(self) -> str:
        return f"{self.kind} of {self.base}: " + "; ".join(" ".join(repr(part)[:120] for part in edit) for edit in self.edits)

    def smaller(self) -> Iterator[Case]:
        """The same without one of the edits."""
        for i in range(len(self.edits)):
            yield Case(self.kind, self.base, self.edits[:i] + self.edits[i + 1 :])

    def build(self, folder: Path, sound: Path) -> list[str]:
        """Write its files into a folder; arguments of the command. `sound` holds what has been made by whole runs."""
        return BUILDERS[self.kind](self, folder, sound)


def draw(rng: random.Random) -> Case:
    """Any case."""
    kind = rng.choice(("file", "file", "set", "set", "bytes", "campaign", "folder", "log", "log", "user", "arguments"))
    if kind in ("file", "set", "bytes"):
        base = rng.choice(scenario_names())
    elif kind == "campaign":
        base = rng.choice(FLOWN)
    else:
        base = "nacs/fault-free"
    edits = tuple(_edit(kind, base, rng) for _ in range(rng.choice((1, 1, 1, 2, 3))))
    return Case(kind, base, edits)


def _edit(kind: str, base: str, rng: random.Random) -> Edit:
    if kind in ("file", "set", "campaign"):
        data = _shortened(base) if kind != "campaign" else _campaign(base)
        paths = list(_leaves(data))
        path = rng.choice(paths)
        how = rng.choice(("put", "put", "put", "scale", "drop", "rename", "add"))
        value = rng.choice((rng.choice(NUMBERS), rng.choice(WORDS), copy.deepcopy(rng.choice(SHAPES))))
        if how in ("drop", "rename") and {"run", "override", "ticks", "run.ticks"} & {path[-1]}:
            how = "put"  # a whole flight is possible, and takes its time
        if how == "scale" or kind == "set":
            how = "put"
            old = _at(data, path)
            if isinstance(old, int | float) and rng.random() < 0.6:
                value = old * rng.choice((0, -1, 1e-12, 1e-6, 1e-3, 0.1, 0.5, 2, 10, 1e3, 1e6, 1e12, 1e100))
        return (how, path, value)
    if kind in ("bytes", "folder", "log") and rng.random() < 0.6:
        return (rng.choice(("flip", "cut", "insert", "zero", "empty", "directory", "missing")), rng.random(), rng.randrange(256))
    if kind == "user":
        return ("snippet", rng.randrange(6), rng.choice(SNIPPETS))
    if kind == "log":
        return (rng.choice(("column", "metadata", "type")), rng.random(), rng.choice((*NUMBERS, *WORDS)))
    if kind == "folder":
        return ("manifest", rng.random(), copy.deepcopy(rng.choice((*SHAPES, *WORDS, *NUMBERS))))
    if kind == "bytes":
        return ("insert", rng.random(), rng.randrange(256))
    return ("argument", rng.choice(_ARGUMENTS), str(rng.choice((*NUMBERS, *WORDS))))


_ARGUMENTS = (
    *("--trials", "--seed", "--out", "--workers", "--only-trial", "--point", "--record-trials", "--observer", "--controller", "--also"),
    *("--without", "--set", "--set run.ticks=", "--set run.tick_s=", "--nothing", "NAME", "crosscheck --at", "crosscheck --trials"),
    *("crosscheck --threshold", "crosscheck --model", "replay", "replay --filter", "list", "parameters", "parameters --set", "campaign"),
    *("campaign --trials", "campaign --seed", "campaign --shard", "campaign --engine", "view --loop", "crosscheck --loop"),
)


def _shortened(name: str) -> dict[str, Any]:
    """A shipped scenario, some ticks of one trial."""
    data = tomllib.loads((SCENARIOS / f"{name}.toml").read_text(encoding="utf-8"))
    data["run"] |= {"ticks": 4, "trials": 1}
    data.pop("phases", None)
    data["faults"] = []
    if "loops" in data:
        data["loops"] = dict(list(data["loops"].items())[:2])
        data.pop("identification", None)
    return data


def _campaign(name: str) -> dict[str, Any]:
    data = tomllib.loads((CAMPAIGNS / f"{name}.toml").read_text(encoding="utf-8"))
    data |= {"trials": 2, "shard": 1}
    data.setdefault("override", {}).update({"run.ticks": 4, "faults": [], "phases": {}})
    for section in ("grid", "dispersion"):
        data[section] = {key: value for key, value in data.get(section, {}).items() if not key.startswith(("faults", "phases"))}
    data["grid"] = {key: value[:2] for key, value in data["grid"].items()}
    return data


def _leaves(node: Any, path: tuple[Any, ...] = ()) -> Iterator[tuple[Any, ...]]:
    """Paths to everything below a node, tables and lists too."""
    inside = node.items() if isinstance(node, dict) else enumerate(node) if isinstance(node, list) else ()
    for key, value in inside:
        yield (*path, key)
        yield from _leaves(value, (*path, key))


def _at(node: Any, path: tuple[Any, ...]) -> Any:
    for part in path:
        node = node[part]
    return node


def _spoiled(data: dict[str, Any], edits: tuple[Edit, ...]) -> dict[str, Any]:
    """A file's tables after the edits; those whose place an earlier one has removed do nothing."""
    data = copy.deepcopy(data)
    for how, path, value in edits:
        try:
            node = _at(data, path[:-1])
            if how == "put":
                node[path[-1]] = value
            elif how == "drop":
                del node[path[-1]]
            elif how == "rename" and isinstance(node, dict):
                node[str(value) or "x"] = node.pop(path[-1])
            elif how == "add" and isinstance(node, dict):
                node[f"{path[-1]}x"] = value
        except (KeyError, IndexError, TypeError, AttributeError):
            continue
    return data


def toml(value: Any) -> str:
    """A value in TOML, tables inline."""
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, dict):
        return "{" + ", ".join(f"{json.dumps(str(k))} = {toml(v)}" for k, v in value.items()) + "}"
    if isinstance(value, list):
        return "[" + ", ".join(map(toml, value)) + "]"
    return repr(value) if isinstance(value, int | float) else json.dumps(value, ensure_ascii=False).replace("\x7f", "\\u007f")


def _text(data: dict[str, Any]) -> str:
    return "".join(f"{json.dumps(str(key))} = {toml(value)}\n" for key, value in data.items())


def _file(case: Case, folder: Path, sound: Path) -> list[str]:
    (folder / "mine.toml").write_text(_text(_spoiled(_shortened(case.base), case.edits)), encoding="utf-8")
    return ["run", "mine.toml", "--out", "o", *QUIET]


def _set(case: Case, folder: Path, sound: Path) -> list[str]:
    (folder / "mine.toml").write_text(_text(_shortened(case.base)), encoding="utf-8")
    settings = [("--set", f"{'.'.join(map(str, path))}={toml(value)}") for _, path, value in case.edits]
    return ["run", "mine.toml", "--out", "o", *(word for pair in settings for word in pair), *(QUIET if len(case.base) % 4 else ())]


def _campaign_file(case: Case, folder: Path, sound: Path) -> list[str]:
    (folder / "mine.toml").write_text(_text(_spoiled(_campaign(case.base), case.edits)), encoding="utf-8")
    return ["campaign", "mine.toml", "--out", "o", "--workers", "1"]


def _damage(content: bytes, edits: tuple[Edit, ...]) -> bytes:
    for how, share, value in edits:
        place = int(share * len(content))
        if how == "flip" and content:
            content = content[:place] + bytes([content[place] ^ (1 << value % 8)]) + content[place + 1 :]
        elif how == "cut":
            content = content[:place]
        elif how == "insert":
            content = content[:place] + bytes([value]) + content[place:]
        elif how == "zero":
            content = content[:place] + bytes(min(64, len(content) - place)) + content[place + 64 :]
        elif how == "empty":
            content = b""
    return content


def _bytes(case: Case, folder: Path, sound: Path) -> list[str]:
    content = _text(_shortened(case.base)).encode()
    (folder / "mine.toml").write_bytes(_damage(content, case.edits))
    return ["run", "mine.toml", "--out", "o", *QUIET]


def _damage_in_place(path: Path, edit: Edit) -> None:
    how = edit[0]
    if how in ("directory", "missing"):
        if path.is_file():
            path.unlink()
        if how == "directory":
            path.mkdir(exist_ok=True)
    elif path.is_file():
        path.write_bytes(_damage(path.read_bytes(), (edit,)))


def _log(case: Case, folder: Path, sound: Path) -> list[str]:
    path = folder / "log.parquet"
    table = pq.read_table(sound / "log.parquet")
    for how, share, value in case.edits:
        name = table.column_names[int(share * len(table.column_names))] if table.num_columns else ""
        place = table.schema.get_field_index(name)
        if how == "column" and place >= 0:
            column = pa.array([value] * len(table)) if not isinstance(value, int) or abs(value) < 2**63 else pa.array([0] * len(table))
            table = table.set_column(place, name, column)
        elif how == "type" and place >= 0:
            table = table.remove_column(place)
        elif how == "metadata":
            about = json.loads(table.schema.metadata[b"nacs"]) if b"nacs" in (table.schema.metadata or {}) else {}
            flat = list(_leaves(about)) or [("x",)]
            about = _spoiled(about, (("put", flat[int(share * len(flat))], value),))
            table = table.replace_schema_metadata({b"nacs": json.dumps(about).encode()})
    pq.write_table(table, path)
    for edit in case.edits:
        if edit[0] in ("flip", "cut", "insert", "zero", "empty", "directory", "missing"):
            _damage_in_place(path, edit)
    return ["replay", "log.parquet", "--out", "o"]


def _folder(case: Case, folder: Path, sound: Path) -> list[str]:
    shutil.copytree(sound / "campaign", folder / "o")
    shutil.copy(sound / "campaign.toml", folder / "campaign.toml")
    for edit in case.edits:
        if edit[0] == "manifest":
            path = folder / "o" / "manifest.json"
            about = _json(path)
            flat = list(_leaves(about)) if isinstance(about, dict) else []
            where = flat[int(edit[1] * len(flat))] if flat and edit[1] < 0.8 else None
            if path.is_file():
                path.write_text(json.dumps(edit[2] if where is None else _spoiled(about, (("put", where, edit[2]),))))
        else:
            files = sorted(path for path in (folder / "o").rglob("*") if path.is_file())
            _damage_in_place(files[int(edit[1] * 997) % len(files)], edit)
    return ["campaign", "campaign.toml", "--out", "o", "--workers", "1", "--resume"]


def _json(path: Path) -> Any:
    """What a file holds; nothing if an earlier edit has spoiled it."""
    try:
        return json.loads(path.read_text())
    except (OSError, ValueError):
        return {}


def _user(case: Case, folder: Path, sound: Path) -> list[str]:
    slots = ["", "", "pass", "pass", "pass", "1.0"]
    for _, slot, snippet in case.edits:
        indent = "" if slot == 0 else "    " if slot == 1 else "        "
        slots[slot] = snippet.replace("\n", f"\n{indent}") if slot < 5 else "np.nan"
    (folder / "mine.py").write_text(FILTER.format(*slots), encoding="utf-8")
    return ["run", case.base, "--observer", "mine.py:Mine", "--set", "run.ticks=4", "--trials", "1", "--out", "o", *QUIET]


def _arguments(case: Case, folder: Path, sound: Path) -> list[str]:
    shutil.copy(sound / "campaign.toml", folder / "campaign.toml")
    words = ["run", case.base, "--set", "run.ticks=4", "--trials", "1", *QUIET]
    for _, option, value in case.edits:
        first, _, rest = option.partition(" ")
        if option == "NAME":
            words[1] = value
        elif option.startswith("--set "):
            words += ["--set", rest + value]
        elif option.startswith("--"):
            words += [option, value]
        else:
            target = {
                "crosscheck": [case.base, "--set", "run.ticks=12"],
                "view": [case.base],
                "campaign": ["campaign.toml"] if rest else [],
            }.get(first, [])
            words = [first, *target, *([rest] if rest else []), value]
    return words


BUILDERS: dict[str, Callable[[Case, Path, Path], list[str]]] = {
    "file": _file,
    "set": _set,
    "bytes": _bytes,
    "campaign": _campaign_file,
    "folder": _folder,
    "log": _log,
    "user": _user,
    "arguments": _arguments,
}
