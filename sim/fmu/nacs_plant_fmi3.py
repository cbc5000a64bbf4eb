"""The slave that an FMU of FMI 3.0 carries among its resources; the twin itself must be installed where it runs."""

from __future__ import annotations

from typing import Any

from pythonfmu3 import DefaultExperiment, Float64, Fmi3Causality, Fmi3Initial, Fmi3Slave, Fmi3Status, Fmi3StepResult, Fmi3Variability, Int64

from sim.bad_input import BadInput
from sim.fmu.co_simulated_plant import CoSimulatedPlant
from sim.fmu.plant_slave import Interface, PlantSlave

FMI3 = Interface(Float64, Int64, Fmi3Causality, Fmi3Variability, Fmi3Initial)


class NacsPlant(PlantSlave, Fmi3Slave):  # type: ignore[misc]  # the package has no types
    """Plant with sensors of one trial."""

    def __init__(self, **kwargs: Any) -> None:
        super().__init__(**kwargs)
        self.plant = CoSimulatedPlant.read(kwargs["resources"])
        self.guid, self.description = self.plant.identity, self.plant.title
        self.default_experiment = DefaultExperiment(start_time=0.0, stop_time=self.plant.end, step_size=self.plant.dt)
        clock = Float64("time", causality=Fmi3Causality.independent, variability=Fmi3Variability.continuous, getter=lambda: self.plant.time)
        self.register_variable(clock)
        for variable in self.plant.variables:
            self.register_variable(FMI3.declared(variable))
        self.getters = {reference: one.getter for reference, one in self.vars.items() if isinstance(one, Float64)}

    def do_step(self, current_time: float, step_size: float) -> Any:  # noqa: ARG002
        """Act by the inputs for `step_size` seconds."""
        try:
            self.plant.step(step_size)
        except BadInput as wrong:
            self.log(str(wrong), Fmi3Status.error)
            return Fmi3StepResult(status=Fmi3Status.error)
        return Fmi3StepResult()

    get_float64 = PlantSlave.numbers
