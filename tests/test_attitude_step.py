"""Attitude over a step of a model, against a fine integration by another library."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from models.attitude import quaternion
from models.dynamics.process import predict, runge_kutta
from models.dynamics.wheeled_body import WheeledBody
from models.plants.register.entries import KINDS


def tumbling() -> tuple[WheeledBody, np.ndarray, np.ndarray, float]:
    kind = KINDS["nacs"]
    body = kind.believed(kind.parameters(wheel_coulomb_nm=0.0, wheel_viscous_nms=0.0), True, None)
    return body, np.array([0.6, -0.5, 0.62]), np.array([1e-3, -1e-3, 5e-4, 2e-4]), 0.1  # type: ignore[return-value]


@pytest.mark.parametrize("speed", [0.5, 3.0, 10.0, 30.0])
def test_a_fast_turn_is_followed(speed: float) -> None:
    model, direction, command, dt = tumbling()
    start = np.concatenate([quaternion.IDENTITY, speed * direction, [100.0, -50.0, 20.0, 70.0]])
    fine = solve_ivp(lambda _, x: model.derivative(x, command), (0.0, dt), start, method="DOP853", rtol=1e-13, atol=1e-13).y[:, -1]
    found = runge_kutta(model, start, command, dt)
    assert quaternion.angle(found[:4], fine[:4]) < 4e-6
    np.testing.assert_allclose(found[4:7], fine[4:7], atol=1e-5)


def test_a_state_is_stepped_the_same_whatever_turns_beside_it() -> None:
    model, direction, command, dt = tumbling()
    speeds = np.array([0.1, 3.9, 4.1, 30.0, np.nan])
    states = np.concatenate([np.tile(quaternion.IDENTITY, (5, 1)), speeds[:, None] * direction, np.full((5, 4), 10.0)], axis=-1)
    together = predict(model, states, np.tile(command, (5, 1)), dt)
    for one in np.arange(5):
        alone = predict(model, states[one : one + 1], command[None], dt)
        np.testing.assert_array_equal(together.state[one], alone.state[0])
        np.testing.assert_array_equal(together.transition[one], alone.transition[0])
