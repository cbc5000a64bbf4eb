"""Prints docs/scenario-files.md from the settings' own schema: python docs/scenario_files.py > docs/scenario-files.md."""

from __future__ import annotations

from collections.abc import Iterator

from sim.scenario.described.commented import default_of
from sim.scenario.described.schema import DRAWN, TAGS, Described, Node, Schema

SCHEMA = Schema()
FAMILIES = {"body": "One body", "formation": "Formations", "consensus": "Agents in the plane"}


def row(one: Described) -> str:
    """A key."""
    default = "**needed**" if one.required else f"`{default_of(one)}`" if default_of(one) else ""
    kind = one.kind.replace("|", "\\|")
    return f"| `{one.name}` | {kind} | {one.unit} | {default} | {one.meaning.replace('|', chr(92) + '|')} |"


def heading(place: str, name: str) -> str:
    """Where a section stands, and which type or kind it is of."""
    properties = SCHEMA.definitions[name]["properties"]
    tags = [f"{key} = {' or '.join(values(properties[key]))}" for key in TAGS if key in properties and values(properties[key])]
    return f"`{place}`" + (f", `{tags[0]}`" if tags else "")


def values(field: Node) -> list[str]:
    """What a tag may be."""
    return [f'"{one}"' for one in field.get("enum", [field["const"]] if "const" in field else [])]


def section(place: str, name: str) -> Iterator[str]:
    """One table of keys, below what its settings say of themselves."""
    said = " ".join(str(SCHEMA.definitions[name].get("description", "")).split("\n\n")[0].split())
    yield f"### {heading(place, name)}\n\n{said}\n\n| key | value | unit | default | meaning |\n|---|---|---|---|---|"
    yield "\n".join(row(one) for one in SCHEMA.keys(name)) + "\n"


def family(name: str, told: set[str]) -> Iterator[str]:
    """The file of a family, and all sections below it that have not been told."""
    waiting = [("", SCHEMA.families[name])]
    yield f"## {FAMILIES[name]}\n"
    while waiting:
        place, definition = waiting.pop(0)
        if definition in told or SCHEMA.title(definition).startswith(DRAWN):
            continue
        told.add(definition)
        yield from section(place or "the file", definition)
        for key, field in SCHEMA.definitions[definition]["properties"].items():
            waiting += [(step(place, key, field), below) for below in SCHEMA.below(field)]


def step(place: str, key: str, field: Node) -> str:
    """Place of a section below a key: by a name of the user's own, or in a list."""
    whole = f"{place}.{key}" if place else key
    if field.get("type") == "array":
        return f"[[{whole}]]"
    return f"{whole}.NAME" if isinstance(field.get("additionalProperties"), dict) else whole


def families() -> Iterator[str]:
    """All of them."""
    told = set[str]()
    for name in FAMILIES:
        yield from family(name, told)


PAGE = f"""# Scenario files

Every key with its unit, default and meaning. This page is printed by `python docs/scenario_files.py`; a test compares the two.

```sh
nacs new mine --from nacs/disturbance    # mine.toml: the same, with all this beside every key
nacs run mine.toml
nacs schema > nacs.schema.json           # for editors: they check a file and complete its keys while it is written
```

A file whose first line is `#:schema nacs.schema.json` is checked by editors with a TOML language server (Taplo, Even Better TOML).

**Files that extend others.** With `extends` a file says only what differs:

```toml
extends = "nacs/disturbance"     # or "other.toml", from this file's folder

[run]
ticks = 300                      # the base's tick_s, trials and seed stay

[sensors]
gyro_noise_rad_s = 3e-3
```

Tables are merged key by key, over any number of files; a value or a list takes the place of the base's, and so does a table of another
`type` or `kind`. `--set` is heard last.

A number whose value is said to be `number, or drawn` may be drawn anew in every trial: `{{ uniform = [1, 2] }}`, `{{ normal = [mean,
deviation] }}`, `{{ log_uniform = [1, 2] }}`, `{{ choice = [1, 2, 3] }}`. A section that several families have is told with the first. Where
a default is a table, its keys have their own. [faults.md](faults.md) has more on faults and their older names,
[parameters.md](parameters.md) where the numbers of the plants come from, [conventions.md](conventions.md) frames and signs.

{chr(10).join(families())}"""

if __name__ == "__main__":
    print(PAGE, end="")
