"""Sliding innovation filters as members of an interacting multiple model filter."""

from __future__ import annotations

import numpy as np

from sim.loop.build import build
from sim.loop.closed_loop import run
from sim.scenario.files import load

MODES = [[], [{"kind": "float", "wheel": 1}]]


def test_an_imm_of_sliding_innovation_filters_finds_the_mode() -> None:
    fault = {"kind": "float", "wheel": 1, "start_s": 6.0, "duration_s": 10.0}
    members = {f"imm-{kind}": {"type": "imm", "filter": {"type": kind}, "modes": MODES} for kind in ("sif", "ekf")}
    changes = {
        "run.ticks": 160,
        "run.seed": 4711,
        "observers": members,
        "faults": [fault],
        "control.feedback": "imm-sif",
        "published": None,
    }
    recording = run(build(load("nacs/wheel-failure", changes), np.arange(2)))
    faulty = 1.0 - recording.channels["imm-sif/modes"][..., 0]
    assert (faulty[20:60] < 0.5).all()
    assert (np.mean(faulty[100:], axis=0) > 0.9).all()
    assert recording.channels["imm-sif/declared"][100:].any(axis=0).all()
    apart = recording.channels["imm-sif/mean"] - recording.channels["imm-ekf/mean"]
    assert np.abs(apart).max() > 1e-6  # another filter
    assert np.isfinite(apart).all()
