"""Axes that a laboratory writes vectors in, turned into N (north, east, down) and B (forward, right, down)."""

from __future__ import annotations

from typing import Annotated

import numpy as np
from numpy.typing import NDArray
from pydantic import AfterValidator
from scipy.spatial.transform import Rotation

from models.attitude import quaternion

Array = NDArray[np.floating]

Row = tuple[float, float, float]
WORLD, BODY = ("NED", "SWU"), ("FRD", "BLU")  # letters of the axes of N and of B, and of their opposites
SQUARE = 1e-6  # by which a rotation's rows may fail to be orthonormal, for numbers written with seven digits


def axes(name: str | tuple[Row, Row, Row], letters: tuple[str, str]) -> Array:
    """The rotation C (3, 3), v = C v_lab, of axes by their letters, such as ENU, or by its rows.

    Raises:
      ValueError: it is no rotation.
    """
    if isinstance(name, str):
        along = [letter if len(letter) == 1 else "" for letter in name.upper()]
        if len(along) != 3 or not set(along) <= set("".join(letters)):
            raise ValueError(f"axes {name!r}: needs three letters of {', '.join('/'.join(pair) for pair in zip(*letters, strict=True))}")
        lab = np.array([[(letter == plus) - (letter == minus) for letter in along] for plus, minus in zip(*letters, strict=True)], float)
    else:
        lab = np.array(name)
    if np.abs(lab @ lab.T - np.eye(3)).max() > SQUARE:
        raise ValueError(f"axes {name!r}: are not three axes at right angles")
    if np.linalg.det(lab) < 0.0:
        raise ValueError(f"axes {name!r}: are left-handed; attitudes and rates are of right-handed axes (turn a column about by its sign)")
    return lab


def as_quaternion(rotation: Array) -> Array:
    """The quaternion q with A(q) = C, scalar last; (3, 3) to (4,)."""
    return quaternion.normalize(Rotation.from_matrix(rotation.T).as_quat())


def _world(name: str | tuple[Row, Row, Row]) -> str | tuple[Row, Row, Row]:
    axes(name, WORLD)
    return name


def _body(name: str | tuple[Row, Row, Row]) -> str | tuple[Row, Row, Row]:
    axes(name, BODY)
    return name


World = Annotated[str | tuple[Row, Row, Row], AfterValidator(_world)]
Body = Annotated[str | tuple[Row, Row, Row], AfterValidator(_body)]
