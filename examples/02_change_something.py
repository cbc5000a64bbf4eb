"""Take other values than the scenario's: any dotted key of its file, as `--set` does."""

import nacs

for offset_um in (0, 10):
    changes = {"run.ticks": 200, "phases": {}, "plant.centre_of_mass_um": [offset_um, 0, 0]}
    table = nacs.run("nacs/fault-free", trials=2, set=changes).metrics
    speed = table[(table.metric == "peak_wheel_speed")].value.mean()
    print(f"centre of mass {offset_um:2} um off the pivot: wheels reach {speed * 60 / 6.2832:.0f} rpm in 20 s")
