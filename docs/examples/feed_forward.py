"""Quaternion feedback with feed-forward of the torque that the reference and the gyroscopic coupling need."""

from control.proportional_derivative import ProportionalDerivative
from control.tracking import tracking_error
from models.attitude.quaternion import cross


def times(matrix, vector):
    """Matrix times vector, for any leading axes."""
    return (matrix @ vector[..., None])[..., 0]


class FeedForward:
    """Makes the tracking error's own dynamics those of a body at rest (Markley & Crassidis 2014, ch. 7.3)."""

    def __init__(self, setting):
        self.body = setting.process  # has inertia, wheel_axes, wheel_inertia
        self.feedback = ProportionalDerivative(proportional=0.4, derivative=0.075)

    def step(self, estimate, target):
        """Torque on the body, (trials, 3) N m in B."""
        body, rotation, omega = self.body, tracking_error(estimate, target).rotation, estimate.omega_BN_B
        momentum = times(body.inertia, omega) + body.wheel_inertia * times(body.wheel_axes, estimate.omega_wheel)
        wanted = times(rotation, target.alpha_DN_D) - cross(omega, times(rotation, target.omega_DN_D))
        return self.feedback.step(estimate, target) + times(body.inertia, wanted) + cross(omega, momentum)
