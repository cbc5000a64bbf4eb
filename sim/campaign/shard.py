"""One block of a campaign's trials: drawn, flown, evaluated and turned into tables that do not depend on how trials are cut into blocks."""

from __future__ import annotations

import json
from typing import NamedTuple

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from models.attitude import quaternion
from models.dynamics.state_layout import ATTITUDE, RATE
from sim.bad_input import BadInput
from sim.campaign.blocks import simulate
from sim.campaign.draws import banded, draw, flown_together, own, picked
from sim.campaign.settings import Campaign
from sim.loop.build import build
from sim.loop.closed_loop import run
from sim.loop.recording import Recording
from sim.metric import Metric
from sim.metrics.one_body import evaluate
from sim.processor import processor
from sim.scenario import files
from sim.scenario.files import AnyScenario

Array = NDArray[np.floating]

BAND_EVERY_TICKS = 10
BINS_PER_DECADE, LOWEST_DECADE, BINS = 40, -8, 640
FIXED_POINT = 2**20  # sums of whole numbers are the same in any order
LARGEST = 1e6  # so that a million trials fit into 63 bits


class Job(NamedTuple):
    """A block of trials at a point of the grid, as it is sent to a worker."""

    campaign: str  # JSON
    scenario: str  # JSON, of the point
    point: int
    start: int
    stop: int


class Tables(NamedTuple):
    """What a block gives: metrics trial by trial, and over its trials counts and whole-number sums."""

    point: int
    start: int
    metrics: pa.Table  # point, trial, seed, subject, metric, phase, unit, value, reason
    bands: pa.Table  # quantity, observer, tick, bin, count
    consistency: pa.Table  # statistic, observer, tick, total, count, freedom
    processor: str  # that computed it


def fly(job: Job) -> Tables:
    """Simulate a block; a trial that breaks down becomes a row with its reason and harms no other."""
    campaign = Campaign.model_validate_json(job.campaign)
    scenario = files.check(json.loads(job.scenario), f"point {job.point}", {})
    trials = np.arange(job.start, job.stop)
    if not banded(scenario, campaign):
        return _fly_as_scenarios(job, campaign, scenario, trials)
    drawn = draw(campaign, scenario, trials)
    system = build(scenario, trials, variants=drawn.variants)
    flown = run(system)
    recording, failures = flown.sound(), {one.trial: str(one) for one in flown.lost}
    alive = np.flatnonzero(~np.isin(trials, list(failures)))
    found = evaluate(recording, system.plant.assembly) if len(alive) else []
    kept = [m for m in found if campaign.keeps(m.metric, m.phase)]
    metrics = _tidy(job.point, campaign, trials, drawn.values, drawn.redrawn, trials[alive], kept, failures)
    whole = recording if len(alive) else None
    return Tables(job.point, job.start, metrics, _bands(whole), _consistency(whole), processor())


def _fly_as_scenarios(job: Job, campaign: Campaign, scenario: AnyScenario, trials: NDArray[np.int64]) -> Tables:
    """Simulate all trials at once, or each as a scenario of its own if they cannot differ within a batch; no bands: loops differ."""
    values, redrawn, failures = list[Array](), list[int](), dict[int, str]()
    found = dict[tuple[str, str, str, str], dict[int, float]]()
    for group in [trials] if flown_together(campaign, scenario) else trials[:, None]:
        try:
            base = own(campaign, scenario, int(group[0]))
        except BadInput as impossible:
            failures[int(group[0])] = str(impossible)
            values, redrawn = [*values, np.array(list(picked(campaign, int(group[0])).values()))], [*redrawn, 0]
            continue
        drawn = draw(campaign, base, group)
        values, redrawn = [*values, *drawn.values], [*redrawn, *drawn.redrawn.tolist()]
        block = simulate(base, group, np.zeros(0, dtype=np.int64), campaign=campaign)
        failures |= {one.trial: str(one) for one in block.lost} | ({int(trial): block.failure for trial in group} if block.failure else {})
        for metric in block.metrics:
            if campaign.keeps(metric.metric, metric.phase):
                found.setdefault(metric.key, {}).update(zip(block.trials.tolist(), metric.values.tolist(), strict=True))
    alive = np.array([trial for trial in trials if int(trial) not in failures], dtype=np.int64)
    metrics = [Metric(*key, np.array([of.get(int(trial), np.nan) for trial in alive])) for key, of in found.items()]
    drawn_values = np.array(values).reshape(len(trials), -1)
    rows = _tidy(job.point, campaign, trials, drawn_values, np.array(redrawn), alive, metrics, failures)
    return Tables(job.point, job.start, rows, _bands(None), _consistency(None), processor())


METRIC_SCHEMA = pa.schema(
    [
        ("point", pa.int32()),
        ("trial", pa.int64()),
        ("seed", pa.int64()),
        ("subject", pa.string()),
        ("metric", pa.string()),
        ("phase", pa.string()),
        ("unit", pa.string()),
        ("value", pa.float64()),
        ("reason", pa.string()),
    ]
)


def _tidy(
    point: int,
    campaign: Campaign,
    trials: NDArray[np.int64],
    drawn: Array,
    redrawn: NDArray[np.int64],
    alive: NDArray[np.int64],
    metrics: list[Metric],
    failures: dict[int, str],
) -> pa.Table:
    """Rows trial by trial: what it drew, whether it failed, and the metrics that apply to it."""
    values = np.stack([m.values for m in metrics], axis=-1) if metrics else np.zeros((len(alive), 0))  # (trials, metrics)
    place = {int(trial): i for i, trial in enumerate(alive)}
    rows: list[tuple[int, str, str, str, str, float, str | None]] = []
    for i, trial in enumerate(int(t) for t in trials):
        rows += [(trial, "draw", key, "all", "", float(v), None) for key, v in zip(campaign.dispersion, drawn[i], strict=True)]
        if redrawn[i]:
            rows.append((trial, "draw", "redrawn", "all", "1", float(redrawn[i]), "impossible plant"))
        reason = failures.get(trial)
        rows.append((trial, "loop", "failed", "all", "1", float(reason is not None), reason))
        if trial in place:
            own = values[place[trial]]
            rows += [(trial, *metrics[j].key, float(own[j]), None) for j in np.flatnonzero(np.isfinite(own))]
    columns = list(zip(*rows, strict=True))
    constant = [[point] * len(rows), columns[0], [campaign.seed] * len(rows), *columns[1:]]
    return pa.table([pa.array(c, t) for c, t in zip(constant, METRIC_SCHEMA.types, strict=True)], schema=METRIC_SCHEMA)


def band_quantities(recording: Recording) -> dict[tuple[str, str], Array]:
    """Positive quantities whose spread over trials is kept, (ticks, trials), by (quantity, observer)."""
    truth = recording.channels["truth/state"][::BAND_EVERY_TICKS]
    out: dict[tuple[str, str], Array] = {}
    desired = recording.channels["reference/q"][::BAND_EVERY_TICKS, None]
    out["tracking_error_deg", "loop"] = np.degrees(quaternion.angle(truth[..., ATTITUDE], desired))
    for name in recording.observers:
        mean = recording.channels[f"{name}/mean"][::BAND_EVERY_TICKS]
        out["attitude_error_deg", name] = np.degrees(quaternion.angle(mean[..., ATTITUDE], truth[..., ATTITUDE]))
        out["rate_error_rad_s", name] = np.sqrt(np.sum((mean[..., RATE] - truth[..., RATE]) ** 2, axis=-1))
        limits = recording.thresholds[name]
        if limits is not None:
            out["statistic_over_threshold", name] = recording.channels[f"{name}/statistic"][::BAND_EVERY_TICKS] / limits[0]
    return out


def bin_values(bins: NDArray[np.int64] | Array) -> Array:
    """Middle of each logarithmic bin; fractions lie between."""
    return 10.0 ** (LOWEST_DECADE + (bins + 0.5) / BINS_PER_DECADE)


def _bands(recording: Recording | None) -> pa.Table:
    """Histograms over trials at every tenth tick, in logarithmic bins."""
    parts: list[dict[str, object]] = []
    for (quantity, observer), values in (band_quantities(recording) if recording is not None else {}).items():
        scaled = BINS_PER_DECADE * (np.log10(np.maximum(values, 10.0**LOWEST_DECADE)) - LOWEST_DECADE)
        known = np.isfinite(scaled)  # what is no number is in no bin
        index = np.clip(np.floor(np.where(known, scaled, 0.0)), 0, BINS - 1).astype(np.int64) + BINS * np.arange(len(values))[:, None]
        cell, count = np.unique(index[known], return_counts=True)
        part = {"tick": BAND_EVERY_TICKS * (cell // BINS), "bin": cell % BINS, "count": count}
        parts.append({"quantity": [quantity] * len(cell), "observer": [observer] * len(cell), **part})
    return _concatenate(parts, ("quantity", "observer", "tick", "bin", "count"))


def _consistency(recording: Recording | None) -> pa.Table:
    """Sums over trials of NEES and NIS, and of the degrees of freedom of NIS, at every tick, in whole numbers."""
    parts: list[dict[str, object]] = []
    for name in recording.observers if recording is not None else ():
        for statistic in ("nees", "nis"):
            assert recording is not None
            values = recording.channels[f"{name}/{statistic}"]
            known = np.isfinite(values)
            total = np.sum(np.round(FIXED_POINT * np.minimum(np.where(known, values, 0.0), LARGEST)).astype(np.int64), axis=1)
            dof = np.where(known, np.nan_to_num(recording.channels[f"{name}/dof"]), 0.0) if statistic == "nis" else np.zeros(values.shape)
            ticks = np.arange(len(values))
            part = {"tick": ticks, "total": total, "count": known.sum(axis=1), "freedom": np.round(np.sum(dof, axis=1)).astype(np.int64)}
            parts.append({"statistic": [statistic] * len(ticks), "observer": [name] * len(ticks), **part})
    return _concatenate(parts, ("statistic", "observer", "tick", "total", "count", "freedom"))


def _concatenate(parts: list[dict[str, object]], names: tuple[str, ...]) -> pa.Table:
    schema = pa.schema([(n, pa.string() if n in ("quantity", "observer", "statistic") else pa.int64()) for n in names])
    return pa.concat_tables([pa.table(part, schema=schema) for part in parts]) if parts else schema.empty_table()


BANDS_SCHEMA, CONSISTENCY_SCHEMA = _bands(None).schema, _consistency(None).schema
