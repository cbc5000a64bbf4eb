"""A law that follows a reference, as the loop sees it."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

from control.tracking import Controller, Estimate, Memoryless, RememberingController, Target
from sim.parts import Array, Decision


@dataclass(frozen=True, eq=False)
class TrackingLaw:
    """A control law and what it is to follow.

    Attributes:
      controller: with a memory or without.
      target: at every tick, (ticks, ...).
    """

    controller: Controller | RememberingController
    target: Target

    @cached_property
    def _remembering(self) -> RememberingController:
        return self.controller if isinstance(self.controller, RememberingController) else Memoryless(self.controller)

    def start(self, estimate: Estimate) -> Any:
        """The controller's memory before the first tick."""
        return self._remembering.start(estimate)

    def says(self, tick: int, estimate: Estimate, memory: Any) -> None:
        """Nothing: there is nobody to hear it."""

    def decide(self, tick: int, estimate: Estimate, messages: Any, memory: Any) -> Decision:
        """Torque on the body, (trials, 3) N m in B."""
        target = Target(*(part[tick] for part in self.target))
        return Decision(*self._remembering.decide(estimate, target, memory))


def target_channels(target: Target) -> dict[str, Array]:
    """What is recorded of a target, by name; (ticks, ...)."""
    return {"q": target.q_DN, "omega": target.omega_DN_D, "alpha": target.alpha_DN_D}
