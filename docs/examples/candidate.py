"""A candidate controller for `nacs falsify`: a lead compensator on the error, told by the reference that it would have needed."""

import numpy as np
from scipy.signal import cont2discrete, lfilter


class LeadCompensator:
    """u = K (s + z) / (s + p) (r - y)."""

    def __init__(self, setting):
        zero, pole, frequency = 0.4, 6.0, 1.0  # rad/s
        gain = setting.inertia * frequency**2 * pole / (2.0 * zero)
        numerator, self.denominator, _ = cont2discrete((gain * np.array([1.0, zero]), [1.0, pole]), setting.tick_s, method="bilinear")
        self.numerator = numerator[0]

    def torque(self, reference, angle, rate):  # noqa: ARG002
        """The law itself: torque on the body, N m; all (ticks, trials). Optional; `nacs falsify` then sees that the two fit together."""
        return lfilter(self.numerator, self.denominator, reference - angle, axis=0)

    def reference(self, torque, angle, rate):  # noqa: ARG002
        """The reference, rad, under which the law gives this torque: its causal inverse."""
        return angle + lfilter(self.denominator, self.numerator, torque, axis=0)
