"""Interacting multiple model filter: one filter a mode of the plant, and the probability of each mode."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from estimation.gaussian import Belief, Detection, Flags, LostDefiniteness, Modes, symmetrize
from estimation.modes import join, one_of, stacked
from estimation.state_space import StateSpace

Array = NDArray[np.floating]


class ModeFilter(Protocol):
    """A Gaussian filter that believes in one mode."""

    @property
    def space(self) -> StateSpace:
        """Error coordinates of its covariance."""
        ...

    @property
    def prior(self) -> Array:
        """State (..., n) that fills what the first reading misses."""
        ...

    def initial(self, measurement: Array) -> Belief:
        """Belief after the first reading (..., m)."""
        ...

    def step(self, belief: Belief, command: Array, measurement: Array, dt: float) -> Belief:
        """Belief after `dt` seconds of `command` (..., r), and a reading (..., m)."""
        ...


@dataclass(frozen=True, eq=False)
class InteractingMultipleModel:
    """Filters that believe in different modes, mixed by a Markov chain (Blom & Bar-Shalom 1988; Hill et al. 2021, eq. 19-27).

    The paper's equations with the misprints put right (Bar-Shalom, Li & Kirubarajan 2001, sec. 11.6.6): mixing probabilities are
    mu_(i|j) (19), deviations enter (22) and (27) as outer products, (26) and (27) sum over j. Likelihoods stay logarithms. Means of
    attitudes are taken in the error coordinates of the most probable mode's, covariances being carried there unchanged, which is right to
    second order in how far the modes are apart. Alike filters are stepped as one, with the modes as a batch axis.

    The belief's mean and covariance are those of the mixture, its log-likelihood is the mixture's, `lost` the sum over modes. Innovation
    and NIS are those of the mode that was the most probable *before* the reading, so that its NIS is chi-square while that mode is right.
    A reading that is wholly missing leaves the probabilities to the Markov chain. `detection` is a fault detector: its statistic is the
    probability that the mode is not the first, with hysteresis.

    Attributes:
      filters: one a mode, of the same state, error coordinates and reading; the first is the healthy one.
      transition: p_ij, probability in a step to go from mode i to mode j, (modes, modes).
      initial_probabilities: mu of the first reading, (modes,).
      floor: least probability of a mode. None is needed where p_ij > 0, since the chain alone then keeps every mode possible, and in
        logarithms nothing underflows; where p_ij = 0, a floor would contradict the chain. For transition = I it keeps modes in the race.
      declare_above: probability of fault that declares one.
      withdraw_below: probability of fault that withdraws it.

    Raises:
      ValueError: settings that are no probabilities, or filters that do not belong together.
    """

    filters: tuple[ModeFilter, ...]
    transition: Array
    initial_probabilities: Array
    floor: float = 0.0
    declare_above: float = 0.9
    withdraw_below: float = 0.5

    def __post_init__(self) -> None:
        count = len(self.filters)
        if count < 2:
            raise ValueError(f"filters: {count} given, an interacting multiple model needs two or more")
        if self.transition.shape != (count, count):
            raise ValueError(f"transition has shape {self.transition.shape}, {count} filters need ({count}, {count})")
        for number, row in enumerate(self.transition, 1):
            _check_probabilities(f"transition: row {number}", row)
        if self.initial_probabilities.shape != (count,):
            raise ValueError(f"initial_probabilities has shape {self.initial_probabilities.shape}, {count} filters need ({count},)")
        _check_probabilities("initial_probabilities", self.initial_probabilities)
        kinds = {(type(one.space).__name__, one.prior.shape[-1]) for one in self.filters}
        if len(kinds) > 1:
            said = " and ".join(f"{name} of {size} states" for name, size in sorted(kinds))
            raise ValueError(f"filters have different state spaces, {said}: they cannot be mixed")
        if not 0 <= self.floor < 1 / count:
            raise ValueError(f"floor = {self.floor:g}: {count} modes need 0 <= floor < {1 / count:g}")
        if not 0 < self.withdraw_below <= self.declare_above < 1:
            limits = f"withdraw_below = {self.withdraw_below:g}, declare_above = {self.declare_above:g}"
            raise ValueError(f"{limits}: need 0 < withdraw_below <= declare_above < 1")

    @property
    def space(self) -> StateSpace:
        """Error coordinates of the covariance."""
        return self.filters[0].space

    @cached_property
    def _stacked(self) -> ModeFilter | None:
        """All filters as one, if they are alike but for model and noise."""
        return stacked(self.filters)

    def initial(self, measurement: Array) -> Belief:
        """Start every filter from the first reading (..., m), with the initial probabilities."""
        if self._stacked:
            members = self._stacked.initial(measurement[..., None, :])
        else:
            members = join([one.initial(measurement) for one in self.filters])
        probabilities = np.broadcast_to(self.initial_probabilities, members.nis.shape)
        return self._belief(members, probabilities, probabilities, np.zeros(members.nis.shape[:-1]), np.False_)

    def step(self, belief: Belief, command: Array, measurement: Array, dt: float) -> Belief:
        """Mix, have every filter predict over `dt` seconds of `command` (..., r) and read `measurement` (..., m), weigh the modes.

        Raises:
          LostDefiniteness: an innovation covariance of a mode is not positive definite.
        """
        if belief.modes is None:
            raise ValueError("belief has no modes: it is not of an interacting multiple model")
        probabilities, members = belief.modes
        joint = self.transition.T * probabilities[..., None, :]  # p_ij mu_i as (..., j, i)
        predicted = np.sum(joint, axis=-1)  # eq. 20
        possible = predicted > 0.0
        mixing = joint / np.where(possible, predicted, 1.0)[..., None]  # eq. 19
        if not possible.all():
            mixing = mixing + np.where(possible, 0.0, 1.0)[..., None] * np.eye(len(self.filters))  # an impossible mode mixes with none
        mean, covariance = mix(self.space, mixing, probabilities, members)  # eq. 21, 22
        members = self._run(members._replace(mean=mean, covariance=covariance), command, measurement, dt)
        with np.errstate(divide="ignore"):
            weight = members.log_likelihood + np.log(predicted)  # eq. 23
        top = np.max(weight, axis=-1, keepdims=True)
        scaled = np.exp(weight - top)
        total = np.sum(scaled, axis=-1, keepdims=True)
        probabilities = scaled / total  # eq. 24, 25
        if self.floor:
            raised = np.maximum(probabilities, self.floor)
            probabilities = raised / np.sum(raised, axis=-1, keepdims=True)
        return self._belief(members, predicted, probabilities, (top + np.log(total))[..., 0], belief.detection.declared)

    def _run(self, mixed: Belief, command: Array, measurement: Array, dt: float) -> Belief:
        """Each filter's step from its mixed belief."""
        if not self._stacked:
            return join([one.step(one_of(mixed, i), command, measurement, dt) for i, one in enumerate(self.filters)])
        try:
            return self._stacked.step(mixed, command[..., None, :], measurement[..., None, :], dt)
        except LostDefiniteness as lost:
            raise LostDefiniteness(lost.where[:-1], f"{lost.what} of a mode in trial") from None

    def _belief(self, members: Belief, predicted: Array, probabilities: Array, log_likelihood: Array, declared: Flags | np.bool_) -> Belief:
        """The mixture, with what was the most probable mode before the reading speaking for the innovation."""
        mean, covariance = mix(self.space, probabilities[..., None, :], probabilities, members)  # eq. 26, 27
        speaker = np.argmax(predicted, axis=-1)[..., None]
        fault = np.sum(probabilities[..., 1:], axis=-1)
        return Belief(
            mean=mean[..., 0, :],
            covariance=covariance[..., 0, :, :],
            innovation=np.take_along_axis(members.innovation, speaker[..., None], axis=-2)[..., 0, :],
            nis=np.take_along_axis(members.nis, speaker, axis=-1)[..., 0],
            log_likelihood=log_likelihood,
            dof=members.dof[..., 0],
            detection=Detection(
                statistic=fault,
                declared=np.where(declared, fault >= self.withdraw_below, fault > self.declare_above),
                history=(np.zeros((*fault.shape, 0)),),
            ),
            lost=None if members.lost is None else np.sum(members.lost, axis=-1),
            modes=Modes(probabilities, members),
        )


def mix(space: StateSpace, weights: Array, probabilities: Array, members: Belief) -> tuple[Array, Array]:
    """Means (..., j, n) and covariances (..., j, e, e) of mixtures of the members with weights (..., j, modes).

    Coordinates are those of the most probable mode by `probabilities` (..., modes).
    """
    size = members.covariance.shape[-1]
    best = np.argmax(probabilities, axis=-1)[..., None, None]
    reference = np.take_along_axis(members.mean, best, axis=-2)
    errors = space.difference(members.mean, reference)
    shift = weights @ errors
    apart = errors[..., None, :, :] - shift[..., :, None, :]  # (..., j, modes, e)
    within = weights @ members.covariance.reshape(*members.covariance.shape[:-2], size * size)
    between = (weights[..., None] * apart).swapaxes(-1, -2) @ apart
    return space.displace(reference, shift), symmetrize(within.reshape(between.shape) + between)


def _check_probabilities(name: str, row: Array) -> None:
    if not (row >= 0.0).all():
        raise ValueError(f"{name} has a negative or missing probability: {row.tolist()}")
    if abs(float(row.sum()) - 1.0) > 1e-9:
        raise ValueError(f"{name} sums to {float(row.sum()):.10g}, must be one: {row.tolist()}")
