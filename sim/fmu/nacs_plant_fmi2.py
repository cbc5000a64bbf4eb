"""The slave that an FMU of FMI 2.0 carries among its resources; the twin itself must be installed where it runs."""

from __future__ import annotations

from typing import Any
from xml.etree.ElementTree import Element, SubElement

from pythonfmu import DefaultExperiment, Fmi2Causality, Fmi2Initial, Fmi2Slave, Fmi2Variability, Integer, Real

from sim.fmu.co_simulated_plant import CoSimulatedPlant
from sim.fmu.plant_slave import Interface, PlantSlave

FMI2 = Interface(Real, Integer, Fmi2Causality, Fmi2Variability, Fmi2Initial)


class NacsPlant(PlantSlave, Fmi2Slave):  # type: ignore[misc]  # the package has no types
    """Plant with sensors of one trial."""

    def __init__(self, **kwargs: Any) -> None:
        super().__init__(**kwargs)
        self.plant = CoSimulatedPlant.read(kwargs["resources"])
        self.guid, self.description = self.plant.identity, self.plant.title
        self.default_experiment = DefaultExperiment(start_time=0.0, stop_time=self.plant.end, step_size=self.plant.dt)
        for variable in self.plant.variables:
            self.register_variable(FMI2.declared(variable))
        self.getters = {reference: one.getter for reference, one in self.vars.items() if isinstance(one, Real)}

    def to_xml(self, *options: Any) -> Element:
        """The package's description with what it leaves out: outputs are unknown until the plant is made."""
        root: Element = super().to_xml(*options)
        unknown = SubElement(next(root.iter("ModelStructure")), "InitialUnknowns")
        for place, variable in enumerate(self.plant.variables):
            if variable.role == "output":
                SubElement(unknown, "Unknown", index=str(place + 1))
        return root

    def do_step(self, current_time: float, step_size: float) -> bool:  # noqa: ARG002
        """Act by the inputs for `step_size` seconds."""
        self.plant.step(step_size)  # what it raises is logged and ends the simulation; False would only be a step to be tried again
        return True

    get_real = PlantSlave.numbers
