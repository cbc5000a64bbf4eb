"""A researcher's own analytic model: a Python file that defines `derivative(state, command)`; it is run as code."""

from __future__ import annotations

import sys
import traceback
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from models.attitude.quaternion import IDENTITY
from sim.bad_input import BadInput
from sim.crosscheck.model_variants import Model
from sim.user_code.user_class import words_of

Array = NDArray[np.floating]

FUNCTION = "derivative"
_TRIED = (2, 3)  # leading axes that a model must keep


@dataclass(frozen=True)
class UserDynamics:
    """The user's function, every complaint about which names the file."""

    path: Path
    function: Callable[[Array, Array], Any]

    def derivative(self, state: Array, command: Array) -> Array:
        """dx/dt; (..., n) and (..., inputs) to (..., n); raises BadInput if the file gives anything else."""
        try:
            with np.errstate(all="ignore"):  # what is not finite is refused below, in one line
                answer = np.asarray(self.function(state, command), dtype=float)
        except KeyboardInterrupt:
            raise
        except BaseException as failure:  # whatever the user's code does wrong is theirs to read about
            raise BadInput(_blame(self.path, failure)) from None
        if answer.shape != state.shape:
            raise BadInput(
                f"{self.path}: {FUNCTION} gave shape {answer.shape} for a state of shape {state.shape}: they must be alike, batch axes too"
            )
        if not np.isfinite(answer).all():
            raise BadInput(
                f"{self.path}: {FUNCTION} gave numbers that are not finite (greatest number in the state: {np.abs(state).max():.3g})"
            )
        return answer


def load_user_model(path: Path, wheels: int) -> Model:
    """Read and try the user's model of a body with so many wheels, or under torques (..., 3); raises BadInput naming file and line."""
    if not path.is_file():
        raise BadInput(f"--model {path}: there is no such file")
    module = ModuleType(path.stem)
    module.__file__ = str(path)
    sys.modules.setdefault(path.stem, module)  # dataclasses look their module up
    try:
        exec(compile(path.read_text(encoding="utf-8-sig"), str(path), "exec"), module.__dict__)  # no byte code is left beside the file
    except KeyboardInterrupt:
        raise
    except BaseException as failure:
        raise BadInput(_blame(path, failure)) from None
    function = getattr(module, FUNCTION, None)
    if not callable(function):
        raise BadInput(f"{path}: defines no function {FUNCTION}(state, command)")
    dynamics = UserDynamics(path, function)
    lead = np.zeros((*_TRIED, 1))
    dynamics.derivative(lead + np.concatenate([IDENTITY, np.zeros(3 + wheels)]), lead + np.zeros(wheels or 3))
    return Model(path.stem, dynamics, f"equations of {path.name}")


def _blame(path: Path, failure: BaseException) -> str:
    """FILE:LINE: what; the line is where the user's code was last, kind of failure."""
    if isinstance(failure, SyntaxError) and failure.filename == str(path):
        return f"{path}:{failure.lineno}: {failure.msg}"
    lines = [frame.lineno for frame in traceback.extract_tb(failure.__traceback__) if frame.filename == str(path)]
    said = words_of(failure)
    return f"{path}{f':{lines[-1]}' if lines else ''}: {type(failure).__name__}: {said}"
