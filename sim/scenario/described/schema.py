"""JSON schemas of scenario files, for editors and for what is written about them."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, NamedTuple

from pydantic.json_schema import models_json_schema

from models.plants.register.entries import KINDS
from sim.faults.events import KINDS as FAULTS
from sim.scenario.described.meanings import meaning, unit
from sim.scenario.extension import KEY
from sim.scenario.files import FAMILIES

Node = dict[str, Any]
TAGS = ("type", "kind")  # keys that say which settings a table has
DRAWN = "Draw"  # settings of a number that may be drawn
GIVEN_BY_THE_FILE = "tuning"  # of an observer without one it is the scenario's
OLDER_NAMES = sorted({alias.kind for kind in FAULTS.values() for alias in kind.aliases} - set(FAULTS))


class Described(NamedTuple):
    """One key of a section.

    Attributes:
      name: of the key.
      kind: what its value is, in words.
      unit: of numbers; empty: none.
      default: as JSON has it.
      required: whether it must be given.
      meaning: in words.
    """

    name: str
    kind: str
    unit: str
    default: Any
    required: bool
    meaning: str


class Schema:
    """That of all families, with definitions that refer to each other."""

    def __init__(self) -> None:
        found, whole = models_json_schema([(model, "validation") for model in FAMILIES.values()])
        self.definitions: dict[str, Node] = whole["$defs"]
        refs = {model: found[model, "validation"]["$ref"] for model in FAMILIES.values()}
        self.families: dict[str, str] = {family: _last(refs[model]) for family, model in FAMILIES.items()}
        for name, section in self.definitions.items():
            for key, field in section.get("properties", {}).items():
                if not field.get("description") and (said := meaning(self.title(name), key)):
                    field["description"] = said
            _as_files_say_it(section)
        for name in [name for name in self.definitions if self.title(name) == DRAWN]:
            drawn = self.definitions.pop(name)
            self.definitions[name] = {"title": DRAWN, "anyOf": [{"type": "number"}, {"$ref": f"#/$defs/{name}Table"}]}
            self.definitions[f"{name}Table"] = drawn

    def title(self, name: str) -> str:
        """Class of settings that a definition is of."""
        return str(self.definitions[name].get("title", name))

    def whole(self) -> Node:
        """The schema of any scenario file: which family it is of shows in the type of its plant; what extends another may leave all out."""
        keys: Node = {key: {} for name in self.families.values() for key in self.definitions[name]["properties"]}
        extending = {
            "properties": {KEY: {"type": "string", "description": meaning("", KEY)}, **keys},
            "required": [KEY],
            "additionalProperties": False,
        }
        branch: Node = {"$ref": f"#/$defs/{self.families['body']}"}
        for family in ("formation", "consensus"):
            types = [kind.type for kind in KINDS.values() if kind.family == family]
            plant = {"properties": {"plant": {"properties": {"type": {"enum": types}}, "required": ["type"]}}, "required": ["plant"]}
            branch = {"if": plant, "then": {"$ref": f"#/$defs/{self.families[family]}"}, "else": branch}
        return {
            "$schema": "https://json-schema.org/draft/2020-12/schema",
            "title": "A scenario of the NACS twin",
            "type": "object",
            "if": {"required": [KEY]},
            "then": extending,
            "else": branch,
            "$defs": self.definitions,
        }

    def keys(self, name: str) -> Iterator[Described]:
        """Keys of a section, in the order of the settings."""
        section = self.definitions[name]
        required = section.get("required", ())
        for key, field in section.get("properties", {}).items():
            of = field.get("unit", unit(key)).removeprefix("-")  # plants write a dash where there is none
            yield Described(key, self.words(field), of, field.get("default"), key in required, field.get("description", ""))

    def below(self, node: Node) -> list[str]:
        """Definitions that a value may be of, itself or as a member."""
        if "$ref" in node:
            name = _last(node["$ref"])
            if "properties" in self.definitions[name]:
                return [name]
            return self.below(self.definitions[name])
        inner = [*node.get("anyOf", ()), *node.get("oneOf", ()), *node.get("prefixItems", ())]
        inner += [node[key] for key in ("items", "additionalProperties") if isinstance(node.get(key), dict)]
        return list(dict.fromkeys(name for one in inner for name in self.below(one)))

    def of_table(self, node: Node, value: dict[str, Any]) -> str | None:
        """Definition that a table in the place of a node is of; None: its names are the user's own, or it is of none."""
        if "$ref" in node:
            name = _last(node["$ref"])
            section = self.definitions[name]
            if "properties" not in section:
                return self.of_table(section, value)
            fixed = {key: field["const"] for key, field in section["properties"].items() if key in TAGS and "const" in field}
            chosen = {key: field["enum"] for key, field in section["properties"].items() if key in TAGS and "enum" in field}
            fits = all(value.get(key, said) == said for key, said in fixed.items())
            fits = fits and all(value.get(key, some[0]) in some for key, some in chosen.items())
            return name if fits and set(value) <= set(section["properties"]) else None
        found = (self.of_table(one, value) for key in ("anyOf", "oneOf", "allOf") for one in node.get(key, ()))
        return next((name for name in found if name is not None), None)

    def member(self, node: Node) -> Node:
        """The schema of a member of a table with names of the user's own, or of a list."""
        if "$ref" in node:
            return self.member(self.definitions[_last(node["$ref"])])
        for key in ("additionalProperties", "items"):
            if isinstance(node.get(key), dict):
                return dict(node[key])
        found = (self.member(one) for key in ("anyOf", "oneOf") for one in node.get(key, ()))
        return next((one for one in found if one), {})

    def words(self, node: Node) -> str:
        """What a value is, in a few words."""
        if "const" in node:
            return f'"{node["const"]}"' if isinstance(node["const"], str) else str(node["const"])
        if "enum" in node:
            return ", ".join(f'"{one}"' if isinstance(one, str) else str(one) for one in node["enum"])
        if "$ref" in node:
            name = _last(node["$ref"])
            inner = self.definitions[name]
            return "number, or drawn" if self.title(name) == DRAWN else "table" if "properties" in inner else self.words(inner)
        if several := node.get("anyOf") or node.get("oneOf"):
            parts = [self.words(one) for one in several if one.get("type") != "null"]
            return " or ".join(dict.fromkeys(parts))
        if node.get("type") == "array":
            return self._list(node)
        return {"number": "number", "integer": "whole number", "boolean": "true or false", "string": "text"}.get(
            str(node.get("type")), "tables by name" if isinstance(node.get("additionalProperties"), dict) else "table"
        )

    def _list(self, node: Node) -> str:
        items = node.get("prefixItems") or []
        one = self.words(items[0]) if items else self.words(node.get("items", {}))
        return f"{len(items)} of: {one}" if items else f"list of: {one}"


def _as_files_say_it(node: Any) -> None:
    """Let a section's schema take what is read into it before it is checked: tunings given elsewhere, and faults by older names."""
    if isinstance(node, list):
        for part in node:
            _as_files_say_it(part)
    if not isinstance(node, dict):
        return
    if GIVEN_BY_THE_FILE in node.get("required", ()):
        node["required"] = [key for key in node["required"] if key != GIVEN_BY_THE_FILE]
    if node.get("discriminator", {}).get("propertyName") == "kind" and "oneOf" in node:
        older = {"type": "object", "properties": {"kind": {"enum": OLDER_NAMES}}, "required": ["kind"]}
        node["anyOf"] = [*node.pop("oneOf"), older]
        del node["discriminator"]
    for part in node.values():
        _as_files_say_it(part)


def _last(ref: str) -> str:
    return ref.rpartition("/")[2]
