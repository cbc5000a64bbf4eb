"""A reading set against a predicted state through a measurement model: linearised there, by sigma points, or the first of all."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from estimation.gaussian import Belief, first_belief, innovate, joseph, no_detection
from estimation.sigma_points import SigmaPoints, factor
from estimation.state_space import StateSpace
from models.dynamics.measurement import MeasurementModel, PartOfState, WholeState
from models.dynamics.stacked_measurement import PartOfReading, StackedMeasurement
from models.dynamics.vector_part_measurement import VectorPart

Array = NDArray[np.floating]


class Observation(NamedTuple):
    """What a Gaussian filter sees of a reading: residual = H error + noise."""

    residual: Array  # (..., d) reading minus prediction, NaN where missing
    noise: Array  # (..., d, d) R
    sensitivity: Array | None  # (..., d, e) H; None: the unit matrix


def whole_state(measurement: MeasurementModel | None, noise: Array | None, space: StateSpace) -> MeasurementModel:
    """What a filter reads: what `measurement` says, or else the whole state with `noise`.

    Raises:
      ValueError: both are given, or none; or a vector part is to be read in coordinates that take q and -q for one state.
    """
    if measurement is not None and noise is None:
        if isinstance(measurement, VectorPart) and space.attitude != "components":
            raise ValueError("a vector part needs Signed coordinates: without the fourth component q and -q are two states")
        return measurement
    if measurement is None and noise is not None:
        return WholeState(noise, space.attitude)
    raise ValueError("a filter needs one of the two: measurement_noise, of a reading of the whole state, or measurement, a model of it")


def directly(measurement: MeasurementModel, space: StateSpace) -> bool:
    """Whether the residual is the state's error itself, H = I."""
    if isinstance(measurement, PartOfReading):
        return directly(measurement.measurement, space)
    return isinstance(measurement, WholeState) and (measurement.attitude == "rotation") == (space.attitude == "rotation")


def observe(measurement: MeasurementModel, space: StateSpace, reading: Array, state: Array) -> Observation:
    """A reading (..., m) against the state (..., n) that was predicted, linearised there."""
    if directly(measurement, space):
        if isinstance(measurement, PartOfReading):
            reading = measurement.of(reading)
        return Observation(space.difference(reading, state), measurement.noise, None)
    residual = measurement.residual(reading, measurement.predict(state))
    rows = measurement.linear(space.attitude)
    return Observation(residual, measurement.noise, space.sensitivity(measurement.jacobian(state), state) if rows is None else rows)


def degrees_of_freedom(measurement: MeasurementModel, space: StateSpace, residual: Array) -> Array:
    """Of the NIS of a residual (..., d): the components that were read, the four of a unit quaternion counting three; (...,).

    A quaternion's length carries nothing, so that one of its four terms is zero to first order (docs/consistency.md).
    """
    return np.sum(~np.isnan(residual), axis=-1, dtype=float) - _quaternions(measurement, space, residual)


def _quaternions(measurement: MeasurementModel, space: StateSpace, residual: Array) -> Array:
    """How many attitudes of a residual (..., d) were read as unit quaternions, (...,)."""
    match measurement:
        case PartOfReading():
            return _quaternions(measurement.measurement, space, residual)
        case StackedMeasurement():
            parts = np.split(residual, np.cumsum([part.noise.shape[-1] for part in measurement.parts])[:-1], axis=-1)
            each = [_quaternions(part, space, own) for part, own in zip(measurement.parts, parts, strict=True)]
            return np.sum(each, axis=0)
        case WholeState() | PartOfState():
            how = space.attitude if directly(measurement, space) else measurement.attitude
            if how == "quaternion":
                return np.where(np.isnan(residual[..., 0]), 0.0, 1.0)
    return np.zeros(residual.shape[:-1])


def observe_by_points(
    points: SigmaPoints, measurement: MeasurementModel, space: StateSpace, reading: Array, state: Array, covariance: Array
) -> tuple[Observation, Array | None]:
    """A reading (..., m) against a predicted state (..., n) and covariance (..., e, e), by the unscented transform of h.

    That is done as the statistical linearisation that it amounts to, z = H x + b + error with H = Pxz' P^-1 (Lefebvre, Bruyninckx &
    De Schutter 2002): gain, covariance and likelihood are those of the textbook's Pxz and Pzz, while Joseph's form and missing
    components need no more than for a linear reading. Where h is linear, H is known and no points are drawn.

    Returns:
      The observation, whose noise holds what is not linear in h, and 1 where the covariance had to be repaired for the points, (...,).
    """
    if directly(measurement, space) or measurement.linear(space.attitude) is not None:
        return observe(measurement, space, reading, state), None
    root, lost = factor(covariance)
    seen = measurement.predict(space.displace(state[..., None, :], points.offsets(root)))
    centre = seen[..., 0, :]
    errors = measurement.residual(seen[..., 1:, :], centre[..., None, :])  # (..., 2 e, d)
    mean, spread = points.moments(errors)
    size = root.shape[-1]
    slope = (errors[..., :size, :] - errors[..., size:, :]) / (2.0 * points.alpha * np.sqrt(size + points.kappa))  # (H L)', (..., e, d)
    sensitivity = np.linalg.solve(root.swapaxes(-1, -2), slope).swapaxes(-1, -2)
    beyond = spread - slope.swapaxes(-1, -2) @ slope
    return Observation(measurement.residual(reading, centre) - mean, measurement.noise + beyond, sensitivity), lost


def begin(measurement: MeasurementModel, space: StateSpace, reading: Array, prior: Array, prior_variance: Array) -> Belief:
    """Belief after the first reading (..., m): what is read of the state itself with its noise, and the prior for all else.

    If the reading is another function of the state, or if two sensors read the same component of it, the prior is corrected by the
    reading as by any later one, which asks more of the prior: it must be near enough for h to be linear.

    Args:
      measurement: of the reading.
      space: error coordinates of the state.
      reading: NaN where missing.
      prior: state (..., n); its leading axes, as those of the noise, join those of the reading.
      prior_variance: of that, in error coordinates, (..., e).

    Raises:
      LostDefiniteness: the innovation covariance of a prior that is corrected is not positive definite.
    """
    if isinstance(measurement, PartOfReading):
        return begin(measurement.measurement, space, measurement.of(reading), prior, prior_variance)
    if isinstance(measurement, VectorPart):
        first = begin(WholeState(measurement.noise_of_whole), space, measurement.completed(reading), prior, prior_variance)
        dof = np.broadcast_to(np.sum(~np.isnan(measurement.residual(reading, reading)), axis=-1, dtype=float), first.dof.shape)
        return first._replace(innovation=first.innovation[..., 1:], dof=dof)
    lead = np.broadcast_shapes(measurement.noise.shape[:-2], prior.shape[:-1], prior_variance.shape[:-1])
    noise = np.broadcast_to(measurement.noise, (*lead, *measurement.noise.shape[-2:]))
    if directly(measurement, space):
        return first_belief(space, reading, noise, prior, prior_variance)
    lead = np.broadcast_shapes(reading.shape[:-1], lead)
    start = np.array(np.broadcast_to(prior, (*lead, prior.shape[-1])))
    observation = observe(measurement, space, reading, start)
    missing = np.isnan(observation.residual)
    known = np.where(missing, 0.0, 1.0)
    covariance: Array = prior_variance[..., None] * np.eye(prior_variance.shape[-1])
    rows = measurement.linear(space.attitude)
    if rows is not None and _selects(rows):
        seen = rows * known[..., None]  # (..., d, e) every row a component of the error, or nothing
        correction = (seen.swapaxes(-1, -2) @ np.where(missing, 0.0, observation.residual)[..., None])[..., 0]
        unread = 1.0 - np.sum(seen, axis=-2)
        covariance = covariance * unread[..., None] + seen.swapaxes(-1, -2) @ noise @ seen
    else:
        innovation = innovate(covariance, *observation)
        correction = (innovation.gain @ innovation.residual[..., None])[..., 0]
        covariance = joseph(covariance, innovation.gain, noise, innovation.sensitivity)
    nothing = np.zeros(lead)
    unknown = np.full(lead, np.nan)  # nothing was predicted, so nothing can be surprising
    dof = np.broadcast_to(degrees_of_freedom(measurement, space, observation.residual), lead)
    empty = np.zeros((*lead, missing.shape[-1]))
    return Belief(space.displace(start, correction), covariance, empty, unknown, nothing, dof, no_detection(nothing))


def _selects(rows: Array) -> bool:
    """Whether every row (d, e) picks one component, and no two the same."""
    each, picked = np.count_nonzero(rows, axis=1), np.count_nonzero(rows, axis=0)
    return bool((each == 1).all() and (picked <= 1).all() and (rows[rows != 0.0] == 1.0).all())
