"""A researcher's own filters and control law, named on the command line and flown beside the built-in ones."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from functools import cached_property
from typing import Any

from sim.bad_input import BadInput
from sim.text.names import WHAT_A_NAME_IS, is_a_name
from sim.user_code.filters import UserFilter
from sim.user_code.laws import UserLaw
from sim.user_code.surroundings import Surroundings
from sim.user_code.user_class import UserClass

FILTER, LAW = ("initial", "step"), ("step",)  # methods that a class must have


@dataclass(frozen=True)
class UserCode:
    """What the user named as FILE.py:CLASS, loaded anew in every process, or handed in as a class or an object.

    Attributes:
      observers: filters that join the scenario's.
      controller: a control law in place of the scenario's.
    """

    observers: tuple[Any, ...] = ()
    controller: Any = None

    @cached_property
    def names(self) -> tuple[str, ...]:
        """Names of the filters; raises BadInput if a file cannot be loaded."""
        return tuple(UserClass(text, "--observer", FILTER).name for text in self.observers)

    @cached_property
    def law(self) -> str | None:
        """Name of the control law; raises BadInput if its file cannot be loaded."""
        return None if self.controller is None else UserClass(self.controller, "--controller", LAW).name

    @property
    def described(self) -> dict[str, Any]:
        """What a run's files say of them; nothing if there are none."""
        given = {**dict(zip(self.names, self.observers, strict=True)), **({self.law: self.controller} if self.law else {})}
        return {"guests": {name: _said(one) for name, one in given.items()}} if given else {}

    def check(self, place: Surroundings, reserved: Iterable[str]) -> None:
        """Rehearse on a small batch, with missing readings if there can be any; raises BadInput, also for names that are `reserved`."""
        if not self.observers and self.controller is None:
            return
        taken = [*reserved]
        for text, name in zip(self.observers, self.names, strict=True):
            if name in taken or not is_a_name(name):
                why = "taken or reserved" if name in taken else WHAT_A_NAME_IS
                raise BadInput(f"--observer {_said(text)}: {name[:40]!r} cannot be its name ({why}); give the class another `name = '...'`")
            taken.append(name)
        for user in self.filters(place):
            user.rehearse()
        if (law := self.control(place)) is not None:
            law.rehearse()

    def filters(self, place: Surroundings) -> tuple[UserFilter, ...]:
        """The user's filters."""
        return tuple(UserFilter.of(UserClass(text, "--observer", FILTER), place) for text in self.observers)

    def control(self, place: Surroundings) -> UserLaw | None:
        """The user's control law, if there is one."""
        return None if self.controller is None else UserLaw.of(UserClass(self.controller, "--controller", LAW), place)


def _said(given: Any) -> str:
    """How a file names what the user gave."""
    if isinstance(given, str):
        return given
    named = given if hasattr(given, "__qualname__") else type(given)
    return f"{named.__module__}.{named.__qualname__}"
