"""The slave that an FMU of FMI 3.0 carries among its resources; the twin itself must be installed where it runs."""

from __future__ import annotations

from typing import Any

from pythonfmu3 import DefaultExperiment, Float64, Fmi3Causality, Fmi3Initial, Fmi3Slave, Fmi3Status, Fmi3StepResult, Fmi3Variability, Int64

from sim.bad_input import BadInput
from sim.fmu.co_simulated_plant import CoSimulatedPlant, Variable


class NacsPlant(Fmi3Slave):  # type: ignore[misc]  # the package has no types
    """Plant with sensors of one trial."""

    def __init__(self, **kwargs: Any) -> None:
        super().__init__(**kwargs)
        self.plant = CoSimulatedPlant.read(kwargs["resources"])
        self.guid, self.description = self.plant.identity, self.plant.title
        self.default_experiment = DefaultExperiment(start_time=0.0, stop_time=self.plant.end, step_size=self.plant.dt)
        clock = Float64("time", causality=Fmi3Causality.independent, variability=Fmi3Variability.continuous, getter=lambda: self.plant.time)
        self.register_variable(clock)
        for variable in self.plant.variables:
            self.register_variable(_declared(variable))
        self._getters = {reference: one.getter for reference, one in self.vars.items() if isinstance(one, Float64)}

    def exit_initialization_mode(self) -> None:
        """Make the plant."""
        _ = self.plant.loop

    def do_step(self, current_time: float, step_size: float) -> Any:  # noqa: ARG002
        """Act by the inputs for `step_size` seconds."""
        try:
            self.plant.step(step_size)
        except BadInput as wrong:
            self.log(str(wrong), Fmi3Status.error)
            return Fmi3StepResult(status=Fmi3Status.error)
        return Fmi3StepResult()

    def get_float64(self, vrs: list[int]) -> list[float]:
        """Values of numbers, without the package's look at the type of each: an integer is not found."""
        return [self._getters[reference]() for reference in vrs]

    def _get_fmu_state(self) -> dict[str, Any]:
        return self.plant.state()

    def _set_fmu_state(self, state: dict[str, Any]) -> None:
        self.plant.return_to(state)


def _declared(variable: Variable) -> Any:
    causality, variability, initial = {
        "input": (Fmi3Causality.input, Fmi3Variability.continuous, None),
        "output": (Fmi3Causality.output, Fmi3Variability.discrete, Fmi3Initial.calculated),
        "fixed": (Fmi3Causality.parameter, Fmi3Variability.fixed, Fmi3Initial.exact),
        "tunable": (Fmi3Causality.parameter, Fmi3Variability.tunable, Fmi3Initial.exact),
    }[variable.role]
    kind = Int64 if variable.whole else Float64
    return kind(
        variable.name,
        causality=causality,
        variability=variability,
        initial=initial,
        description=variable.meaning,
        getter=variable.get,
        setter=variable.set,
    )
