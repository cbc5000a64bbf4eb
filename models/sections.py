"""What every section of a file has in common: it is frozen, knows its keys, and takes finite numbers only."""

from __future__ import annotations

from typing import Annotated, Any

from pydantic import BaseModel, ConfigDict, Field, GetCoreSchemaHandler
from pydantic_core import CoreSchema, core_schema

Positive = Annotated[float, Field(gt=0)]
NonNegative = Annotated[float, Field(ge=0)]
Share = Annotated[float, Field(ge=0, le=1)]
Ordinal = Annotated[int, Field(ge=1)]  # of agents and wheels, which a person counts from one
Seed = Annotated[int, Field(ge=0, lt=2**63)]  # as wide as a column of the tables that it is written to
Headline = Annotated[str, Field(max_length=300)]  # what a picture can be headed with
Sextuple = tuple[float, float, float, float, float, float]  # [xx, yy, zz, xy, xz, yz] of a symmetric tensor

_LITERAL_MINDED = ("float", "bool", "str")  # types whose values are taken as they are written


def _as_written(schema: Any) -> Any:
    """A schema of pydantic's whose numbers, truth values and texts are strict; what is strict already stays as it is."""
    if isinstance(schema, list | tuple):
        return type(schema)(_as_written(part) for part in schema)
    if not isinstance(schema, dict) or schema.get("strict"):
        return schema
    if schema.get("type") == "int":
        return core_schema.no_info_before_validator_function(_whole, {**schema, "strict": True})
    if schema.get("type") in _LITERAL_MINDED:
        return {**schema, "strict": True}
    return {key: part if key in ("metadata", "serialization", "default") else _as_written(part) for key, part in schema.items()}


def _whole(value: Any) -> Any:
    """A number without a fraction as a whole one; anything else as it is."""
    if isinstance(value, float) and value.is_integer():
        return int(value)
    return value if isinstance(value, bool | int) or not hasattr(value, "__index__") else int(value)


class Section(BaseModel):
    """A section of a scenario, campaign or parameter file.

    A number is a number: `true`, `"yes"` and `"3"` are not taken for one another as pydantic would; 1e3 is a whole number.
    """

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)

    @classmethod
    def __get_pydantic_core_schema__(cls, source: Any, handler: GetCoreSchemaHandler) -> CoreSchema:
        """The model's own, with types that take nothing for something else."""
        schema: CoreSchema = _as_written(handler(source))
        return schema
