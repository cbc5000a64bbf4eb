"""Maps: how a laboratory's columns are to be read; every complaint is one line with file and key."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any, ClassVar, Literal

from pydantic import Field, ValidationError, model_validator

from models.sections import Positive, Section
from sim.bad_input import BadInput
from sim.convert.axes import Body, World
from sim.convert.units import Quantity, factor
from sim.scenario.validation import first_error
from sim.text import toml_text

Column = Annotated[str, Field(min_length=1)]
Unit = str | Positive
Sign = Literal[1, -1]
Absent = Literal["none"]


class FileMap(Section):
    """How the file is laid out, where it does not show by itself.

    Attributes:
      delimiter: between two columns of a CSV file.
      decimal: the mark before the decimals of a CSV file.
      skip_rows: lines of a CSV file before the names of the columns.
    """

    delimiter: Annotated[str, Field(min_length=1, max_length=1)] | None = None
    decimal: Literal[".", ","] | None = None
    skip_rows: Annotated[int, Field(ge=0)] | None = None


class TimeMap(Section):
    """The clock, or without one the rate of the rows.

    Attributes:
      column: time stamps; they are kept as they are, jittering or not.
      unit: of the stamps.
      offset: what is subtracted of each stamp, in its unit; `first`: the first stamp of each trial.
      rate_hz: rows a second, in place of a column.
      period_s: nominal period; left out: the median interval.
    """

    column: Column | None = None
    unit: Unit = "s"
    offset: int | float | Literal["first"] = 0.0
    rate_hz: Positive | None = None
    period_s: Positive | None = None

    @model_validator(mode="after")
    def _one_clock(self) -> TimeMap:
        factor("time", self.unit)
        if (self.column is None) == (self.rate_hz is None):
            raise ValueError("time: needs either a column or rate_hz")
        return self


class AttitudeMap(Section):
    """Unit quaternions.

    Attributes:
      columns: the four components, in their order.
      order: where the scalar part stands.
      direction: `q_BN`, with A(q) mapping N to B, which as a product of Hamilton's turns B's vectors into N; or its inverse `q_NB`.
      world: axes that the attitude is relative to, by letters such as `ENU`, or rows of C with v_N = C v.
      body: axes of the body, by letters such as `FLU`, or rows of C with v_B = C v.
      sign: of each column.
      unit: what one of a column is, where it is not 1.
    """

    columns: tuple[Column, Column, Column, Column]
    order: Literal["scalar-last", "scalar-first"] = "scalar-last"
    direction: Literal["q_BN", "q_NB"] = "q_BN"
    world: World = "NED"
    body: Body = "FRD"
    sign: tuple[Sign, Sign, Sign, Sign] = (1, 1, 1, 1)
    unit: Positive = 1.0


class ColumnsMap(Section):
    """Columns of one quantity.

    Attributes:
      columns: their names, in the order of the log's.
      unit: of all, or what one is in the log's.
      sign: of each column; left out: all as they are.
      hold: whether a gap in a column is its last number before.
    """

    quantity: ClassVar[Quantity] = "number"

    columns: Annotated[tuple[Column, ...], Field(min_length=1)]
    unit: Unit
    sign: tuple[Sign, ...] | None = None
    hold: bool = False

    @model_validator(mode="after")
    def _known(self) -> ColumnsMap:
        factor(self.quantity, self.unit)
        if self.sign is not None and len(self.sign) != len(self.columns):
            raise ValueError(f"sign: has {len(self.sign)} of {len(self.columns)} columns")
        return self


class RateMap(ColumnsMap):
    """Rates of the body, or torques on it, resolved in it.

    Attributes:
      body: axes of the body that they are resolved in.
    """

    quantity: ClassVar[Quantity] = "rate"

    columns: tuple[Column, Column, Column]
    unit: Unit = "rad/s"
    body: Body = "FRD"


class WheelsMap(ColumnsMap):
    """Speeds of the wheels, each about its own axis."""

    quantity: ClassVar[Quantity] = "rate"

    unit: Unit = "rad/s"


class CommandMap(ColumnsMap):
    """Torque of each motor on its wheel; of a body without wheels, torque on the body.

    Attributes:
      body: axes of the body that torques on it are resolved in.
    """

    quantity: ClassVar[Quantity] = "torque"

    unit: Unit = "N m"
    body: Body = "FRD"


class OneColumn(Section):
    """One column of a log that has no part of its own here.

    Attributes:
      column: its name in the laboratory's file.
      unit: its unit, or what one is in the log's; left out: the log's own.
      sign: 1 or -1.
      hold: whether a gap is the last number before.
    """

    column: Column
    unit: Unit | None = None
    sign: Sign = 1
    hold: bool = False


class LogMap(Section):
    """How a laboratory's file is read as a flight log.

    Attributes:
      scenario: whose plant it is of; left out: the NACS as published.
      loop: which closed loop of that scenario; left out: its first.
      file: how the file is laid out.
      missing: numbers that stand for nothing.
      time: the clock.
      trial: column that numbers the flights.
      attitude, rate, wheels, command: what was read, and what the drives were told; `none`: nobody did.
      truth_attitude, truth_rate, truth_wheels: what was so, as far as anybody knows.
      truth_fault: column that is 1 while a fault is active.
      columns: any other column of the log, by name.
    """

    scenario: str | None = None
    loop: str | None = None
    file: FileMap = FileMap()
    missing: tuple[float, ...] = ()
    time: TimeMap
    trial: Column | None = None
    attitude: AttitudeMap | Absent | None = None
    rate: RateMap | Absent | None = None
    wheels: WheelsMap | Absent | None = None
    command: CommandMap | Absent | None = None
    truth_attitude: AttitudeMap | None = None
    truth_rate: RateMap | None = None
    truth_wheels: WheelsMap | None = None
    truth_fault: Column | None = None
    columns: dict[str, OneColumn] = Field({}, description="any other column of the log, by name")


def read(path: Path) -> LogMap:
    """The map that a file says; raises BadInput, one line."""
    if not toml_text.is_there(path):
        raise BadInput(f"--map {path}: there is no such file; `nacs convert LAB.csv --inspect` proposes one")
    return checked(toml_text.read(path, str(path)), str(path))


def checked(said: dict[str, Any], label: str) -> LogMap:
    """The map that tables stand for; raises BadInput, which begins with `label`."""
    try:
        return LogMap.model_validate(said)
    except ValidationError as invalid:
        raise BadInput(f"{label}: {first_error(invalid, said, LogMap)}") from None
