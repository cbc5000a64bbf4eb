"""The four loops of Hill et al. (2021) and reallocation, flown whole: what docs/imm.md says of them, on a seed of its own."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from sim.campaign.blocks import simulate
from sim.scenario.files import load

LOOPS = ("pd-ukf", "pd-imm", "smc-ukf", "smc-imm", "pd-imm-realloc", "smc-imm-realloc")
Values = dict[tuple[str, str, str], NDArray[np.floating]]


@pytest.fixture(scope="module")
def flown() -> tuple[Values, dict[str, NDArray[np.floating]]]:
    scenario = load("wmap/compare", {"run.seed": 60661})
    scenario = scenario.model_copy(update={"loops": {name: scenario.loops[name] for name in LOOPS}})
    shard = simulate(scenario, np.arange(2), np.arange(2))
    modes = {name: 1.0 - r.channels["imm/modes"][..., 0] for name, r in shard.recordings.items() if "imm" in name}
    return {m[:3]: m.values for m in shard.metrics}, modes


def test_before_the_fault_blended_gains_are_the_healthy_ones(flown) -> None:
    found, _ = flown
    for law, theta, psi in (("pd", (0.15, 0.19), (16.3, 17.5)), ("smc", (0.08, 0.13), (7.2, 7.8))):
        for angle, (low, high) in (("theta", theta), ("psi", psi)):
            constant, blended = (found[f"{law}-{kind}", f"rmse_{angle}_deg", "nominal"] for kind in ("ukf", "imm"))
            assert (constant > low).all()
            assert (constant < high).all()
            np.testing.assert_allclose(np.mean(blended), np.mean(constant), rtol=0.05)


def test_after_the_fault_blended_gains_are_better_and_reallocation_better_still(flown) -> None:
    found, _ = flown
    theta = {name: found[name, "rmse_theta_deg", "fault"] for name in LOOPS}
    assert (theta["pd-ukf"] / theta["pd-imm"] > 1.4).all()
    assert (theta["smc-ukf"] / theta["smc-imm"] > 4.0).all()
    assert (theta["smc-imm"] < 0.1).all()
    assert (theta["pd-ukf"] / theta["pd-imm-realloc"] > 12.0).all()
    assert np.mean(theta["smc-ukf"]) / np.mean(theta["smc-imm-realloc"]) > 8.0


def test_the_mode_is_found_and_only_then(flown) -> None:
    found, modes = flown
    for name, limit in (("pd-imm", 30.0), ("smc-imm", 60.0)):
        assert (found[name, "detection_delay_s", "all"] < limit).all()
        assert np.max(modes[name][100:4500]) < 0.1
        assert (np.mean(modes[name][5100:], axis=0) > 0.9).all()
        assert (found[name, "lost_definiteness", "all"] == 0).all()


def test_a_fault_that_the_allocation_latched_is_shown_as_found(flown) -> None:
    found, modes = flown
    for name in ("pd-imm-realloc", "smc-imm-realloc"):
        assert (found[name, "missed_fraction", "all"] == 0).all()
        assert (found[name, "detection_delay_s", "all"] < 60.0).all()
        assert (found[name, "false_alarm_fraction", "all"] == 0).all()
        late = 4500 + np.argmax(modes[name][4500:] > 0.7, axis=0)  # the latch closes ten ticks after this at the earliest
        assert (found[name, "detection_delay_s", "all"] >= 0.1 * (late - 4500)).all()


def test_efforts(flown) -> None:
    found, _ = flown
    for axis in "xyz":
        assert found["smc-imm", f"effort_rms_{axis}", "all"] == pytest.approx(1.0, abs=5e-4)
        assert found["smc-ukf", f"effort_rms_{axis}", "all"] == pytest.approx(1.0, abs=5e-4)
    for axis in "xy":
        assert (found["pd-imm", f"effort_rms_{axis}", "all"] <= found["pd-ukf", f"effort_rms_{axis}", "all"]).all()
