"""What is shown of antenna mapping under unfalsified control, whatever draws it: pointing, controllers, tests, events."""

from __future__ import annotations

from collections.abc import Iterator
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from control.antenna_pointing import AXES, AntennaPointing
from control.falsification import DAMPING_PARABOLA, energy, values
from control.unfalsified import UnfalsifiedController
from models.attitude import quaternion
from models.dynamics.state_layout import ATTITUDE, MOTION, RATE
from models.plants.assembly import Assembly
from models.plants.register.entries import kind_of
from sim.controllers.settings import UnfalsifiedSettings
from sim.loop.recording import Recording
from sim.metrics.antenna_study import CHANNELS
from sim.metrics.fixed_gain_loop import FixedGainLoop
from sim.plant.kinds import compile_plant
from sim.scenario.one_body import Scenario
from sim.series.channels import Curve
from sim.series.events import changes
from sim.series.loops import Flight, flights, torque_unit
from sim.series.palette import REFERENCE, wheel

Array = NDArray[np.floating]
Flags = NDArray[np.bool_]

SHUT, PASSED, FAILED = "too little data", "unfalsified", "falsified"  # by what was heard so far


def is_antenna(scenario: Scenario, recordings: dict[str, Recording]) -> bool:
    """Whether all loops are under unfalsified control (a user's own law may have taken the place of the scenario's)."""
    laws = (single.law for single in scenario.singles().values())
    noted = ("control/theta" in recording.channels for recording in recordings.values())
    return all(isinstance(law, UnfalsifiedSettings) for law in laws) and all(noted)


class AntennaFlight(Flight):
    """One closed loop under unfalsified control in one trial; channels are azimuth and elevation."""

    @cached_property
    def assembly(self) -> Assembly:
        """The plant."""
        return compile_plant(self.scenario.plant)

    @cached_property
    def pointing(self) -> AntennaPointing:
        """The law of both channels and the held axis."""
        law = self.scenario.law
        assert isinstance(law, UnfalsifiedSettings)
        return law.controller(self.assembly, self.recording.dt)

    @property
    def law(self) -> UnfalsifiedController:
        """The law of both channels."""
        return self.pointing.channels

    @property
    def frozen(self) -> bool:
        """Whether the first controller is kept."""
        return self.law.frozen

    @property
    def unit(self) -> Array:
        """What theta is multiplied with to have no unit, (channels, 2): J^ lambda^2 and lambda."""
        return np.stack([self.law.stiffness, np.full(len(AXES), self.law.pace)], axis=-1)

    @property
    def theta(self) -> Array:
        """(1/C_p, C_d/C_p) at every tick, (ticks, channels, 2) rad/(N m) and s."""
        return self.channel("control/theta")

    @property
    def dynamics(self) -> Array:
        """Natural frequency over lambda and damping ratio of the controllers on the true, rigid inertia, (ticks, channels, 2)."""
        frequency = 1.0 / np.sqrt(self.theta[..., 0] * np.diag(self.assembly.inertia)[AXES])
        return np.stack([frequency / self.law.pace, 0.5 * self.theta[..., 1] * frequency], axis=-1)

    @property
    def switches(self) -> tuple[NDArray[np.int64], ...]:
        """Ticks at whose end each channel's controller was replaced."""
        return tuple(np.flatnonzero(switched) for switched in self.channel("control/switched").T)

    def path(self, channel: int) -> Array:
        """Its controllers from the first to the last, (switches + 1, 2)."""
        after = np.minimum(self.switches[channel] + 1, self.recording.ticks - 1)
        return self.theta[np.concatenate([[0], after]), channel]

    @cached_property
    def wanted(self) -> Array:
        """The channels' reference, (ticks, channels) deg."""
        return np.degrees(quaternion.to_rotation_vector(self.channel("reference/q"))[:, AXES])

    @cached_property
    def pointed(self) -> Array:
        """The channels' true angles, (ticks, channels) deg."""
        return np.degrees(quaternion.to_rotation_vector(self.channel("truth/state")[:, ATTITUDE])[:, AXES])

    @property
    def panels(self) -> dict[str, Array]:
        """Angles of joints that are neither the hub's nor a wheel's, by name, (ticks,) deg; none of a body without flexible appendage."""
        if kind_of(self.scenario.plant).linear_channel is None:
            return {}
        model = self.assembly.model
        joints = (model.joint(i) for i in range(model.njnt))
        driven = {*self.assembly.attitude_joints, *self.assembly.wheel_joints}
        return {j.name: np.degrees(self.channel("truth/qpos")[:, int(j.qposadr[0])]) for j in joints if j.name not in driven}

    @cached_property
    def tests(self) -> Array:
        """Both tests of each channel after every tick, as the controller made them, (ticks, channels, 2, 3, 3); theta without unit."""
        law, source = self.law, self.scenario.law.feedback
        name = {"truth": "truth/state", "measurement": "reading"}.get(source, f"{source}/mean")
        state = _held(self.channel(name)[:, MOTION])
        angle, rate = quaternion.to_rotation_vector(state[:, ATTITUDE])[:, AXES], state[:, RATE][:, AXES]
        torque = (np.radians(self.wanted) - angle - self.theta[..., 1] * rate) / self.theta[..., 0]  # `torque_B` may be a delayed one
        if "control/asked" in self.recording.channels:
            return self._tests_with_integral(rate, angle - angle[0])
        evidence, found = law.specification.start((len(AXES),)), np.empty((len(rate), len(AXES), 2, 3, 3))
        for k, heard in enumerate(zip(torque / law.stiffness, rate / law.pace, angle - angle[0], strict=True)):
            evidence = law.specification.record(evidence, *heard)
            found[k] = law.specification.tests(evidence)
        return found

    def _tests_with_integral(self, rate: Array, angle: Array) -> Array:
        """The tests of candidates with the integral action that each channel's last controller has, (ticks, channels, 2, 3, 3)."""
        law, specification, bank = self.law, self.law.specification, self.law.databank
        assert bank is not None
        memory = bank.start(specification, (len(AXES),), 1)._replace(chosen=self.channel("control/integral")[-1].astype(np.int64))
        evidence, found = specification.start((len(AXES),)), np.empty((len(rate), len(AXES), 2, 3, 3))
        for k, heard in enumerate(zip(self.channel("control/asked") / law.stiffness, rate / law.pace, angle, strict=True)):
            evidence, memory = specification.record(evidence, *heard), bank.record(memory, specification, *heard)
            found[k] = bank.running(memory, bank.tests(memory, specification, specification.tests(evidence)))
        return found

    @cached_property
    def is_open(self) -> Flags:
        """Whether there was enough data for a test, (ticks, channels)."""
        return np.asarray(energy(self.tests) > (self.law.gate * self.law.quantum) ** 2)

    def verdict(self, channel: int, theta: Array, tick: int) -> Array:
        """A channel's tests after a tick for controllers theta (..., 2), (..., 2) over the integral of y^2; falsified where >= 0."""
        tests = self.tests[tick, channel]
        return values(tests, theta * self.unit[channel]) / energy(tests)

    def unfalsified(self, channel: int, theta: Array) -> Flags:
        """Which controllers theta (..., 2) no test falsified, one every 1 / lambda, and are damped enough and in the box; (...)."""
        every = max(1, round(1.0 / (self.law.pace * self.recording.dt)))
        ticks = np.unique(np.append(np.arange(every - 1, self.recording.ticks, every), self.recording.ticks - 1))
        tests = self.tests[ticks[self.is_open[ticks, channel]], channel].reshape(-1, 9)
        x = np.concatenate([theta * self.unit[channel], np.ones((*theta.shape[:-1], 1))], axis=-1)
        squares = (x[..., :, None] * x[..., None, :]).reshape(*theta.shape[:-1], 9)
        fit = np.all((theta >= self.law.lower) & (theta <= self.law.upper), axis=-1) & (squares @ DAMPING_PARABOLA.ravel() <= 0.0)
        for some in np.array_split(tests, max(1, len(tests) // 64)):  # all at once would be many times the picture
            fit &= np.all(squares @ some.T < 0.0, axis=-1)
        return fit

    def linear(self, channel: int, theta: Array) -> FixedGainLoop | None:
        """The loop of a fixed controller theta (2,) around the linear model of the plant, if there is one."""
        plant = self.scenario.plant
        linear = kind_of(plant).linear_channel
        if linear is None or self.law.integrals:  # the linear loop has no integral
            return None
        return FixedGainLoop(
            linear(plant, AXES[channel]), 1.0 / theta[0], theta[1] / theta[0], self.recording.dt, self.pointing.delay_ticks
        )


def antenna_flights(scenario: Scenario, recordings: dict[str, Recording], position: int = 0) -> tuple[AntennaFlight, ...]:
    """The loops that were recorded, in one trial, given by its position; first the one whose controllers are looked at, then the others."""
    several = [AntennaFlight(f.name, f.scenario, f.recording, f.look) for f in flights(scenario, recordings, position)]
    adaptive = scenario.identification.adaptive if scenario.identification else None
    return tuple(sorted(several, key=lambda f: (f.name != adaptive, f.frozen)))


def _held(state: Array) -> Array:
    """Missing readings replaced by the last ones, (ticks, n)."""
    last = np.maximum.accumulate(np.where(np.isnan(state), 0, np.arange(len(state))[:, None]), axis=0)
    held = np.take_along_axis(state, last, axis=0)
    return np.where(np.isnan(held), np.append(np.zeros(3), np.append(1.0, np.zeros(3))), held)  # at rest until something has been read


def antenna_curves(several: tuple[AntennaFlight, ...]) -> Iterator[Curve]:
    """Time series, beside those of any closed loops."""
    shades = tuple(flight.look.on_dark for flight in several)
    names = [flight.name for flight in several]
    scale, unit = torque_unit(several)

    def lines(what: str) -> tuple[str, ...]:
        return tuple(f"{name} [{what}]" for name in names)

    for i, channel in enumerate(CHANNELS):
        angles = np.stack([several[0].wanted[:, i], *_alike([f.pointed[:, i] for f in several], several[0].recording.ticks)], axis=-1)
        yield Curve(f"pointing/{channel}", ("reference [deg]", *lines("deg")), (REFERENCE, *shades), angles, 1.2)
        yield Curve(f"pointing/error_{channel}", lines("deg"), shades, angles[:, 1:] - angles[:, :1], 1.2)
        for part, (key, of) in enumerate((("frequency", "-"), ("damping", "-"))):
            values_of = _alike([f.dynamics[:, i, part] for f in several], several[0].recording.ticks)
            yield Curve(f"controllers/{key}_{channel}", lines(of), shades, np.stack(values_of, axis=-1), 1.6)
        score = several[0].channel("control/score")[:, i]
        known = np.where(score == 0.0, np.nan, score)
        both = np.concatenate([np.zeros((len(score), 1)), known], axis=-1)
        yield Curve(
            f"controllers/score_{channel}",
            ("falsified from here on [-]", "error test [-]", "effort test [-]"),
            (REFERENCE, (120, 190, 255), (255, 140, 190)),
            both,
            1.2,
        )
    for flight in several:
        torque = scale * flight.channel("command")
        numbers = range(torque.shape[1])
        yield Curve(f"wheels/torque/{flight.name}", tuple(f"RW{i + 1} [{unit}]" for i in numbers), tuple(map(wheel, numbers)), torque, 1.2)
    for joint in several[0].panels:
        angles = np.stack(_alike([flight.panels[joint] for flight in several], several[0].recording.ticks), axis=-1)
        yield Curve(f"panels/{joint}", lines("deg"), shades, angles, 1.2)


def _alike(lines: list[Array], ticks: int) -> list[Array]:
    """Lines (ticks,) of one length, those of loops that ended early filled up with NaN."""
    return [np.pad(line[:ticks], (0, max(0, ticks - len(line))), constant_values=np.nan) for line in lines]


def antenna_lanes(several: tuple[AntennaFlight, ...]) -> dict[str, list[tuple[int, str]]]:
    """Changes (tick, state) of what the tests say of the controller that is in each loop and channel."""
    found: dict[str, list[tuple[int, str]]] = {}
    for flight in several:
        score = flight.channel("control/score")
        worst = np.max(score, axis=-1)
        states = np.where(np.all(score == 0.0, axis=-1), SHUT, np.where(worst >= 0.0, FAILED, PASSED)).astype(object)
        found |= {f"{flight.name}/{channel}": changes(states[:, i]) for i, channel in enumerate(CHANNELS)}
    return found


def antenna_events(several: tuple[AntennaFlight, ...]) -> list[tuple[int, str, str]]:
    """Switches as (tick, level, text), in order."""
    found = []
    for flight in several:
        score, grid, dynamics = flight.channel("control/score"), flight.channel("control/from_grid"), flight.dynamics
        for i, channel in enumerate(CHANNELS):
            for k in flight.switches[i]:
                failed = " and ".join(name for name, value in zip(("error", "effort"), score[k, i], strict=True) if value >= 0.0)
                before, after = dynamics[k, i], dynamics[min(k + 1, len(dynamics) - 1), i]
                by = ", a point of the grid" if grid[k, i] else ""
                was, now = (f"{w:.3g} lambda, damping {d:.2g}" for w, d in (before, after))
                text = f"{flight.name} {channel}: {failed} test falsifies {was}; now {now}{by}"
                found.append((int(k), "WARN", text))
    return sorted(found)
