"""A linear-quadratic regulator that is designed on the linear model and flown on the twin: `python docs/examples/lqr.py`."""

import numpy as np
from scipy import linalg

import nacs

STATES = ("theta1", "theta2", "theta3", "omega1", "omega2", "omega3")
AT_REST = {"reference": {"type": "hold"}, "start.attitude_error_deg": 2.0}
UNHEARD = {"observers": {}, "control.feedback": "truth"}  # the scenario's own law runs along


def design(model, angle_rad=0.02, rate_rad_s=0.05, torque_nm=0.01):
    """Gain (3, 6) that weighs deviations against the sizes that are still well (Bryson's rule)."""
    kept = [model.state.names.index(name) for name in STATES]
    torques = [model.input.names.index(f"torque{axis}") for axis in (1, 2, 3)]
    A, B = model.A[np.ix_(kept, kept)], model.B[np.ix_(kept, torques)]
    Q, R = np.diag(np.repeat([angle_rad, rate_rad_s], 3) ** -2.0), np.eye(3) * torque_nm**-2.0
    cost = linalg.solve_discrete_are(A, B, Q, R)
    return np.linalg.solve(R + B.T @ cost @ B, B.T @ cost @ A)


def fly(gain, seconds=6.0, trials=4, seed=1):
    """Angles from the reference, (ticks, trials) deg, of the testbed in its moving air, under torque = -gain x of the true state."""
    changes = AT_REST | UNHEARD | {"run.ticks": round(seconds / 0.1)}
    twin = nacs.Twin("nacs/fault-free", trials=trials, seed=seed, set=changes)
    angles = []
    while not twin.over:
        turned = 2.0 * twin.truth[:, :3]  # small angles
        angles.append(np.degrees(np.linalg.norm(turned, axis=-1)))
        twin.step(-np.hstack([turned, twin.truth[:, 4:7]]) @ gain.T)
    return np.array(angles)


if __name__ == "__main__":
    found = design(nacs.linearize("nacs/fault-free", set=AT_REST, sampled=True))
    print(found.round(3))
    print(fly(found)[::10].round(3))
