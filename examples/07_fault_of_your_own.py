"""A scenario as a dictionary: a wheel that slowly loses its power, and when the detectors see it."""

import nacs

wheel = {"kind": "effectiveness", "wheel": 2, "remaining": 0.2, "start_s": 5.0, "duration_s": 15.0}
flown = nacs.run("nacs/fault-free", trials=4, seed=5, set={"run.ticks": 250, "phases": {}, "faults": [wheel]})
statistic, declared = flown.signals["statistic_nis-windowed"], flown.signals["declared_nis-windowed"]
print(f"the windowed NIS reaches {float(statistic.max()):.0f}; declared at {100 * float(declared.mean()):.0f} % of the ticks")
