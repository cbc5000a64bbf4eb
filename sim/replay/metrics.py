"""Figures of merit of filters that were run over a log; docs/metrics.md and docs/replay.md define every one."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from models.dynamics.state_layout import SIGMA_RATE
from sim.loop.build import assembly_of
from sim.metric import Metric
from sim.metrics import one_body
from sim.metrics.formation import mean_of_numbers
from sim.metrics.trial_block import TrialBlock, join
from sim.parts import Array
from sim.replay.replay import Replayed, judge


def evaluate(replayed: list[Replayed], scenario: Any) -> list[Metric]:
    """Of every filter in every trial; of a log of several loops the subjects are loop/filter."""
    loops, metrics, shards = list(dict.fromkeys(one.loop for one in replayed)), METRICS[scenario.family], []
    for one in replayed:
        recording, trials = one.recording, one.recording.trials
        found = [metric for metric in metrics(one, scenario) if metric.subject in recording.observers]
        for name in recording.observers:
            fit = judge(one, name)
            extra = {"nis_inside_fraction": np.full(len(trials), fit.nis_inside), "white_fraction": np.full(len(trials), fit.white)}
            if recording.thresholds[name] is not None:
                extra["declared_fraction"] = np.mean(recording.channels[f"{name}/declared"], axis=0)
            found += [Metric(name, metric, "all", "1", values) for metric, values in extra.items()]
        if len(loops) > 1:
            found = [
                metric._replace(subject=one.loop if one.loop == metric.subject else f"{one.loop}/{metric.subject}") for metric in found
            ]
        shards.append(TrialBlock(trials, found, {}))
    return join(shards)[1]


def _of_a_body(one: Replayed, scenario: Any) -> list[Metric]:
    return one_body.evaluate(one.recording, assembly_of(scenario))


def _of_agents(one: Replayed, scenario: Any) -> list[Metric]:  # noqa: ARG001
    """Errors against the truth, where it is known, and consistency; over all agents."""
    channels, out = one.recording.channels, []
    rate = one.layout.places.get("velocity", SIGMA_RATE)
    for name in one.recording.observers:
        wrong = channels[f"{name}/mean"] - channels["truth/state"]
        nis, dof = channels[f"{name}/nis"], channels[f"{name}/dof"]
        values = {"nees_mean": channels[f"{name}/nees"], "nis_mean": nis, "nis_dof_mean": np.where(np.isnan(nis), np.nan, dof)}
        out += [Metric(name, metric, "all", "1", mean_of_numbers(_by_trial(array))) for metric, array in values.items()]
        squares = {"rms_velocity_error": np.sum(wrong[..., rate] ** 2, axis=-1)}
        if "position" in one.layout.places:
            squares["rms_position_error"] = np.sum(wrong[..., one.layout.places["position"]] ** 2, axis=-1)
        out += [
            Metric(name, metric, "all", one.layout.units[-1], np.sqrt(mean_of_numbers(_by_trial(array))))
            for metric, array in squares.items()
        ]
    return out


def _by_trial(channel: Array) -> Array:
    """(ticks, trials, agents) as contiguous (trials, ticks agents)."""
    swapped = np.ascontiguousarray(np.swapaxes(channel, 0, 1))
    return swapped.reshape(len(swapped), -1)


METRICS: dict[str, Callable[[Replayed, Any], list[Metric]]] = {"body": _of_a_body, "formation": _of_agents, "consensus": _of_agents}
