"""A picture of what is known of every cause, before and after the tables."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import matplotlib as mpl
import numpy as np
from matplotlib import pyplot as plt
from matplotlib.axes import Axes
from scipy.stats import gaussian_kde

from docs.as_flown.causes import ALL, CAUSES
from docs.as_flown.emulator import without
from docs.as_flown.posterior import Posterior

SINGLE = ("#56B4E9", "#E69F00", "#009E73", "#CC79A7")  # Okabe and Ito's, of tables 1 to 4
PLACES = np.linspace(0.0, 1.0, 200)


def draw(fits: Mapping[tuple[int, ...], Posterior], path: Path) -> None:
    """Marginal densities over the place in each range: of tables 1 to 3, of each table alone; the prior is one."""
    mpl.use("agg")
    figure, axes = plt.subplots(4, 4, figsize=(13.0, 9.5), layout="constrained")
    for place, (axis, cause) in enumerate(zip(axes.flat, CAUSES, strict=True)):
        axis.axhline(1.0, color="0.75", lw=1.0, ls=":", label="before")
        for table in ALL:
            if table in cause.tables:
                _density(axis, fits[(table,)], place, color=SINGLE[table], lw=1.1, label=f"table {table + 1} alone")
        _density(axis, fits[without(3)], place, color="black", lw=2.2, label="tables 1 to 3")
        ticks = np.linspace(0.0, 1.0, 4)
        axis.set_xticks(ticks, [f"{float(format(value, '.2g')):g}" for value in cause.of_share(ticks)])
        axis.set(xlim=(0.0, 1.0), ylim=(0.0, None), yticks=[], xlabel=cause.unit if cause.unit != "1" else "")
        axis.set_title(cause.name, fontsize=10)
    handles, labels = axes[3, 3].get_legend_handles_labels()
    known = dict(zip(labels, handles, strict=True))
    for axis in axes.flat:
        known |= {label: handle for handle, label in zip(*axis.get_legend_handles_labels(), strict=True) if label not in known}
    order = ["before", *(f"table {table + 1} alone" for table in ALL), "tables 1 to 3"]
    figure.legend([known[name] for name in order], order, loc="outside upper center", ncols=6, frameon=False)
    figure.savefig(path, dpi=100)
    plt.close(figure)


def _density(axis: Axes, fit: Posterior, place: int, color: str, lw: float, label: str) -> None:
    """Density of samples that are reflected at the ends of the range, so that it does not sink there."""
    samples = fit.shares[:: max(1, len(fit.shares) // 4000), place]
    kernel = gaussian_kde(np.concatenate([samples, -samples, 2.0 - samples]), bw_method=0.08)
    axis.plot(PLACES, 3.0 * kernel(PLACES), color=color, lw=lw, label=label)
