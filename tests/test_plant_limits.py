"""What a plant cannot do, or cannot do for long, is said before it is flown; right values by hand."""

from __future__ import annotations

import numpy as np
import pytest

from sim.bad_input import BadInput
from sim.scenario.catalogue import SCENARIOS
from sim.scenario.files import load

LEAN_40 = [float(np.sin(np.radians(20.0))), 0.0, 0.0, float(np.cos(np.radians(20.0)))]
YAW_170 = [0.0, 0.0, float(np.sin(np.radians(85.0))), float(np.cos(np.radians(85.0)))]
NO_LOAD = 11.76 / 0.01404  # rad/s: supply voltage over motor constant
DISC = 2 * 9.29e-6  # kg m2: the wheel of this transverse inertia that has no thickness


@pytest.mark.parametrize(
    ("name", "setting", "value", "complaint"),
    [
        ("nacs/fault-free", "start.quaternion", LEAN_40, "start: is tilted by 40 deg, and the stop is at 30 deg"),
        ("nacs/fault-free", "start.quaternion", [1.0, 0.0, 0.0, 0.0], "start: is tilted by 180 deg"),
        ("nacs/three-rates", "start.euler_313_deg", [10.0, 31.0, 0.0], "start: is tilted by 31 deg"),
        ("nacs/fault-free", "reference.amplitude_deg", [45.0, 0.0, 0.0], "reference: is tilted by 45 deg"),
        ("nacs/fault-free", "reference", {"type": "hold", "rotation_vector_deg": [0.0, -33.0, 0.0]}, "reference: is tilted by 33 deg"),
        ("nacs/fault-free", "reference", {"type": "euler-rates", "nutation_deg": 60.0, "precession_rev_h": 1.0, "spin_rpm": 0.1}, "60 deg"),
        ("formation/nacs", "start.mrp", [[float(np.tan(np.radians(10.0))), 0.0, 0.0]] * 6, "start.mrp: is tilted by 40 deg"),
        ("formation/nacs", "leader.radius", 0.2, "leader: is tilted by 40.34 deg"),  # 2 asin(2 r / (1 + 4 r2)), docs/formation.md: 40 deg
        (
            "nacs/fault-free",
            "start.wheel_speed_rad_s",
            [0.0, 0.0, -838.0, 0.0],
            "838 rad/s is beyond the no-load speed of the drives, 837.6",
        ),
        ("nacs/fault-free", "plant.wheel_inertia_kg_m2", 1.9e-5, "wheel_inertia_kg_m2 = 1.9e-05 must not exceed twice"),
        ("formation/nacs", "plant.testbed.wheel_inertia_kg_m2", 1.9e-5, "wheel_inertia_kg_m2 = 1.9e-05 must not exceed twice"),
        ("wmap/compare", "plant.wheel_inertia_kg_m2", 0.105, "wheel_inertia_kg_m2 = 0.105 must not exceed twice"),
    ],
)
def test_what_a_plant_cannot_do_is_refused(name: str, setting: str, value: object, complaint: str) -> None:
    with pytest.raises(BadInput) as refused:
        load(name, {setting: value})
    assert complaint in str(refused.value)
    assert "\n" not in str(refused.value)


@pytest.mark.parametrize(
    ("setting", "value"),
    [
        ("start.quaternion", YAW_170),  # heading is free, and so is what leans less than the stop
        ("start.euler_313_deg", [120.0, 29.9, -40.0]),
        ("reference.amplitude_deg", [20.0, 20.0, 60.0]),
        ("start.wheel_speed_rad_s", [0.0, 0.0, -0.999 * NO_LOAD, 0.0]),
        ("plant.wheel_inertia_kg_m2", 0.999 * DISC),
    ],
)
def test_what_a_plant_can_just_do_is_flown(setting: str, value: object) -> None:
    assert load("nacs/fault-free", {setting: value})


def test_a_spacecraft_has_no_stop() -> None:
    assert load("wmap/compare", {"start.euler_313_deg": [0.0, 180.0, 0.0], "start.wheel_speed_rad_s": [900.0, 0.0, 0.0, 0.0]})


@pytest.mark.parametrize(("share", "warned"), [(0.98, False), (1.02, True)])
def test_a_body_that_has_more_momentum_than_its_wheels_can_hold_is_said_so(share: float, warned: bool) -> None:
    """Four wheels of a pyramid share a yaw rate w alike: J w / (4 a) each, a their axes' part along z."""
    changes = {"plant.inertia_kg_m2": [0.02, 0.02, 0.03, 0.0, 0.0, 0.0]}
    along_z = np.abs(load("nacs/fault-free", changes).plant.wheel_axes[2])
    np.testing.assert_allclose(along_z, along_z[0])
    holds = 1.740138e-5 * NO_LOAD
    rate = share * 4.0 * along_z[0] * holds / 0.03
    # q_3 = s sin(2 pi t / T) turns by 2 asin(q_3), at 2 s (2 pi / T) cos / sqrt(1 - s2 sin2): fastest where the angle is zero, 4 pi s / T
    swing = {"amplitude_deg": [0.0, 0.0, 60.0], "period_s": [1.0, 1.0, 4.0 * np.pi * np.sin(np.radians(30.0)) / rate]}
    cases = {
        "start": ({"start.rate_rad_s": [0.0, 0.0, rate]}, {"start.rate_deg_s": [0.0, 0.0, -float(np.degrees(rate))]}),
        "reference": ({"reference.amplitude_deg": swing["amplitude_deg"], "reference.period_s": swing["period_s"]},),
    }
    for what, ways in cases.items():
        for way in ways:
            said = [line for line in load("nacs/fault-free", changes | way).warnings() if line.startswith(f"{what}: ")]
            assert len(said) == warned
            assert not warned or f"asks {share * holds:.3g} N m s of a wheel, which holds {holds:.3g}" in said[0]


@pytest.mark.parametrize("name", sorted(f"nacs/{path.stem}" for path in SCENARIOS.glob("nacs/*.toml")))
def test_no_shipped_scenario_asks_for_more_than_its_plant_has(name: str) -> None:
    assert not [line for line in load(name).warnings() if line.startswith(("start:", "reference:", "run:"))]
