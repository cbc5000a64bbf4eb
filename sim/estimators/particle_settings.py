"""What particle filters of every family can be told in a file."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

ProposalName = Literal["optimal", "bootstrap", "likelihood", "extended", "unscented"]
ResampleEvery = Annotated[
    int, Field(ge=0, le=1_000_000, description="steps from one resampling to the next, in place of threshold; 0: as threshold says")
]

MIXED = "'likelihood' cannot do with a likelihood that is not normal: its weights depend on what was drawn"
