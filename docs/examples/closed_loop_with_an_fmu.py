"""Export the plant as an FMU and close the loop around it in FMPy: a law on the readings, as another simulator would have it."""

from __future__ import annotations

import tempfile
from pathlib import Path

import fmpy
from fmpy.fmi3 import FMU3Slave

import nacs

TICKS, DT = 50, 0.1

with tempfile.TemporaryDirectory() as folder:
    file = Path(folder) / "plant.fmu"
    nacs.export_fmu("nacs/fault-free", file)
    about = fmpy.read_model_description(str(file))
    place = {variable.name: variable.valueReference for variable in about.modelVariables}
    plant = FMU3Slave(
        guid=about.instantiationToken,
        modelIdentifier=about.coSimulation.modelIdentifier,
        unzipDirectory=fmpy.extract(str(file), folder + "/unpacked"),
        instanceName="plant",
    )
    plant.instantiate()
    plant.enterInitializationMode()
    plant.exitInitializationMode()
    attitude, rate = [place[f"reading.q[{i}]"] for i in (1, 2, 3)], [place[f"reading.omega[{i}]"] for i in (1, 2, 3)]
    asked, torque = [place[f"reference.q[{i}]"] for i in (1, 2, 3)], [place[f"torque_B[{i}]"] for i in (1, 2, 3)]
    for tick in range(TICKS):
        error = [q - d for q, d in zip(plant.getFloat64(attitude), plant.getFloat64(asked), strict=True)]  # small angles
        plant.setFloat64(torque, [-0.4 * e - 0.075 * w for e, w in zip(error, plant.getFloat64(rate), strict=True)])
        plant.doStep(currentCommunicationPoint=tick * DT, communicationStepSize=DT)
    plant.terminate()
    plant.freeInstance()
    print(f"after {TICKS * DT:g} s the error is {[round(e, 4) for e in error]}")
