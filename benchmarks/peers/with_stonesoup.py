"""The extended Kalman filter of Stone Soup on the twin's analytic model, trial by trial."""

from __future__ import annotations

import time
from datetime import datetime, timedelta
from typing import Any

import numpy as np
from numpy.typing import NDArray
from stonesoup.base import Property  # type: ignore[import-untyped]  # has no types
from stonesoup.models.base import GaussianModel  # type: ignore[import-untyped]  # the same
from stonesoup.models.measurement.linear import LinearGaussian  # type: ignore[import-untyped]  # the same
from stonesoup.models.transition import TransitionModel  # type: ignore[import-untyped]  # the same
from stonesoup.predictor.kalman import ExtendedKalmanPredictor  # type: ignore[import-untyped]  # the same
from stonesoup.types.detection import Detection  # type: ignore[import-untyped]  # the same
from stonesoup.types.hypothesis import SingleHypothesis  # type: ignore[import-untyped]  # the same
from stonesoup.types.state import GaussianState  # type: ignore[import-untyped]  # the same
from stonesoup.updater.kalman import ExtendedKalmanUpdater  # type: ignore[import-untyped]  # the same

from benchmarks.peers.conversation import Arrays, answer
from models.dynamics.process import predict
from models.dynamics.wheeled_body import WheeledBody

START = datetime(2024, 1, 1)  # any


class Wheeled(TransitionModel, GaussianModel):  # type: ignore[misc]  # has no types
    """The twin's Runge-Kutta step under the present command; its transition matrix is kept, so that the model is evaluated once a step."""

    process: WheeledBody = Property(doc="analytic model")
    noise: NDArray[np.floating] = Property(doc="Q of a step")
    command: NDArray[np.floating] = Property(default=None, doc="wheel torques, N m")

    @property
    def ndim_state(self) -> int:
        """Number of states."""
        return self.process.size

    def function(self, state: Any, *, time_interval: timedelta, **_: Any) -> Any:
        """The state after the interval."""
        mean, self._transition = predict(self.process, state.state_vector[:, 0], self.command, time_interval.total_seconds())
        return mean[:, None].view(type(state.state_vector))

    def jacobian(self, _state: Any, **_: Any) -> NDArray[np.floating]:
        """Of the function just evaluated."""
        return self._transition

    def covar(self, **_: Any) -> NDArray[np.floating]:
        """Q."""
        return self.noise


def extended(asked: Arrays) -> Arrays:
    """Follow the readings (ticks, trials, n) under the commands (ticks, trials, wheels); the estimates, (ticks, trials, n)."""
    readings, commands = asked["readings"], asked["commands"]
    size, tick = readings.shape[-1], timedelta(seconds=float(asked["dt"]))
    model = Wheeled(WheeledBody(asked["inertia"], asked["wheel_axes"], float(asked["wheel_inertia"])), asked["Q"])
    predictor = ExtendedKalmanPredictor(model)
    updater = ExtendedKalmanUpdater(LinearGaussian(size, list(range(size)), asked["R"]), use_joseph_cov=True)
    means, seconds = readings.copy(), 0.0
    for trial in range(readings.shape[1]):
        belief = GaussianState(readings[0, trial, :, None], asked["R"], START)
        start = time.process_time()
        for k in range(1, len(readings)):
            model.command, now = commands[k, trial], START + k * tick
            predicted = predictor.predict(belief, timestamp=now)
            reading = readings[k, trial].copy()
            if reading[:4] @ predicted.mean[:4, 0] < 0:  # the quaternion of either sign
                reading[:4] *= -1.0
            belief = updater.update(SingleHypothesis(predicted, Detection(reading[:, None], timestamp=now)))
            belief.state_vector[:4] /= np.linalg.norm(belief.state_vector[:4])
            means[k, trial] = belief.state_vector[:, 0]
        seconds += time.process_time() - start
    return {"seconds": np.array(seconds), "means": means}


if __name__ == "__main__":
    answer({"extended": extended})
