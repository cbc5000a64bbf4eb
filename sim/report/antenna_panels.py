"""Two pictures of unfalsified control: the plane of the controllers with its tests, and a controller's true responses."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.axis import Axis
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter, NullLocator
from numpy.typing import NDArray

from sim.metrics.antenna_study import CHANNELS
from sim.metrics.closed_loop_identification import Bounds
from sim.scenario.identification import IdentificationSettings
from sim.series.antenna import AntennaFlight

Array = NDArray[np.floating]
Several = tuple[AntennaFlight, ...]

PLANE_POINTS = 161  # along each side of the plane's picture
LOWER, UPPER = 3.0, 1.8  # how far the plane goes beyond the controllers
FREQUENCIES = np.geomspace(0.01, 3.0, 500)  # over lambda


@dataclass(frozen=True)
class Ink:
    """Colours on a page."""

    dark: bool
    page: str
    text: str
    quiet: str
    first: str
    bound: str
    error: str  # conic of the error's test
    effort: str  # conic of the effort's test
    region: str
    parabola: str

    @property
    def style(self) -> dict[str, Any]:
        """Settings of Matplotlib."""
        lines = ("axes.edgecolor", "xtick.color", "ytick.color")
        texts = ("text.color", "axes.labelcolor", "axes.titlecolor", "xtick.labelcolor", "ytick.labelcolor")
        pages = {"figure.facecolor": self.page, "axes.facecolor": self.page, "grid.color": "#262e3a" if self.dark else "#e6e8ec"}
        return pages | dict.fromkeys(lines, self.quiet) | dict.fromkeys(texts, self.text)

    def of(self, flight: AntennaFlight) -> Any:
        """Colour of a loop."""
        return tuple(byte / 255 for byte in flight.look.on_dark) if self.dark else flight.look.on_light


LIGHT = Ink(False, "#ffffff", "#222222", "#5a6270", "#7f8a9c", "#d62839", "#8e44ad", "#00897b", "#fff0a8", "#444444")
DARK = Ink(True, "#11161e", "#e8ecf4", "#9aa4b4", "#a9b3c4", "#ff6b6b", "#d59bf6", "#4fd8c4", "#6b6123", "#d8dde6")


def controllers(several: Several, channel: int, ink: Ink) -> dict[str, tuple[Array, Any, Any]]:
    """Theta (2,), colour and dashes of the first, the nominal and the last controller, by what they are called."""
    subject, *others = several
    switched = len(subject.path(channel)) > 1
    found: dict[str, tuple[Array, Any, Any]] = {}
    if switched:
        found["first"] = (subject.theta[0, channel], ink.first, (0.0, (4.0, 1.6)))
    for other in others:
        if not (switched and np.array_equal(other.theta[-1, channel], subject.theta[0, channel])):
            found[other.name] = (other.theta[-1, channel], ink.of(other), "-")
    return found | {f"last of {subject.name}" if switched else subject.name: (subject.theta[-1, channel], ink.of(subject), "-")}


def plane(axes: Axes, several: Several, channel: int, ink: Ink) -> None:
    """Draw the switches of a channel in the plane of theta, with the last tests and what no test falsified (seed, fig. 6)."""
    subject, *others = several
    path = subject.path(channel)
    shown = np.concatenate([path, *(other.theta[-1:, channel] for other in others)])
    low, high = np.log(shown.min(axis=0) / LOWER), np.log(shown.max(axis=0) * UPPER)
    first, second = np.exp(np.linspace(low, high, PLANE_POINTS)).T
    theta = np.stack(np.meshgrid(first, second), axis=-1)
    fit = subject.unfalsified(channel, theta)
    axes.set(xscale="log", yscale="log", xlim=first[[0, -1]], ylim=second[[0, -1]])
    if fit.any():
        axes.contourf(first, second, fit.astype(float), levels=[0.5, 1.5], colors=[ink.region])
    handles: list[Any] = [Patch(color=ink.region, label="never falsified")]
    drawn = [(tick, 0.6) for tick in subject.switches[channel]] + [(subject.recording.ticks - 1, 1.7)]
    for test, (name, color) in enumerate((("error", ink.error), ("effort", ink.effort))):
        for tick, width in drawn:
            if subject.is_open[tick, channel]:
                values = subject.verdict(channel, theta, tick)[..., test]
                if values.min() < 0.0 < values.max():
                    axes.contour(first, second, values, levels=[0.0], colors=[color], linewidths=width, alpha=min(1.0, width))
                    if width > 1.0:
                        axes.contourf(first, second, values, levels=[0.0, np.inf], colors=[color], alpha=0.09)
        handles.append(Line2D([], [], color=color, lw=1.7, label=f"{name} test; thin: at switches" if test == 0 else f"{name} test"))
    axes.plot(
        first, np.sqrt(2.0 * first * np.broadcast_to(subject.law.inertia, 2)[channel]), color=ink.parabola, lw=1.0, ls=(0, (5, 2, 1, 2))
    )
    handles.append(Line2D([], [], color=ink.parabola, lw=1.0, ls=(0, (5, 2, 1, 2)), label=r"$\theta_2^2 = 2\,\theta_1 \hat J$"))
    for limits, line in zip(np.stack([subject.law.lower, subject.law.upper]).T, (axes.axvline, axes.axhline), strict=True):
        for limit in limits[limits > 0.0]:
            line(limit, color=ink.quiet, lw=0.8, ls=":")
    blue = ink.of(subject)
    for start, end in pairwise(path):
        arrow = {"arrowstyle": "-|>", "color": blue, "lw": 1.2, "shrinkA": 2.5, "shrinkB": 2.5, "mutation_scale": 9.0}
        axes.annotate("", xy=tuple(end), xytext=tuple(start), arrowprops=arrow)
    axes.plot(*path.T, "o", ms=3.2, color=blue)
    axes.plot(*path[0], "o", ms=6.5, mfc="none", mec=ink.first, mew=1.4)
    axes.plot(*path[-1], "*", ms=10.0, color=blue, mec=ink.text, mew=0.5, zorder=5)
    for other in others:
        axes.plot(*other.theta[-1, channel], "D", ms=5.0, color=ink.of(other), mec=ink.text, mew=0.5, zorder=4)
    axes.set(
        title=f"Controllers of {CHANNELS[channel]}: {len(path) - 1} switch{'' if len(path) == 2 else 'es'}",
        xlabel=r"$\theta_1 = 1/C_p$ [rad/(N m)]",
        ylabel=r"$\theta_2 = C_d/C_p$ [s]",
    )
    frame: dict[str, Any] = {"frameon": True, "facecolor": ink.page, "edgecolor": "none", "framealpha": 0.85, "labelcolor": ink.text}
    axes.legend(handles=handles, loc="lower right", handlelength=1.8, **frame)
    plain_log(axes, axes.xaxis)
    plain_log(axes, axes.yaxis)


def response(axes: Axes, several: Several, channel: int, effort: bool, ink: Ink) -> None:
    """Draw |T_er| or |T_ur| of the first, the nominal and the last controller, with their bound (seed, fig. 7 and 8)."""
    subject, kind = several[0], "effort" if effort else "error"
    settings = subject.scenario.identification or IdentificationSettings()
    bounds, frequency = Bounds.of(subject.law, settings.claim, channel), FREQUENCIES * subject.law.pace
    bound = (bounds.effort if effort else bounds.error) / bounds.shape(frequency)
    axes.loglog(frequency, bound, color=ink.bound, lw=1.6, label=r"$1/|W_2|$" if effort else r"$1/|W_1|$")
    drawn = [bound]
    for name, (theta, color, dashes) in controllers(several, channel, ink).items():
        if loop := subject.linear(channel, theta):
            gain = np.abs(loop.responses(frequency)[1 if effort else 0])
            label = name if loop.is_stable else f"{name}, unstable"
            axes.loglog(frequency, gain, color=color, ls=dashes if loop.is_stable else ":", lw=1.2, label=label)
            drawn.append(gain)
    for phase, color in zip(("initial", "nominal", "final"), (ink.first, _nominal(several, ink), ink.of(subject)), strict=True):
        if f"{channel_key(channel, phase)}/{kind}" in subject.recording.findings:
            heard, size = (subject.recording.findings[f"{channel_key(channel, phase)}/{part}"][0] for part in ("frequency", kind))
            few = np.unique(np.searchsorted(heard, np.geomspace(heard[0], heard[-1], 22)).clip(max=len(heard) - 1))
            axes.loglog(heard[few], size[few], "o", ms=2.4, mfc="none", mew=0.7, color=color)
            drawn.append(size[few])
    low, high = min(float(d.min()) for d in drawn), max(float(d.max()) for d in drawn)
    axes.set(xlim=frequency[[0, -1]], ylim=(max(0.6 * low, 1e-4 * high), 1.8 * high), xlabel="frequency [rad/s]")
    axes.set(title=f"{'Torque' if effort else 'Pointing error'} per reference, {CHANNELS[channel]}")
    axes.set_ylabel(r"$|T_{ur}|$ [N m/rad]" if effort else r"$|T_{er}|$ [-]")
    axes.legend(loc="lower center" if effort else "lower right", handlelength=2.2, labelcolor=ink.text)
    plain_log(axes, axes.xaxis)
    plain_log(axes, axes.yaxis)


def channel_key(channel: int, phase: str) -> str:
    """Beginning of the names of findings."""
    return f"{CHANNELS[channel]}/{phase}"


def _nominal(several: Several, ink: Ink) -> Any:
    settings = several[0].scenario.identification
    return next((ink.of(f) for f in several if settings and f.name == settings.nominal), ink.text)


def plain_log(axes: Axes, axis: Axis) -> None:
    """Plain numbers on a logarithmic axis: at 1, 2 and 5, or powers of ten where there are many."""
    low, high = axes.get_xlim() if axis is axes.xaxis else axes.get_ylim()
    wide = high > 400.0 * low
    axis.set_major_locator(LogLocator(10, subs=(1.0,) if wide else (1.0, 2.0, 5.0)))
    if high < 1e6 and low > 1e-6:
        axis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    axis.set_minor_locator(LogLocator(10, subs=tuple(np.arange(2.0, 10.0))) if wide else NullLocator())
    axis.set_minor_formatter(NullFormatter())
