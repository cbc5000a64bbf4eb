"""Signals of a loop as an `xarray.Dataset`."""

from __future__ import annotations

from typing import Any

import numpy as np

from sim.bad_input import BadInput
from sim.series.signals.signal import AGENT, TIME, TRIAL, LoopSignals


def dataset(loop: LoopSignals) -> Any:
    """A variable for each signal, `truth_attitude` with axes (trial, agent, time, quaternion), and coordinates with labels.

    Raises:
      BadInput: xarray is not installed.
    """
    try:
        import xarray as xr  # noqa: PLC0415  # an extra
    except ImportError:
        raise BadInput("this needs xarray: pip install 'nacs-twin[data]'") from None
    coordinates: dict[str, Any] = {TRIAL: loop.trials, TIME: (TIME, loop.time, {"units": "s", "long_name": "time since the start"})}
    if loop.agents is not None:
        coordinates[AGENT] = loop.agent_numbers
    for signal in loop:
        coordinates |= {axis.name: np.array(axis.labels) for axis in signal.axes}
    variables = {
        signal.variable: (signal.dims, signal.values.copy(), {"units": signal.unit, "long_name": signal.meaning, "frame": signal.frame})
        for signal in loop
    }
    return xr.Dataset(variables, coordinates, {"loop": loop.loop})
