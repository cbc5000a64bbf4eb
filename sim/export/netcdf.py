"""Signals as NetCDF: a dataset as xarray has it, in a group for each loop where there are several."""

from __future__ import annotations

from pathlib import Path

from sim.export.export_format import ExportFormat
from sim.series.signals.dataset import dataset
from sim.series.signals.signal import Signals

SINGLE = "loop"  # what a single loop is called; it needs no group


def _write(path: Path, signals: Signals) -> None:
    from xarray import DataTree

    packing = {"zlib": True, "complevel": 1}
    if [*signals.loops] == [SINGLE]:
        whole = dataset(signals.loops[SINGLE])
        whole.to_netcdf(path, engine="netcdf4", encoding=dict.fromkeys(whole.data_vars, packing))
        return
    groups = {f"/{name}": dataset(loop) for name, loop in signals.loops.items()}
    encoding = {name: dict.fromkeys(group.data_vars, packing) for name, group in groups.items()}
    DataTree.from_dict(groups).to_netcdf(path, engine="netcdf4", encoding=encoding)


FORMAT = ExportFormat("netcdf", ".nc", _write, needs=("xarray", "netCDF4"))
