"""Units that people use, in the SI units that are used inside."""

from __future__ import annotations

import numpy as np

RPM = 2.0 * np.pi / 60.0  # rad/s of one revolution a minute
