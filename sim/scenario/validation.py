"""What is wrong with a user's file, as one line that names the key."""

from __future__ import annotations

import difflib
from collections.abc import Iterator
from typing import Any

from pydantic import BaseModel, ValidationError
from pydantic_core import ErrorDetails

from sim.text.table_style import counted

_SHAPES = {
    **dict.fromkeys(("model_type", "model_attributes_type", "dataclass_type", "dict_type", "mapping_type"), "a table"),
    **dict.fromkeys(("tuple_type", "list_type"), "a list"),
    "string_type": "text",
    **dict.fromkeys(("bool_type", "bool_parsing"), "true or false"),
    **dict.fromkeys(("float_type", "float_parsing"), "a number"),
    **dict.fromkeys(("int_type", "int_parsing", "int_from_float"), "a whole number"),
}  # what a value must be, by the type of the error


def first_error(invalid: ValidationError, data: dict[str, Any], model: type[BaseModel]) -> str:
    """One line on the first key of `data` that is wrong for `model`; where a value may be of several kinds, what each would need."""
    errors = sorted(invalid.errors(), key=lambda error: error["type"] == "string_type" and isinstance(error["input"], dict))
    key = ".".join(_path_in_file(errors[0]["loc"], data))
    messages = [_message(error, model) for error in errors if ".".join(_path_in_file(error["loc"], data)) == key]
    given = errors[0]["input"]
    shown = f" (got {given!r})" if isinstance(given, str | int | float | list | tuple) and "got" not in messages[0] else ""
    shown = f"{shown[:60]}...)" if len(shown) > 80 else shown
    return (f"{key}: " if key else "") + ", or ".join(dict.fromkeys(messages)) + shown


def _message(error: ErrorDetails, model: type[BaseModel]) -> str:
    last = error["loc"][-1] if error["loc"] else ""
    if error["type"] == "extra_forbidden":
        schema = model.model_json_schema()
        near = difflib.get_close_matches(str(last), sorted(_keys_there(schema, error["loc"][:-1])), n=1)
        elsewhere = any(last in block.get("properties", {}) for block in (schema, *schema.get("$defs", {}).values()))
        return "unknown key" + (f"; did you mean {near[0]}?" if near else f"; {last} belongs elsewhere" if elsewhere else "")
    if error["type"] == "missing":
        return f"needs {last + 1} values or more" if isinstance(last, int) else "is missing"
    if error["type"] == "too_short":
        least = error["ctx"]["min_length"]
        return f"needs {counted(least, 'value')} or more"
    if error["type"] in ("union_tag_invalid", "union_tag_not_found"):
        return _untagged(error)
    if error["type"] in _SHAPES:
        return f"must be {_SHAPES[error['type']]}"
    text = error["msg"].removeprefix("Value error, ").replace("Input should be", "must be", 1)
    return text[:1].lower() + text[1:]


def _untagged(error: ErrorDetails) -> str:
    """What a block that may be of several kinds is said to be and is not, or does not say that it is."""
    context, given = error["ctx"], error["input"]
    key = str(context["discriminator"]).strip("'")
    known = [word.strip("' ") for word in str(context.get("expected_tags", "")).split(",")]
    if error["type"] == "union_tag_not_found":
        return f"needs a {key}" if isinstance(given, dict) else f"must be a table with a {key}"
    near = difflib.get_close_matches(str(context["tag"]), known, n=1)
    return f"no {key} is called {str(context['tag'])!r}" + (f"; did you mean {near[0]}?" if near else f"; there are {', '.join(known)}")


def _path_in_file(location: tuple[int | str, ...], data: Any) -> Iterator[str]:
    """The parts of pydantic's location that are keys of the file: tags of unions and validators are left out."""
    node, tagged = data, False
    location = tuple(part for part in location if not (isinstance(part, str) and part.startswith("function-")))  # which of several models
    for number, part in enumerate(location):
        last = number == len(location) - 1
        if isinstance(node, dict) and not tagged and part in (node.get("type"), node.get("kind")) and not (last and part in node):
            tagged = True
            continue
        inside = part in node if isinstance(node, dict) else isinstance(node, list) and isinstance(part, int) and part < len(node)
        if inside:
            yield str(part)
            node, tagged = node[part], False
        elif last and isinstance(node, dict):
            yield str(part)


def _keys_there(schema: dict[str, Any], location: tuple[int | str, ...]) -> set[str]:
    """Keys that the section at a place can have; of one that may be of several kinds, those of all that fit."""
    nodes = _alternatives(schema, schema)
    for part in location:
        nodes = [inner for node in nodes for below in _below(node, part) for inner in _alternatives(below, schema)]
    return {key for node in nodes for key in node.get("properties", {})}


def _below(node: dict[str, Any], part: int | str) -> list[dict[str, Any]]:
    """What a schema has under a key or number; a union's tag leads to those of that type or kind."""
    if (properties := node.get("properties")) is not None:
        tags = {properties.get(key, {}).get("const") for key in ("type", "kind")}
        return [properties[part]] if part in properties else [node] if part in tags else []
    if isinstance(part, int):
        return [*node.get("prefixItems", [])[part : part + 1], *([node["items"]] if isinstance(node.get("items"), dict) else [])]
    return [node["additionalProperties"]] if isinstance(node.get("additionalProperties"), dict) else []


def _alternatives(node: dict[str, Any], schema: dict[str, Any]) -> list[dict[str, Any]]:
    """The schemas that one stands for, references and unions resolved."""
    if "$ref" in node:
        return _alternatives(schema["$defs"][node["$ref"].rpartition("/")[2]], schema)
    several = node.get("anyOf") or node.get("oneOf")
    return [inner for one in several for inner in _alternatives(one, schema)] if several else [node]
