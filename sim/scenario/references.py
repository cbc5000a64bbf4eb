"""Attitudes to be followed, with the rates and accelerations that belong to them, in closed form."""

from __future__ import annotations

from typing import Annotated, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, field_validator

from control.tracking import Target
from models.attitude import quaternion
from models.attitude.euler_angles import from_euler_313
from models.sections import Positive, Section
from sim.scenario.antenna_reference import AntennaCuts, antenna_mapping

Array = NDArray[np.floating]

_INSTANT_S = 1e-3  # over which a rate is differenced


class Sinusoid(Section):
    """Sinusoidal vector part of the quaternion (McCafferty-Leroux et al. 2024, fig. 4, which prints no numbers)."""

    type: Literal["sinusoid"]
    amplitude_deg: tuple[float, float, float] = Field(description="of the turn about each axis")
    period_s: tuple[Positive, Positive, Positive]
    phase_deg: tuple[float, float, float] = (0.0, 0.0, 0.0)

    @field_validator("amplitude_deg")
    @classmethod
    def _stays_a_rotation(cls, amplitude: tuple[float, float, float]) -> tuple[float, float, float]:
        if np.sum(np.sin(np.radians(amplitude) / 2.0) ** 2) >= 0.99:
            raise ValueError("together turn by half a revolution; the squared sines of half the amplitudes must add up to less than 0.99")
        return amplitude

    def at(self, time: Array) -> Target:
        """Target at `time` (...,) s: q_1:3 = sin(amplitude / 2) sin(2 pi t / period + phase), rates from omega = 2 Xi' dq/dt."""
        size = np.sin(np.radians(self.amplitude_deg) / 2.0)
        pulsation = 2.0 * np.pi / np.array(self.period_s)
        angle = time[..., None] * pulsation + np.radians(self.phase_deg)
        vector, speed = size * np.sin(angle), size * pulsation * np.cos(angle)
        bend = -size * pulsation**2 * np.sin(angle)
        scalar = np.sqrt(1.0 - np.sum(vector**2, axis=-1))
        scalar_speed = -np.sum(vector * speed, axis=-1) / scalar
        scalar_bend = -(np.sum(speed**2 + vector * bend, axis=-1) + scalar_speed**2) / scalar
        q = np.concatenate([vector, scalar[..., None]], axis=-1)
        dq = np.concatenate([speed, scalar_speed[..., None]], axis=-1)
        ddq = np.concatenate([bend, scalar_bend[..., None]], axis=-1)
        to_rate = 2.0 * quaternion.xi(q).swapaxes(-1, -2)
        return Target(q, (to_rate @ dq[..., None])[..., 0], (to_rate @ ddq[..., None])[..., 0])


class Hold(Section):
    """A constant attitude, as a rotation vector from N."""

    type: Literal["hold"]
    rotation_vector_deg: tuple[float, float, float] = (0.0, 0.0, 0.0)

    def at(self, time: Array) -> Target:
        """Target at `time` (...,) s."""
        q = np.broadcast_to(quaternion.from_rotation_vector(np.radians(self.rotation_vector_deg)), (*time.shape, 4))
        nothing = np.zeros((*time.shape, 3))
        return Target(q, nothing, nothing)


class EulerRates(Section):
    """Steady precession and spin at constant nutation, 3-1-3 Euler angles (Hill et al. 2021, sec. IV: a probe's scan of the sky)."""

    type: Literal["euler-rates"]
    nutation_deg: Annotated[float, Field(ge=0, le=180)] = Field(description="theta")
    precession_rev_h: float = Field(description="rate of phi")
    spin_rpm: float = Field(description="rate of psi")
    start_deg: tuple[float, float] = Field((0.0, 0.0), description="phi and psi at t = 0")

    def at(self, time: Array) -> Target:
        """Target at `time` (...,) s; omega = dphi/dt R3(psi) R1(theta) e3 + dpsi/dt e3 (Markley & Crassidis 2014, ch. 3)."""
        nutation, (precession_start, spin_start) = np.radians(self.nutation_deg), np.radians(self.start_deg)
        precession_rate, spin_rate = 2.0 * np.pi * self.precession_rev_h / 3600.0, 2.0 * np.pi * self.spin_rpm / 60.0
        spin = spin_start + spin_rate * time
        still = np.full_like(spin, nutation)
        angles = np.stack([precession_start + precession_rate * time, still, spin], axis=-1)
        side = precession_rate * np.sin(nutation)
        axial = np.full_like(spin, precession_rate * np.cos(nutation) + spin_rate)
        omega = np.stack([side * np.sin(spin), side * np.cos(spin), axial], axis=-1)
        alpha = side * spin_rate * np.stack([np.cos(spin), -np.sin(spin), np.zeros_like(spin)], axis=-1)
        return Target(from_euler_313(angles), omega, alpha)


class AntennaMapping(Section):
    """Cuts to and fro about azimuth (z) and elevation (x), for an antenna's pattern (Tsao, Brozenec & Safonov, fig. 9)."""

    type: Literal["antenna-mapping"]
    extent_deg: Annotated[float, Field(gt=0, lt=45)] = Field(description="to either side")
    pace_rad_s: Positive = Field(1.0, description="lambda; all durations are divided by it")

    def at(self, time: Array) -> Target:
        """Target at `time` (...,) s, its rotation vector from N being [elevation, 0, azimuth]."""
        half = 0.5 * _INSTANT_S
        alpha = (self._omega(time + half)[1] - self._omega(time - half)[1]) / _INSTANT_S  # the cuts' corners have none
        q, omega = self._omega(time)
        return Target(q, omega, alpha)

    def _omega(self, time: Array) -> tuple[Array, Array]:
        """Attitude and rate; of a rotation vector phi the rate is dphi/dt - b phi x dphi/dt + c phi x (phi x dphi/dt).

        b = (1 - cos) / |phi|^2, c = (|phi| - sin) / |phi|^3, resolved in the turned frame (Markley & Crassidis 2014, ch. 3).
        """
        (azimuth, azimuth_rate), (elevation, elevation_rate) = (cuts.at(time) for cuts in self.cuts)
        still = np.zeros_like(azimuth)
        turn, rate = np.stack([elevation, still, azimuth], axis=-1), np.stack([elevation_rate, still, azimuth_rate], axis=-1)
        size = np.linalg.norm(turn, axis=-1, keepdims=True)
        across = quaternion.cross(turn, rate)
        b = 0.5 * np.sinc(size / (2.0 * np.pi)) ** 2
        safe = np.where(size > 1e-3, size, 1.0)
        c = np.where(size > 1e-3, (safe - np.sin(safe)) / safe**3, 1.0 / 6.0)
        return quaternion.from_rotation_vector(turn), rate - b * across + c * quaternion.cross(turn, across)

    @property
    def cuts(self) -> tuple[AntennaCuts, AntennaCuts]:
        """Azimuth and elevation."""
        return antenna_mapping(self.pace_rad_s, float(np.radians(self.extent_deg)))


ReferenceSettings = Annotated[Sinusoid | Hold | EulerRates | AntennaMapping, Field(discriminator="type")]
