"""What the slaves of both interfaces do alike: variables declared, the plant made, numbers read, states saved and set back."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

from sim.fmu.co_simulated_plant import CoSimulatedPlant, Variable


class Interface(NamedTuple):
    """A package's words for variables: its kinds of numbers, and its enumerations, which name things alike in both."""

    real: Callable[..., Any]
    whole: Callable[..., Any]
    causality: Any
    variability: Any
    initial: Any

    def declared(self, variable: Variable) -> Any:
        """A variable of the plant as the package declares it."""
        causality, variability, initial = {
            "input": (self.causality.input, self.variability.continuous, None),
            "output": (self.causality.output, self.variability.discrete, self.initial.calculated),
            "fixed": (self.causality.parameter, self.variability.fixed, self.initial.exact),
            "tunable": (self.causality.parameter, self.variability.tunable, self.initial.exact),
        }[variable.role]
        kind = self.whole if variable.whole else self.real
        return kind(
            variable.name,
            causality=causality,
            variability=variability,
            initial=initial,
            description=variable.meaning,
            getter=variable.get,
            setter=variable.set,
        )


class PlantSlave:
    """Beside a package's slave: what does not depend on the interface.

    Attributes:
      plant: with sensors, of one trial.
      getters: of its numbers, by reference.
    """

    plant: CoSimulatedPlant
    getters: dict[int, Callable[[], float]]

    def exit_initialization_mode(self) -> None:
        """Make the plant."""
        _ = self.plant.loop

    def numbers(self, references: list[int]) -> list[float]:
        """Values of numbers, without the package's look at the type of each: an integer is not found."""
        return [self.getters[reference]() for reference in references]

    def _get_fmu_state(self) -> dict[str, Any]:
        return self.plant.state()

    def _set_fmu_state(self, state: dict[str, Any]) -> None:
        self.plant.return_to(state)
