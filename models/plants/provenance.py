"""Parameters that carry their unit and where their value comes from."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from pydantic import BaseModel, Field


def known(default: Any, description: str, unit: str, provenance: str) -> Any:
    """A field of a pydantic model with its unit and its provenance: published, from a datasheet, or chosen and why."""
    return Field(default, description=description, json_schema_extra={"unit": unit, "provenance": provenance})


def table(parameters: BaseModel) -> Iterator[tuple[str, str, str, str, str]]:
    """Rows (name, value, unit, meaning, provenance) of every such field."""
    for name, info in type(parameters).model_fields.items():
        extra = info.json_schema_extra
        if isinstance(extra, dict):
            yield name, str(getattr(parameters, name)), str(extra["unit"]), info.description or "", str(extra["provenance"])
