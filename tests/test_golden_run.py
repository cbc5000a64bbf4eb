"""The figures of one whole run, metric by metric, as they were when they were written down.

Nothing says that they are right; they say that nothing has moved. They are written anew, only when numbers change on purpose, by

    python -m tests.test_golden_run > tests/golden_run.json

The tolerance is 1e-6 of a figure. Kernels of BLAS differ in the last bits of a product, which a stable loop does not let grow: those of
OpenBLAS for Prescott, Sandy Bridge and Haswell give the same ten digits after these eight seconds. What one bit can turn over is left out:
no filter here switches by a threshold, and what declares faults has no figure.
"""

from __future__ import annotations

import json
import sys
from pathlib import Path

import numpy as np

from sim.loop.build import build
from sim.loop.closed_loop import run
from sim.metrics.one_body import evaluate
from sim.scenario.files import load

FIGURES = Path(__file__).with_name("golden_run.json")
MODES = [[], [{"kind": "float", "wheel": 2}], [{"kind": "lock", "wheel": 4}]]
SETTINGS = {
    "run.ticks": 80,
    "run.seed": 20240817,
    "observers": {
        "ekf": {"type": "ekf"},
        "mekf": {"type": "mekf"},
        "ukf": {"type": "ukf"},
        "sif": {"type": "sif"},
        "imm": {"type": "imm", "filter": {"type": "mekf"}, "modes": MODES},
    },
    "control.feedback": "mekf",
    "sensors": {"set": "bench", "dropout_probability": 0.05, "latency_s": 0.03, "attitude_resolution_rad": 1e-4},
    "faults": [
        {"kind": "external-torque", "torque_nm": {"uniform": [0.005, 0.010]}, "direction": "planar", "start_s": 2.0, "duration_s": 0.5},
        {"kind": "float", "wheel": 2, "start_s": 4.0, "duration_s": 2.0},
    ],
}
DECIDED = ("fault", "missed_f", "missed_w", "false_", "silent", "detection", "peak_statistic")


def figures() -> dict[str, list[float | None]]:
    """Each metric of both trials; None where there is no number."""
    system = build(load("nacs/disturbance", SETTINGS), np.arange(2))
    found = evaluate(run(system), system.plant.assembly)
    kept = [m for m in found if m.phase in {"all", "fault"} and not m.metric.startswith(DECIDED)]
    return {" ".join((m.subject, m.metric, m.phase, m.unit)): [float(v) if np.isfinite(v) else None for v in m.values] for m in kept}


def test_the_figures_of_a_run_are_where_they_were() -> None:
    was, found = json.loads(FIGURES.read_text()), figures()
    assert list(found) == list(was)
    for name, values in found.items():
        np.testing.assert_allclose(np.array(values, float), np.array(was[name], float), rtol=1e-6, atol=1e-12, err_msg=name)


if __name__ == "__main__":
    lines = [f"  {json.dumps(name)}: {json.dumps([v and float(f'{v:.10g}') for v in values])}" for name, values in figures().items()]
    sys.stdout.write("{\n" + ",\n".join(lines) + "\n}\n")
