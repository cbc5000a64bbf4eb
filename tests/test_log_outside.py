"""A log that SciPy made, read by the twin: filters are consistent with it, in NEES and NIS, and it does not look wrong."""

from __future__ import annotations

from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from models.plants.assembly import Assembly
from sim.loop.build import assembly_of, build_estimators
from sim.replay.flight_log import read
from sim.replay.log_columns import columns_of
from sim.replay.plausibility import complaints
from sim.replay.replay import replay
from sim.replay.setting import choose, setting
from sim.user_code.user_code import UserCode
from tests.scipy_log import Body, Expected, fly, write

SPEEDS = (0.5, 1.1, 3.0, 10.0)  # rad/s
TICK = 0.1  # s
NO_FRICTION = {"plant.wheel_coulomb_nm": 0.0, "plant.wheel_viscous_nms": 0.0}


@cache
def scenario() -> Any:
    return setting({}, "log", None, {"run.tick_s": TICK} | NO_FRICTION)


def expected(name: str) -> Expected:
    """What a filter says of itself: its covariance after the first reading is R; from none, where nothing has time to move, Q."""
    (own,) = build_estimators(choose(scenario(), {}, "loop", [name])[0], np.zeros(1, np.int64), UserCode(), "loop")
    rest = np.concatenate([[[0.0, 0.0, 0.0, 1.0]], np.zeros((1, 7))], axis=1)
    first = own.initial(rest)
    after = own.step(first._replace(covariance=0.0 * first.covariance), np.zeros((1, 8)), np.full_like(rest, np.nan), 1e-12)
    both = [np.diagonal(own.space.reduce(one.mean, one.covariance)[0, 0]) for one in (after, first)]
    return Expected(*both)


@pytest.mark.parametrize("speed", SPEEDS)
def test_a_log_that_scipy_made_is_consistent(speed: float, tmp_path: Path) -> None:
    plant: Assembly = assembly_of(scenario())
    body = Body(plant.inertia, plant.wheel_axes, plant.wheel_inertia)
    flight = fly(body, expected("mekf"), speed, ticks=80, trials=80, tick_s=TICK, seed=round(10 * speed))
    (log,) = read(write(tmp_path / "log.parquet", flight), columns_of(scenario()))
    assert complaints(log, scenario()) == []
    channels = replay(log, choose(scenario(), {}, "loop", ["mekf"])[0], UserCode()).recording.channels
    nees, nis, dof = (channels[f"mekf/{part}"][1:] for part in ("nees", "nis", "dof"))
    assert np.mean(nees) == pytest.approx(10.0, rel=0.05)
    assert np.nansum(nis) / np.sum(dof) == pytest.approx(1.0, abs=0.05)
    assert 5.5 < np.mean(dof) < 10.0  # components were missing, or the test would not see them counted


def test_the_maker_keeps_what_physics_keeps() -> None:
    """Torques between body and wheels move nothing of the whole: its angular momentum stays where it is in N."""
    plant: Assembly = assembly_of(scenario())
    body = Body(plant.inertia, plant.wheel_axes, plant.wheel_inertia)
    flight = fly(body, Expected(np.zeros(10), np.zeros(10)), 10.0, ticks=3, trials=4, tick_s=1.0, seed=1)
    own = flight.rate @ body.inertia.T + body.wheel_inertia * flight.wheel @ body.axes.T
    fixed = np.stack([Rotation.from_quat(q).apply(h) for q, h in zip(flight.quaternion, own, strict=True)])
    assert np.abs(fixed - fixed[0]).max() < 1e-8 * np.abs(fixed).max()
    assert np.abs(own - own[0]).max() > 0.1 * np.abs(own).max()
