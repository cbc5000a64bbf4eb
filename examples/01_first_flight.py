"""Fly the testbed through a push by hand, and look at what happened and how good it was."""

import nacs

flown = nacs.run("nacs/disturbance", trials=2, seed=7)
print(flown)

rate = flown.signals.truth_rate  # an array with axes trial, time and axis, in rad/s
print(f"greatest rate: {float(abs(rate).max()):.3f} {rate.attrs['units']}")
flown.report().savefig("first_flight.png")
