"""Write a flight log, and run another filter over it, as over one of a laboratory."""

from pathlib import Path

import nacs
from sim.replay.flight_log import export

flown = nacs.run("nacs/fault-free", trials=1, set={"run.ticks": 100, "phases": {}})
export(Path("log.parquet"), flown.recordings, flown.scenario, flown.name)
again = nacs.replay("log.parquet", out="replayed", filters=["mekf"])
print(again.table("estimates.parquet").column_names[:8])
print(again.text)
