"""Do the filters' covariances tell the truth? NEES of 30 trials beside its bounds."""

import numpy as np
from scipy.stats import chi2

import nacs

trials = 30
flown = nacs.run("nacs/fault-free", trials=trials, seed=3, set={"run.ticks": 150, "phases": {}})
low, high = chi2.ppf([0.025, 0.975], 10 * trials) / trials
for name in ("ekf", "sif"):
    mean = flown.signals[f"nees_{name}"].mean("trial")[20:]
    share = float(np.mean((mean > low) & (mean < high)))
    print(f"{name}: NEES {float(mean.mean()):.1f} of 10, inside {low:.1f} .. {high:.1f} at {100 * share:.0f} % of the ticks")
