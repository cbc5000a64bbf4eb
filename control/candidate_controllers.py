"""The controller to switch to: the nearest one that no test, past or present, has falsified."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from control import conics
from control.falsification import DAMPING_PARABOLA, tightened

Array = NDArray[np.floating]

ON_THE_EDGE = 1e-9  # candidates lie on the damping parabola up to rounding


class Choice(NamedTuple):
    """Where to switch to."""

    theta: Array  # (2,) without unit
    from_grid: bool  # no intersection was fit


@dataclass(frozen=True)
class CandidateSearch:
    """Candidates are where tightened tests meet, as in fig. 3 of Tsao, Brozenec & Safonov; those outside the region are discarded.

    Each conic is used in coordinates relative to the present theta, so that "nearest" (the seed does not say in which units) means
    the least relative change of the two gains: in raw units theta_2, which is 1e3 times larger, would alone decide.
    The parabola 2 theta_1 J^ = theta_2^2 is damping 0.707 of J^ s^2 + C_d s + C_p, since damping^2 = theta_2^2 / (4 theta_1 J^): the
    seed's third constraint, 2 theta_1 J^ - theta_2^2 < 0, as printed, asks for more than that.

    Attributes:
      margins: shares of the integral of y^2 by which tests are tightened, tried in turn.
      frequencies: of the grid tried at last, natural frequency / lambda.
      dampings: of that grid, with inertia J^.
    """

    margins: tuple[float, ...] = (0.3, 0.06, 0.012)
    frequencies: tuple[float, ...] = tuple(np.geomspace(0.02, 1.0, 41).tolist())
    dampings: tuple[float, ...] = tuple(np.linspace(0.75, 2.0, 26).tolist())

    def nearest(self, theta: Array, present: Array, past: Array, lower: Array, upper: Array) -> Choice | None:
        """Next controller, or None; theta (2,), present tests (2, 3, 3), past (n, 2, 3, 3), box lower and upper (2,)."""
        scale = np.append(theta, 1.0)
        scaling = scale[:, None] * scale
        present, past, parabola = present * scaling, past * scaling, DAMPING_PARABOLA * scaling
        every = np.concatenate([present, past.reshape(-1, 3, 3)])
        box = np.stack([lower, upper]) / theta
        for margin in self.margins:
            now, before = tightened(present, margin), tightened(past, margin).reshape(-1, 3, 3)
            met = np.concatenate([before, parabola[None], now[1:]])
            meeting = np.concatenate([conics.intersections(now[0], met), conics.intersections(now[1], met[:-1])]).reshape(-1, 2)
            best = _nearest_fit(meeting[np.isfinite(meeting[:, 0])], every, parabola, box)
            if best is not None:
                return Choice(best * theta, from_grid=False)
        frequency, damping = np.meshgrid(self.frequencies, self.dampings, indexing="ij")
        grid = np.stack([frequency**-2.0, 2.0 * damping / frequency], axis=-1).reshape(-1, 2) / theta
        best = _nearest_fit(grid, every, parabola, box)
        return None if best is None else Choice(best * theta, from_grid=True)


def _nearest_fit(points: Array, every: Array, parabola: Array, box: Array) -> Array | None:
    """Of points (m, 2) in the box (2, 2), damped, and falsified by no test of `every` (n, 3, 3), the one nearest to (1, 1)."""
    inside = np.all((points >= box[0]) & (points <= box[1]), axis=-1)
    damped = conics.value(parabola, points) <= ON_THE_EDGE * np.abs(parabola[1, 1]) * points[:, 1] ** 2
    points = points[inside & damped]
    x = conics.homogeneous(points)
    squares = (x[:, :, None] * x[:, None, :]).reshape(-1, 9)
    points = points[np.all(squares @ every.reshape(-1, 9).T < 0.0, axis=1)]
    return points[np.argmin(np.sum((points - 1.0) ** 2, axis=-1))] if len(points) else None
