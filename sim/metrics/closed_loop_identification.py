"""Closed-loop identification: what a controller truly makes of the plant, heard from many sines at once on both channels."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import signal

from control.antenna_pointing import AXES, AntennaPointing
from control.tracking import Target
from control.unfalsified import UnfalsifiedController
from models.attitude import quaternion
from models.dynamics.state_layout import ATTITUDE
from sim.controllers.tracking import TrackingLaw, target_channels
from sim.loop.closed_loop import System, run_whole
from sim.scenario.identification import IdentificationSettings

Array = NDArray[np.floating]


class Multisine(NamedTuple):
    """Sines that share a period, those of the two channels interleaved."""

    reference: Array  # (ticks, 2) rad
    bins: tuple[NDArray[np.int64], NDArray[np.int64]]  # of each channel, in cycles a period
    frequency: tuple[Array, Array]  # rad/s


class Response(NamedTuple):
    """Transfer functions of a channel from the reference, at its frequencies."""

    frequency: Array  # (lines,) rad/s
    error: Array  # T_er, (trials, lines)
    effort: Array  # T_ur, (trials, lines) N m/rad


def multisine(settings: IdentificationSettings, pace: float, tick_s: float) -> Multisine:
    """Even amplitudes, Schroeder's phases (1970) so that peaks stay low; odd bins for azimuth, even ones for elevation."""
    ticks = round(settings.period / pace / tick_s)
    last = int(settings.highest * pace * ticks * tick_s / (2.0 * np.pi))
    bins = np.arange(1, last + 1, 2), np.arange(2, last + 1, 2)
    time = 2.0 * np.pi * np.arange(ticks) / ticks
    waves = []
    for chosen in bins:
        count = len(chosen)
        phase = -np.pi * np.arange(count) * (np.arange(count) + 1) / count
        waves.append(np.radians(settings.rms_deg) * np.sqrt(2.0 / count) * np.cos(np.outer(time, chosen) + phase).sum(-1))
    wave = np.stack(waves, axis=-1)
    unit = 2.0 * np.pi / (ticks * tick_s)
    return Multisine(np.tile(wave, (settings.settling_periods + settings.periods, 1)), bins, (unit * bins[0], unit * bins[1]))


def antenna_law(system: System) -> AntennaPointing:
    """The controller of a loop under unfalsified control; raises TypeError of another."""
    law = system.law
    if not (isinstance(law, TrackingLaw) and isinstance(law.controller, AntennaPointing)):
        raise TypeError("identification is of loops under unfalsified control")
    return law.controller


def identify(
    system: System, settings: IdentificationSettings, sines: Multisine, theta: Array, integral: Array | None = None
) -> tuple[Response, Response]:
    """Fly fixed controllers under a multisine and read T_er = 1 - Y / R and T_ur = U / R off the measured record.

    Args:
      system: of the loop under test, not yet flown and as long as the sines; its reference is not used.
      settings: of the experiment.
      sines: the reference.
      theta: of the controllers, (trials, 2, 2).
      integral: which integral action they have, (trials, 2); None: none.

    Returns:
      Azimuth's and elevation's response.
    """
    law = antenna_law(system)
    ticks = len(sines.reference)
    turn = np.stack([sines.reference[:, 1], np.zeros(ticks), sines.reference[:, 0]], axis=-1)
    still = np.zeros((ticks, 3))
    fixed = replace(law, channels=replace(law.channels, frozen=True), theta=theta, integral=integral)
    target = Target(quaternion.from_rotation_vector(turn), still, still)
    recording = run_whole(replace(system, law=TrackingLaw(fixed, target), references=target_channels(target)))
    heard = slice(settings.settling_periods * (ticks // (settings.settling_periods + settings.periods)), ticks)
    angle = quaternion.to_rotation_vector(recording.channels["reading"][heard][..., ATTITUDE])
    torque = recording.channels["torque_B"][heard]

    def lines(values: Array, bins: NDArray[np.int64]) -> Array:
        """Fourier coefficients (trials, lines) of (ticks, trials)."""
        return np.ascontiguousarray(np.fft.rfft(np.ascontiguousarray(values.T), axis=-1)[:, settings.periods * bins])

    found = []
    for channel, axis in enumerate(AXES):
        bins = sines.bins[channel]
        wanted = lines(sines.reference[heard, channel, None], bins)
        error, effort = 1.0 - lines(angle[..., axis], bins) / wanted, lines(torque[..., axis], bins) / wanted
        found.append(Response(sines.frequency[channel], error, effort))
    return found[0], found[1]


@dataclass(frozen=True)
class Bounds:
    """|T_er| < 1 / |W1| with the claimed M1, |T_ur| < 1 / |W2|."""

    zero: float  # rad/s
    error: float
    effort: float  # N m/rad

    @classmethod
    def of(cls, channels: UnfalsifiedController, claim: float, channel: int) -> Bounds:
        """What is claimed of a channel."""
        limit = np.broadcast_to(channels.specification.effort_bound * channels.stiffness, (len(AXES),))
        return cls(channels.zero * channels.pace, claim, float(limit[channel]))

    def shape(self, frequency: Array) -> Array:
        """|(s + z) / (s + z / 100)|."""
        _, response = signal.freqs([1.0, self.zero], [1.0, 0.01 * self.zero], frequency)
        return np.abs(response)

    def weighted(self, response: Response) -> tuple[Array, Array]:
        """Greatest |W1 T_er| and |W2 T_ur| of each trial, (trials,)."""
        weight = self.shape(response.frequency)
        return np.max(weight * np.abs(response.error), axis=-1) / self.error, np.max(
            weight * np.abs(response.effort), axis=-1
        ) / self.effort
