"""The rules of the house: `python -m tests.house_rules` says what breaks one, and which places rules to come would find.

Each rule takes a house and returns what breaks it, a line each.
"""

from __future__ import annotations

import ast
import re
from collections import Counter
from collections.abc import Callable, Iterable
from functools import lru_cache
from pathlib import Path, PurePosixPath

from tests.house import FLOORS, ORDER, ROOMS, ROOT, House, circles, repository_files, storeys

LARGEST_ROOM = 15  # modules besides __init__.py, sub-folders counted apart; of floors that have rooms
LARGEST_GROUND = 10  # modules directly in sim/
MOST_STOREYS = 15  # rooms and packages in the longest chain of imports: fourteen, and the public face on top
VAGUE = {"util", "utils", "helper", "helpers", "common", "misc", "base", "core"}
NOT_FOR_THE_HOUSE = {"tests", "benchmarks", "pytest", "hypothesis", "filterpy", "stonesoup"}
CLOSED_LOOP = "sim/loop/closed_loop.py"
DISCOVERY = ("models/plants/register/entries.py", "sim/outputs/register.py")  # import by name what they find, so that no list names it
LEGAL_RANDOM = {"Generator", "PCG64", "SeedSequence"}
MANY = re.compile(r"\b(n_?)?(trials?|particles?|agents?|nsim)\b|sigma_points", re.IGNORECASE)
STATE_SLICES = {(0, 4), (4, 7), (7, None), (0, 7)}  # attitude, rate, wheels or whatever follows, attitude and rate

Rule = Callable[[House], list[str]]


# ---- who imports whom


def floors_import_down(house: House) -> list[str]:
    """A floor imports itself and those it stands on; estimation and control do not import each other."""
    return [str(arrow) for arrow in house.arrows if arrow.imported.floor not in (arrow.importer.floor, *FLOORS[arrow.importer.floor])]


def rooms_have_a_place(house: House) -> list[str]:
    """Every room stands in the written order."""
    return [f"{members[0].place}: {room} has no place in tests/house.py" for room, members in house.rooms.items() if room not in ORDER]


def rooms_import_down(house: House) -> list[str]:
    """A room imports itself and rooms before it in the written order."""
    rank = {room: place for place, room in enumerate(ORDER)}
    placed = [arrow for arrow in house.arrows if arrow.importer.room in rank and arrow.imported.room in rank]
    return [str(arrow) for arrow in placed if rank[arrow.imported.room] > rank[arrow.importer.room]]


def no_circle_among_rooms(house: House) -> list[str]:
    """Rooms do not import in a circle."""
    return [" -> ".join(circle) for circle in circles(house.graph_of_rooms())]


def no_circle_among_modules(house: House) -> list[str]:
    """Modules do not import in a circle, not even for type checking."""
    return [" -> ".join(circle) for circle in circles(house.graph_of_modules())]


def few_storeys(house: House) -> list[str]:
    """The longest chain of rooms that import each other is short."""
    graph = house.graph_of_rooms()
    if circles(graph):
        return ["a circle has no top; see the rule of circles"]
    level = storeys(graph)
    chain = [max(level, key=lambda room: level[room])] if level else []
    while chain and graph[chain[-1]]:
        chain.append(max(graph[chain[-1]], key=lambda room: level[room]))
    return [f"{len(chain)} storeys: " + " -> ".join(chain)] if len(chain) > MOST_STOREYS else []


def imports_are_absolute_and_literal(house: House) -> list[str]:
    """No import hides where it leads to, but those of registers that find their entries."""
    found = [(module, one) for module in house.modules if module.place not in DISCOVERY for one in module.imports]
    return [f"{module.place}:{one.line}: {one.name}" for module, one in found if one.relative or one.name == "?"]


def nothing_depends_on_tests(house: House) -> list[str]:
    """The floors use nothing that only tests and benchmarks need."""
    return [f"{m.place} imports {name}" for m in house.modules for name in sorted(m.roots & NOT_FOR_THE_HOUSE)]


def mujoco_stays_in_its_rooms(house: House) -> list[str]:
    """MuJoCo is imported where models are compiled, stepped and looked at."""
    rooms, viewer = {"models.plants", "sim.plant"}, "sim/cli/commands/viewer.py"
    return [m.place for m in house.modules if "mujoco" in m.roots and m.room not in rooms and m.place != viewer]


def rerun_stays_in_its_room(house: House) -> list[str]:
    """Rerun is imported in its room only."""
    return [m.place for m in house.modules if "rerun" in m.roots and m.room != "sim.rerun"]


# ---- sizes and names


def rooms_are_small(house: House) -> list[str]:
    """A folder holds few modules; those of floors without rooms are not counted."""
    count = Counter(PurePosixPath(m.place).parent.as_posix() for m in house.modules if m.floor in ROOMS and not m.is_package)
    limit = {"sim": LARGEST_GROUND}
    return [f"{folder}/: {size} modules" for folder, size in sorted(count.items()) if size > limit.get(folder, LARGEST_ROOM)]


def every_folder_is_a_package(house: House) -> list[str]:
    """A folder with modules has an __init__.py, or it would not be installed."""
    folders = {module.path.parent for module in house.modules}
    return sorted(folder.name for folder in folders if not (folder / "__init__.py").is_file())


def names_say_something(house: House) -> list[str]:
    """A file and a folder are named for their concept."""
    return [
        m.place
        for m in house.modules
        if VAGUE & {word for part in PurePosixPath(m.place).with_suffix("").parts for word in part.split("_")}
    ]


def modules_say_what_they_are(house: House) -> list[str]:
    """Every module and package has a docstring whose first line is a whole sentence, or announces what follows."""
    said = ((module, ast.get_docstring(module.tree)) for module in house.modules)
    return [module.place for module, text in said if not text or not text.splitlines()[0].endswith((".", "?", ":"))]


# ---- loops and random numbers


def no_loop_by_number(house: House) -> list[str]:
    """No `for _ in range(...)` over what should be a leading axis: trials, particles, agents, sigma points."""
    found = []
    for module in house.modules:
        for node in module.nodes:
            if isinstance(node, ast.For | ast.comprehension) and _is_range(node.iter) and MANY.search(ast.unparse(node.iter)):
                found.append(f"{module.place}:{node.iter.lineno}: {ast.unparse(node.iter)}")
    return found


def _is_range(node: ast.AST) -> bool:
    return isinstance(node, ast.Call) and isinstance(node.func, ast.Name) and node.func.id == "range"


def loops_over_ticks(house: House) -> list[str]:
    """Where the rooms loop and replay go through ticks: a `for` over range(... ticks ...), or a `while` that asks for a tick."""
    found = []
    for module in house.modules:
        for node in module.nodes if module.room in {"sim.loop", "sim.replay"} else ():
            over = node.iter if isinstance(node, ast.For) and _is_range(node.iter) else node.test if isinstance(node, ast.While) else None
            if over is not None and "tick" in ast.unparse(over):
                found.append(f"{module.place}:{over.lineno}")
    return found


def loops_that_are_closed(house: House) -> list[str]:
    """Where, in any room, a loop's own lines ask a law to `decide` and make a plant `advance`."""
    found = []
    for module in house.modules:
        for node in module.nodes:
            if isinstance(node, ast.For | ast.While):
                called = {call.func.attr for call in ast.walk(node) if isinstance(call, ast.Call) and isinstance(call.func, ast.Attribute)}
                if {"decide", "advance"} <= called:
                    found.append(f"{module.place}:{node.lineno}")
    return found


def there_is_one_closed_loop(house: House) -> list[str]:
    """One loop over ticks serves every body and replay.

    A loop that is spread over functions in another room, and calls neither its ticks nor its parts by their names, would not be found.
    """
    found = []
    for what, places in (("loop over ticks", loops_over_ticks(house)), ("closed loop", loops_that_are_closed(house))):
        elsewhere = [place for place in places if place.rsplit(":", 1)[0] != CLOSED_LOOP]
        found += [f"{place}: another {what}" for place in elsewhere]
        if len(places) - len(elsewhere) != 1:
            found.append(f"{CLOSED_LOOP}: {len(places) - len(elsewhere)} times a {what}, not once")
    return found


def random_numbers_come_from_generators(house: House) -> list[str]:
    """No random number comes from a global generator."""
    found = []
    for module in house.modules:
        names = {(one.line, one.name) for one in module.imports if one.name == "random" or one.name.startswith(("random.", "numpy.random"))}
        inner = [node for node in module.nodes if isinstance(node, ast.Attribute) and isinstance(node.value, ast.Attribute)]
        used = [node for node in inner if ast.unparse(node.value) in {"np.random", "numpy.random"}]
        names |= {(node.lineno, ast.unparse(node)) for node in used}
        found += [f"{module.place}:{line}: {name}" for line, name in sorted(names) if name.split(".")[-1] not in LEGAL_RANDOM]
    return found


# ---- rules that hold in some rooms so far


def plant_classes(house: House) -> set[str]:
    """Names of the plants' parameter classes (sections in models/plants), of what is made of them anywhere, and of unions of those."""
    sections: set[str] = set()
    found: set[str] = set()
    statements = [(module, node) for module in house.modules for node in module.tree.body]
    while True:
        for module, node in statements:
            known = found | ({"Section"} if module.room == "models.plants" else set())
            if isinstance(node, ast.ClassDef) and known & {ast.unparse(base).split(".")[-1] for base in node.bases}:
                found.add(node.name)
            elif isinstance(node, ast.Assign) and isinstance(node.targets[0], ast.Name) and found & _united(node.value):
                found.add(node.targets[0].id)
        if found == sections:
            return found
        sections = set(found)


def _united(value: ast.AST) -> set[str]:
    """Names in the unions `A | B` of an expression."""
    unions = [node for node in ast.walk(value) if isinstance(node, ast.BinOp) and isinstance(node.op, ast.BitOr)]
    return {node.id for union in unions for node in ast.walk(union) if isinstance(node, ast.Name)}


@lru_cache(maxsize=4)
def ladders_on_plants(house: House) -> list[str]:
    """Where code outside models/plants asks of which class a plant is: isinstance, issubclass, or a class in a `match`."""
    plants = plant_classes(house)
    found = []
    for module in house.modules:
        for node in module.nodes if module.room != "models.plants" else ():
            if isinstance(node, ast.Call) and isinstance(node.func, ast.Name) and node.func.id in {"isinstance", "issubclass"}:
                asked: ast.AST = node.args[-1]
            elif isinstance(node, ast.MatchClass):
                asked = node.cls
            else:
                continue
            names = {ast.unparse(part).split(".")[-1] for part in ast.walk(asked) if isinstance(part, ast.Name | ast.Attribute)}
            found += [f"{module.place}:{node.lineno}: {name}" for name in sorted(names & plants)]
    return found


@lru_cache(maxsize=4)
def bare_slices(house: House) -> list[str]:
    """Where a state may be cut by numbers: [:4], [4:7], [7:] or [:7] of the last axis, or such a `slice`, outside the file of StateLayout.

    What is cut cannot be seen from the text: a few of these are of tuples that are no states.
    """
    found = []
    for module in house.modules:
        if any(isinstance(node, ast.ClassDef) and node.name == "StateLayout" for node in module.tree.body):
            continue
        for node in module.nodes:
            if isinstance(node, ast.Subscript):
                last = node.slice.elts[-1] if isinstance(node.slice, ast.Tuple) and node.slice.elts else node.slice
                edges = [last.lower, last.upper, last.step] if isinstance(last, ast.Slice) else []
            elif isinstance(node, ast.Call) and isinstance(node.func, ast.Name) and node.func.id == "slice":
                edges = [None, *node.args] if len(node.args) == 1 else list(node.args)
            else:
                continue
            if edges and _edges(edges) in STATE_SLICES:
                found.append(f"{module.place}:{node.lineno}: {ast.unparse(node)}")
    return found


def _edges(nodes: list[ast.expr | None]) -> tuple[object, object] | None:
    """Lower and upper edge of a slice of numbers; None if it has other edges, or steps."""
    lower, upper, *step = nodes
    if any(one is not None for one in step):
        return None
    if not all(one is None or isinstance(one, ast.Constant) for one in (lower, upper)):
        return None
    first, last = (one.value if isinstance(one, ast.Constant) else None for one in (lower, upper))
    return first or 0, last


def in_room(house: House, room: str, places: Iterable[str]) -> list[str]:
    """Those places that lie in a room."""
    files = {module.place for module in house.rooms.get(room, ())}
    return [place for place in places if place.split(":")[0] in files]


# ---- all files of the repository


def no_address_and_no_path_of_a_machine(paths: Iterable[Path], root: Path = ROOT) -> list[str]:
    """No file names a registry of packages, or a folder of somebody's machine."""
    hosts = ("pypi" + ".org", "python" + "hosted", "registry." + "npmjs", "conda" + ".anaconda", "crates" + ".io")
    folders = re.compile("(?<![\\w.])/(" + "|".join(("wor" + "k", "tm" + "p", "ro" + "ot", "hom" + "e", "Use" + "rs")) + ")/")
    suffixes = {".py", ".toml", ".md", ".xml", ".txt", ".yml", ".yaml", ".cff", ""}
    found = []
    for path in (path for path in paths if path.suffix in suffixes):
        for number, line in enumerate(path.read_text(encoding="utf-8").splitlines(), 1):
            if any(host in line for host in hosts) or folders.search(line):
                found.append(f"{path.relative_to(root).as_posix()}:{number}")
    return found


RULES: tuple[Rule, ...] = (
    floors_import_down,
    rooms_have_a_place,
    rooms_import_down,
    no_circle_among_rooms,
    no_circle_among_modules,
    few_storeys,
    imports_are_absolute_and_literal,
    nothing_depends_on_tests,
    mujoco_stays_in_its_rooms,
    rerun_stays_in_its_room,
    rooms_are_small,
    every_folder_is_a_package,
    names_say_something,
    modules_say_what_they_are,
    no_loop_by_number,
    there_is_one_closed_loop,
    random_numbers_come_from_generators,
)


def main() -> None:
    """Print what breaks a rule, how high the house is, and how many places rules to come would find in each file."""
    house = House(ROOT, repository_files())
    for rule in RULES:
        for line in rule(house):
            print(f"{rule.__name__}: {line}")
    level = storeys(house.graph_of_rooms())
    print(f"{len(house.modules)} modules, {len(house.rooms)} rooms, {max(level.values())} storeys (at most {MOST_STOREYS})")
    for what, places in (("asks of which class a plant is", ladders_on_plants(house)), ("cuts a state by numbers", bare_slices(house))):
        print(f"\n{len(places)} places where code {what}:")
        for file, count in sorted(Counter(place.split(":")[0] for place in places).items()):
            print(f"{count:5d}  {file}")


if __name__ == "__main__":
    main()
