"""Friction of wheels over a step: closed forms, stopping and sticking, sensitivities; and filters that believe in it."""

from __future__ import annotations

import numpy as np
import pytest

from models.dynamics.process import predict, predict_euler, runge_kutta
from models.dynamics.wheel_drag import WheelDrag
from models.dynamics.wheeled_body import WheeledBody
from models.plants.register.entries import KINDS
from sim.loop.build import build
from sim.loop.closed_loop import run
from sim.scenario.files import load

WHEEL = 1.74e-5  # kg m2
NACS = KINDS["nacs"]


def end(drag: WheelDrag, speed: float, acceleration: float, dt: float) -> float:
    """Speed after a step in which all else gives a constant acceleration."""
    torque = drag.over(np.array([speed]), np.array([acceleration]), dt).torque[0]
    return float(speed + (acceleration - drag.response[0] * torque) * dt)


def test_a_wheel_that_is_driven_through_rest_turns_the_other_way_against_friction() -> None:
    """20 rad/s, -2 mN m against 0.5 mN m: at rest after 20 J / 2.5e-3, then -1.5e-3 / J for the rest of the second."""
    drag = WheelDrag(5e-4, 0.0, np.array([1.0 / WHEEL]))
    rest = 20.0 * WHEEL / 2.5e-3
    assert end(drag, 20.0, -2e-3 / WHEEL, 1.0) == pytest.approx(-1.5e-3 / WHEEL * (1.0 - rest))
    assert end(drag, -20.0, 2e-3 / WHEEL, 1.0) == pytest.approx(1.5e-3 / WHEEL * (1.0 - rest))


@pytest.mark.parametrize("share", [0.0, 0.5, 0.95, -0.95])
@pytest.mark.parametrize("speed", [0.0, 0.3, -2.0])
def test_a_wheel_that_comes_to_rest_sticks_under_less_than_dry_friction(share: float, speed: float) -> None:
    drag = WheelDrag(1e-3, 0.0, np.array([1.0 / WHEEL]))
    assert end(drag, speed, share * 1e-3 / WHEEL, 1.0) == pytest.approx(0.0, abs=1e-12)


def test_beyond_dry_friction_a_wheel_breaks_away() -> None:
    drag = WheelDrag(1e-3, 0.0, np.array([1.0 / WHEEL]))
    assert end(drag, 0.0, 1.05e-3 / WHEEL, 1.0) == pytest.approx(0.05e-3 / WHEEL)


def test_viscous_friction_slows_exponentially() -> None:
    """domega/dt = a - k omega, from 100 rad/s, with and without dry friction."""
    rate = 1e-5 / WHEEL
    for dry in (0.0, 2e-4):
        drag = WheelDrag(dry, 1e-5, np.array([1.0 / WHEEL]))
        final = (3.0 - dry / WHEEL) / rate
        assert end(drag, 100.0, 3.0, 0.7) == pytest.approx(final + (100.0 - final) * np.exp(-0.7 * rate))


def test_sensitivities_are_those_of_the_torque() -> None:
    random = np.random.default_rng(3)
    speed, acceleration = random.normal(0.0, 3.0, 400), random.normal(0.0, 60.0, 400)
    drag, small = WheelDrag(5e-4, 1e-6, np.full(400, 1.0 / WHEEL)), 1e-6
    by_speed = (drag.over(speed + small, acceleration, 0.1).torque - drag.over(speed - small, acceleration, 0.1).torque) / (2 * small)
    by_push = (drag.over(speed, acceleration + small, 0.1).torque - drag.over(speed, acceleration - small, 0.1).torque) / (2 * small)
    np.testing.assert_allclose(drag.over(speed, acceleration, 0.1).by_speed, by_speed, atol=2e-9)
    np.testing.assert_allclose(drag.over(speed, acceleration, 0.1).by_acceleration, by_push, atol=2e-9)


def body(coulomb: float) -> WheeledBody:
    return NACS.believed(NACS.parameters(wheel_coulomb_nm=coulomb), True, None)  # type: ignore[return-value]


@pytest.mark.parametrize("coulomb", [0.0, 1e-5, 5e-4, 5e-3])
@pytest.mark.parametrize("dt", [0.005, 0.1, 0.5])
def test_the_model_stays_stable_and_its_jacobian_is_its_own(coulomb: float, dt: float) -> None:
    random, model = np.random.default_rng(8), body(coulomb)
    attitude = random.standard_normal((60, 4))
    state = np.concatenate(
        [
            attitude / np.linalg.norm(attitude, axis=-1, keepdims=True),
            random.standard_normal((60, 3)) * random.choice([0.1, 1.0, 10.0], (60, 1)),
            random.standard_normal((60, 4)) * random.choice([0.3, 3.0, 100.0], (60, 1)),
        ],
        axis=-1,
    )
    command, small = 1e-3 * random.standard_normal((60, 4)), 1e-6
    found = predict(model, state, command, dt)
    np.testing.assert_allclose(found.state, runge_kutta(model, state, command, dt), rtol=1e-12, atol=1e-12)
    np.testing.assert_allclose(np.linalg.norm(found.state[:, :4], axis=-1), 1.0, rtol=2e-6)
    columns = [
        (runge_kutta(model, state + small * e, command, dt) - runge_kutta(model, state - small * e, command, dt)) / (2 * small)
        for e in np.eye(11)
    ]
    np.testing.assert_allclose(found.transition, np.stack(columns, axis=-1), atol=1e-5)


@pytest.mark.parametrize("coulomb", [1e-4, 5e-4, 2e-3, 5e-3])
@pytest.mark.parametrize("dt", [0.005, 0.1, 0.5])
@pytest.mark.parametrize("step", [runge_kutta, lambda *given: predict_euler(*given).state], ids=["runge-kutta", "euler"])
def test_wheels_run_down_and_stand_still(coulomb: float, dt: float, step) -> None:
    model, start = body(coulomb), 0.4 * coulomb / WHEEL
    state = np.concatenate([[0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0], start * np.array([1.0, -0.5, 0.2, 0.0])])
    for _ in np.arange(0.0, 1.0, dt):
        state = step(model, state, np.zeros(4), dt)
    np.testing.assert_allclose(state[7:], 0.0, atol=1e-3 * start)


@pytest.mark.parametrize("coulomb", [1e-4, 5e-4, 2e-3])
def test_filters_are_as_sure_as_they_may_be_whatever_the_friction(coulomb: float) -> None:
    """While a wheel sticks its drive's errors do nothing, so that filters are rather too careful; before, NEES reached 580."""
    recording = run(build(load("nacs/fault-free", {"run.ticks": 250, "run.seed": 77, "plant.wheel_coulomb_nm": coulomb}), np.arange(4)))
    for name in ("ekf", "mekf"):
        assert 7.0 < np.mean(recording.channels[f"{name}/nees"][20:]) < 11.0
        assert 9.0 < np.mean(recording.channels[f"{name}/nis"][20:]) < 11.0
    for name in ("nis-windowed", "nis-fading"):
        assert np.mean(recording.channels[f"{name}/declared"]) < 0.01
