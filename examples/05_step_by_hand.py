"""Close the loop yourself: 64 testbeds at once, advanced a control period at a time."""

import numpy as np

import nacs

twin = nacs.Twin("nacs/fault-free", trials=64, seed=11, set={"run.ticks": 150, "phases": {}})
while not twin.over:
    reading = twin.read()  # q1..q4, omega1..3, wheel1..4
    twin.step(-0.3 * reading[:, :3] * np.sign(reading[:, 3:4]) - 0.2 * reading[:, 4:7])
rate = twin.signals.truth_rate[:, -1]
print(f"rate after 15 s: {float(np.sqrt((rate**2).mean())):.4f} rad/s over {twin.scenario.run.trials} testbeds")
