"""A scenario file in which every key has its unit, default and meaning beside it, those that are not set as remarks."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from sim.scenario.described.schema import DRAWN, Described, Node, Schema
from sim.text.toml_text import key_written, written

NAMED_SET = "set"  # key of a table whose defaults are those of a named set
CUT = " ..."  # at the end of a default that is too long
LONGEST = 60  # characters of a default that is shown


def commented(data: dict[str, Any], whole: dict[str, Any], family: str, schema: Schema) -> str:
    """The same file, ready to be changed.

    Args:
      data: a scenario's tables, as read from a file.
      whole: all its settings once it has been checked, those that it does not say among them.
      family: of the scenario.
      schema: of scenario files.
    """
    name = schema.families[family]
    return "\n".join(_Commented(schema).table((), {"$ref": f"#/$defs/{name}"}, data, whole)).strip() + "\n"


def remark(one: Described, shown: bool) -> str:
    """Unit, meaning and, where it is `shown`, the default, in one line."""
    choices = f"one of {one.kind}" if one.kind.startswith('"') and ", " in one.kind else ""
    default = f"default: {default_of(one)}" if shown and not one.required and default_of(one) else ""
    return "; ".join(part for part in (one.unit, one.meaning or one.kind, choices, default) if part)


def default_of(one: Described) -> str:
    """The default as a file would say it; empty for none and for tables, whose keys have their own."""
    if one.default is None or isinstance(one.default, dict):
        return ""
    text = written(one.default)
    return text if len(text) <= LONGEST else f"{text[: LONGEST - len(CUT)]}{CUT}"


class _Commented:
    """Goes down a file's tables beside the schema."""

    def __init__(self, schema: Schema) -> None:
        self._schema = schema

    def table(self, path: tuple[str, ...], node: Node, data: dict[str, Any], whole: Any) -> Iterator[str]:
        """Lines of a table: its own values first, then the tables in it; `whole` is what there is of it once it has been checked."""
        whole = whole if isinstance(whole, dict) else {}
        name = self._schema.of_table(node, data)
        described = {} if name is None else {one.name: one for one in self._schema.keys(name)}
        fields: Node = {} if name is None else self._schema.definitions[name]["properties"]
        below: list[tuple[str, Any, Node]] = []
        for key in [*described, *(key for key in data if key not in described)]:
            inner = fields.get(key, {}) if name is not None else self._schema.member(node)
            if key not in data:
                yield self._unset(described[key]._replace(default=whole.get(key, described[key].default)))
            elif self._has_lines(inner, data[key]):
                below.append((key, data[key], inner))
            else:
                said = f"  # {remark(described[key], NAMED_SET not in data)}" if key in described else ""
                yield f"{key_written(key)} = {written(data[key])}{said}"
        for key, value, inner in below:
            place = (*path, key)
            heading = ".".join(key_written(part) for part in place)
            told = [f"# {described[key].meaning}"] if key in described and described[key].meaning else []
            if isinstance(value, list):
                for number, element in enumerate(value):
                    lines = self.table(place, self._schema.member(inner), element, _at(whole.get(key), number))
                    yield from ("", *(told if number == 0 else ()), f"[[{heading}]]", *lines)
            else:
                yield from ("", *told, f"[{heading}]", *self.table(place, inner, value, whole.get(key)))

    def _unset(self, one: Described) -> str:
        """A key that is not set, as a remark."""
        default = default_of(one)
        if not default or default.endswith(CUT):
            return f"# {one.name}: {remark(one, True)}"
        return f"# {key_written(one.name)} = {default}  # {remark(one, False)}"

    def _has_lines(self, node: Node, value: Any) -> bool:
        """Whether a value gets a table of its own: none for numbers that are drawn, or for values that nobody describes."""
        if isinstance(value, list):
            return bool(value) and all(isinstance(element, dict) for element in value) and bool(self._schema.member(node))
        if not isinstance(value, dict):
            return False
        name = self._schema.of_table(node, value)
        if name is not None:
            return not self._schema.title(name).startswith(DRAWN)
        return any(isinstance(part, dict) for part in value.values())


def _at(whole: Any, number: int) -> Any:
    """A member of a list, if there is such a list."""
    return whole[number] if isinstance(whole, list) and number < len(whole) else None
