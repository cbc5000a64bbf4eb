"""Tables of a cross-check for a person at a terminal, 80 columns wide."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from rich.box import SIMPLE_HEAD
from rich.table import Table
from rich.text import Text

from sim.crosscheck.attribution import SUPERPOSE, size_deg
from sim.crosscheck.divergence import passes, rms
from sim.crosscheck.study import CrossCheck
from sim.text.table_style import counted

Array = NDArray[np.floating]

LARGE_DEG = 60.0  # turns beyond do not add as vectors


def _table(title: str, caption: str | Text) -> Table:
    look = {"title_justify": "left", "title_style": "bold", "caption_justify": "left", "caption_style": "dim"}
    return Table(title=title, caption=caption, box=SIMPLE_HEAD, padding=(0, 0, 0, 1), pad_edge=False, width=80, **look)  # type: ignore[arg-type]


def number(value: float) -> str:
    """Three digits; nothing for what does not exist."""
    if not np.isfinite(value):
        return "-"
    return f"{value:.1e}" if value and (abs(value) < 1e-3 or abs(value) >= 1e5) else f"{value:.3g}"


def _short(value: float) -> str:
    """Narrow: two digits of what is small, one of what is very small."""
    if value and abs(value) < 1e-3:
        return f"{value:.0e}"
    return f"{value:.2g}" if 1e-3 <= abs(value) < 1e-2 else number(value)


def _percent(share: float) -> str:
    """One decimal, without the sign of a zero."""
    return f"{100 * share:.1f}".replace("-0.0", "0.0") if abs(share) < 5e-4 else f"{100 * share:.1f}"


def verdict(good: bool, yes: str, no: str) -> Text:
    """In green or red."""
    return Text(yes, style="green") if good else Text(no, style="bold red")


def _moment(values: Array) -> str:
    """Median of instants, and whether some never came."""
    reached = values[np.isfinite(values)]
    if not len(reached):
        return "never"
    return f"{np.median(reached):.3g}" + ("" if len(reached) == len(values) else "*")


def divergence_table(found: CrossCheck) -> Table:
    """When each quantity passes its threshold, and how large it is at the stated instants and at the end."""
    trials, last = found.states.shape[1], len(found.states) - 1
    shown = tuple(dict.fromkeys((*found.ticks[-4:], last)))
    table = _table(
        f"Divergence of {found.model.name} from the plant, open loop, same commands",
        f"passed: median of {counted(trials, 'trial')} (* not in all); values: RMS over the trials;\n{_relative(found)}",
    )
    table.add_column("quantity", no_wrap=True)
    table.add_column("threshold", justify="right", no_wrap=True)
    table.add_column("passed\n[s]", justify="right")
    for tick in shown:
        table.add_column(f"at\n{found.instant(tick)}", justify="right")
    for quantity in found.quantities:
        values, limit = found.apart[quantity.name], found.thresholds[quantity.name]
        passed = _moment(passes(values, limit, found.tick_s))
        table.add_row(_of_unit(quantity.label, quantity.unit), number(limit), passed, *(_short(float(rms(values)[tick])) for tick in shown))
    return table


def _relative(found: CrossCheck) -> str:
    """What momentum and energy are relative to."""
    if found.states.shape[-1] > 7:
        return "momentum and energy relative to the greatest in the wheels and of the plant"
    return "momentum relative to that at the start, energy to the plant's greatest"


def attribution_table(found: CrossCheck) -> Table:
    """Share of every effect in the attitude divergence, and what is left."""
    causes, shown = found.causes, found.ticks[-4:]
    table = _table("Attribution: shares of the attitude divergence", attribution_verdict(found))
    table.add_column("effect")
    for tick in shown:
        table.add_column(f"{found.instant(tick)}\n%", justify="right")
    table.add_column(f"{found.instant(shown[-1])}\ndeg", justify="right")
    shares = np.stack([causes.shares(tick) for tick in shown], axis=-1)
    sizes = size_deg(causes.contribution[:, shown[-1]])
    for i in np.argsort(-np.abs(sizes)):
        table.add_row(causes.names[i], *(_percent(share) for share in shares[i]), number(float(sizes[i])))
    table.add_section()
    table.add_row("sum of the shares", *(_percent(share) for share in shares.sum(axis=0)), "", style="bold")
    table.add_row("left over, as a vector", *(f"{100 * causes.rest(tick):.1f}" for tick in shown), "")
    table.add_row("sum, each switched on alone", *(f"{100 * causes.shares_alone(tick).sum():.1f}" for tick in shown), "")
    total, euler = (number(float(size_deg(v[shown[-1]]))) for v in (causes.total, causes.euler))
    table.add_row("total divergence, deg", *(number(float(size_deg(causes.total[tick]))) for tick in shown), total, style="bold")
    table.add_row("(Euler in place of RK4, deg)", *(number(float(size_deg(causes.euler[tick]))) for tick in shown), euler, style="dim")
    return table


def attribution_verdict(found: CrossCheck) -> str | Text:
    """Whether the effects superpose, and if not, why."""
    causes = found.causes
    bad = [tick for tick in found.ticks if not causes.superposes(tick)]
    if not bad:
        return f"superpose: at every instant the shares are within {100 * SUPERPOSE:.0f} % of the total, as a sum and as vectors"
    angle = size_deg(causes.total[bad[0]])
    when = ", ".join(found.instant(tick) for tick in bad)
    large = f"the total is a turn of {angle:.0f} deg, and large turns do not add as vectors"
    return Text(f"do not superpose at {when}: {large if angle > LARGE_DEG else 'the effects change one another'}", style="yellow")


def checks_table(found: CrossCheck) -> Table:
    """The plant against textbook physics."""
    failed = sum(not check.passed for check in found.checks)
    table = _table(
        "Physics checks of the plant", f"{len(found.checks) - failed} of {len(found.checks)} pass; figures without a unit are relative"
    )
    for heading, side in (("error of", "left"), ("figure", "right"), ("limit", "right"), ("unit", "left"), ("", "left")):
        table.add_column(heading, justify=side, no_wrap=heading != "error of")  # type: ignore[arg-type]
    for check in found.checks:
        result = verdict(check.passed, "pass", "FAIL")
        table.add_row(f"{check.name}: {check.measure}", f"{check.figure:.1e}", f"{check.tolerance:.0e}", unit(check.unit), result)
    return table


def failures_table(found: CrossCheck) -> Table:
    """What fails as printed, and how."""
    how = "\n".join(f"{failure.variant}: {failure.remark}" for failure in found.failures)
    table = _table("As printed: these must fail", how)
    for heading, side in (("variant", "left"), ("error of", "left"), ("right", "right"), ("printed", "right"), ("limit", "right")):
        table.add_column(heading, justify=side, no_wrap=heading != "error of")  # type: ignore[arg-type]
    table.add_column("when\n[s]", justify="right", no_wrap=True)
    table.add_column("", no_wrap=True)
    for failure in found.failures:
        figures = (number(failure.right), number(failure.printed), number(failure.limit), number(failure.when))
        what = _of_unit(failure.measure, failure.unit)
        table.add_row(failure.variant, what, *figures, verdict(failure.fails, "fails", "HOLDS"))
    return table


def unit(name: str) -> str:
    """Unit of a figure as a person reads it; relative figures have none."""
    return "" if name == "1" else name


def _of_unit(what: str, its_unit: str) -> Text:
    """A quantity with its unit."""
    return Text.assemble(what, " ", (unit(its_unit), "dim"))


def tables(found: CrossCheck) -> tuple[Table, ...]:
    """All that there is to tell."""
    told = divergence_table(found), attribution_table(found), checks_table(found)
    return (*told, failures_table(found)) if found.failures else told
