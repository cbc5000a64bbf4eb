"""A campaign: the same case with plants that differ, and the spread of what comes out."""

from pathlib import Path

import nacs

Path("balance.toml").write_text(
    """
title = "How well must the table be balanced?"
scenario = "nacs/fault-free"
trials = 8
seed = 4
[override]
"run.ticks" = 120
phases = {}
[dispersion]
"plant.centre_of_mass_um.0" = { normal = [0.0, 5.0] }
"""
)
done = nacs.campaign("balance.toml", out="balance", workers=1)
table = done.table("trials.parquet").to_pandas()
print(table[table.metric == "tracking_error_deg"].value.describe())
