"""A campaign's ensemble as a Rerun recording: the spread of every error over trials, as it goes with time."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pyarrow as pa
import rerun as rr
import rerun.blueprint as rrb
from numpy.typing import NDArray

from sim.campaign.settings import Campaign
from sim.campaign.shard import bin_values
from sim.rerun.blueprint import TIMELINE
from sim.rerun.recording_file import recording_file
from sim.series.palette import REFERENCE, on_dark
from sim.text.table_style import counted

Array = NDArray[np.floating]

LEVELS = (0.05, 0.5, 0.95)
TITLES = {
    "attitude_error_deg": "Attitude error of the estimate [deg]",
    "rate_error_rad_s": "Rate error of the estimate [rad/s]",
    "statistic_over_threshold": "Smoothed NIS over its upper threshold [-]",
    "tracking_error_deg": "Tracking error of the body [deg]",
}


def quantiles(bands: pa.Table, quantity: str, observer: str) -> tuple[NDArray[np.int64], Array]:
    """Ticks, and the quantiles LEVELS over trials at each, (ticks, levels), of a quantity kept as histograms."""
    use = (np.asarray(bands["quantity"]) == quantity) & (np.asarray(bands["observer"]) == observer)
    tick, edge, count = (np.asarray(bands[name])[use] for name in ("tick", "bin", "count"))
    ticks = np.unique(tick)
    table = np.zeros((len(ticks), int(edge.max()) + 1))
    table[np.searchsorted(ticks, tick), edge] = count
    before = np.cumsum(table, axis=1) - table
    total = table.sum(axis=1)
    found = []
    for level in LEVELS:
        edge = np.argmax(np.cumsum(table, axis=1) >= level * total[:, None], axis=1)
        row = np.arange(len(ticks))
        inside = (level * total - before[row, edge]) / table[row, edge]  # trials are taken as spread evenly over the bin
        found.append(bin_values(edge + inside - 0.5))
    return ticks, np.stack(found, axis=-1)


def write_bands(path: Path, campaign: Campaign, bands: pa.Table, dt: float) -> None:
    """Write the ensemble: median (thick), 5 and 95 % (thin) of each quantity and observer."""
    names, kinds = np.asarray(bands["observer"]), np.asarray(bands["quantity"])
    pairs = list(dict.fromkeys(zip(kinds, names, strict=True)))
    colours = on_dark(dict.fromkeys(str(name) for name in names if name != "loop")) | {"loop": REFERENCE}
    last = np.asarray(bands["tick"]).max(initial=0)  # nothing if all trials failed
    start, end = (rr.TimeRangeBoundary.absolute(seconds=dt * float(tick)) for tick in (0, last))
    views = [
        rrb.TimeSeriesView(
            origin=f"/{kind}",
            name=f"{title}: median, 5 and 95 % of {counted(campaign.trials, 'trial')}",
            axis_x=rrb.TimeAxis(view_range=rr.TimeRange(start=start, end=end)),
            plot_legend=rrb.PlotLegend("RightTop"),
        )
        for kind, title in TITLES.items()
        if kind in kinds
    ]
    page = rrb.Blueprint(rrb.Grid(*views, grid_columns=2), collapse_panels=True)
    with recording_file(path, "nacs campaign", page) as stream:
        stream.send_recording_name(campaign.title)
        stream.log(
            "about",
            rr.TextDocument(
                f"# {campaign.title}\n\n{counted(campaign.trials, 'trial')} of {campaign.scenario}", media_type="text/markdown"
            ),
            static=True,
        )
        for kind, name in pairs:
            ticks, values = quantiles(bands, kind, name)
            entity = f"{kind}/{rr.escape_entity_path_part(str(name))}"
            labels = [f"{name} 5 %", f"{name} median", f"{name} 95 %"]
            stream.log(entity, rr.SeriesLines(names=labels, colors=[colours[str(name)]] * 3, widths=[0.7, 2.0, 0.7]), static=True)
            time = rr.TimeColumn(TIMELINE, duration=np.round(1e9 * dt * ticks).astype("timedelta64[ns]"))
            stream.send_columns(entity, [time], rr.Scalars.columns(scalars=values.ravel()).partition(np.full(len(ticks), len(LEVELS))))
