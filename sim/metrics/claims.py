"""What a thesis claims of its filters, held against a run of them; the verdict goes by means over trials."""

from __future__ import annotations

from collections.abc import Iterable
from typing import NamedTuple

import numpy as np

from sim.metrics.results import Row

_LATE = {"100-300": 200.0, "300-500": 200.0, "500-600": 100.0}  # s
_QUIET = {"100-300": 200.0, "300-500": 200.0}  # small noise, where the noise changes
_LOUD = {"500-600": 100.0}


class Claim(NamedTuple):
    """One claim and what became of it."""

    text: str
    printed: str
    found: str
    verdict: str  # "holds", "does not hold" or "not decided": the run lacks the numbers


def gyroless(rows: Iterable[Row]) -> list[Claim]:
    """Claims of Rososhansky (2017, sec. 3.3 and 3.4), by the rows of `monolithic/compare`."""
    found = {(row.subject, row.metric, row.phase): row.mean for row in rows}

    def compare(text: str, printed: str, metric: str, windows: dict[str, float], pf: str, aukf: str, pf_wins: bool = True) -> Claim:
        one, other = (_over(found, name, metric, windows) for name in (pf, aukf))
        said = f"{pf} {one:.3g}, {aukf} {other:.3g} {'rad/s' if metric == 'rms_rate_error' else ''}".rstrip().replace("nan", "-")
        return Claim(text, printed, said, _verdict(one < other if pf_wins else other < one, one, other))

    claims = [
        compare(f"the particle filter estimates the {what} better, {how}", "figures only", metric, _LATE, f"pf-{how}", f"aukf-{how}")
        for how in ("printed", "matched")
        for what, metric in (("rate", "rms_rate_error"), ("attitude", "rms_attitude_error"))
    ]
    for how in ("printed", "matched"):
        times = [found.get((f"{name}-{how}", "time_to_region_s", "state"), np.nan) for name in ("pf", "aukf")]
        said = ", ".join(
            f"{name} {time:.0f} s" if np.isfinite(time) else f"{name} never" for name, time in zip(("pf", "aukf"), times, strict=True)
        )
        fast = bool(np.nan_to_num(times[0], nan=np.inf) < 0.8 * np.nan_to_num(times[1], nan=np.inf))
        known = (f"pf-{how}", "rms_rate_error", "500-600") in found
        claims.append(
            Claim(f"with the particle filter the body is in the region 28 % earlier, {how}", "326.9, 459.7 s", said, _word(fast, known))
        )
    quiet = compare(
        "small noise: the AUKF is better", "figures only", "rms_rate_error", _QUIET, "pf-matched-noise", "aukf-matched-noise", False
    )
    loud = compare(
        "large noise: the particle filter is better", "figures only", "rms_rate_error", _LOUD, "pf-matched-noise", "aukf-matched-noise"
    )
    plain = compare(
        "large noise: the particle filter is better than an unscented one that does not fade",
        "not said",
        "rms_rate_error",
        _LOUD,
        "pf-matched-noise",
        "ukf-matched-noise",
    )
    return [*claims, quiet, loud, plain]


CLAIMS = {"gyroless": gyroless}


def _over(found: dict[tuple[str, str, str], float], subject: str, metric: str, windows: dict[str, float]) -> float:
    """Root mean square over several windows, of theirs."""
    squares = [span * found.get((subject, metric, name), np.nan) ** 2 for name, span in windows.items()]
    return float(np.sqrt(np.sum(squares) / sum(windows.values())))


def _verdict(true: bool, *numbers: float) -> str:
    return _word(true, bool(np.isfinite(numbers).all()))


def _word(true: bool, known: bool) -> str:
    return "not decided" if not known else "holds" if true else "does not hold"
