"""Six spacecraft follow a leader that two of them see: signals with an axis of agents."""

import nacs

flown = nacs.run("formation/fault-free", trials=1, set={"run.ticks": 150, "phases": {}})
for loop in flown.loops:
    signals = flown.signals_of(loop)
    print(loop, dict(signals.truth_attitude.sizes))
print(flown.tables()[0].title)
