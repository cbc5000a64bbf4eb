"""What an antenna-mapping run is judged by: when and how its controllers switched, how well they pointed, and what they truly are."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from control.antenna_pointing import AXES
from models.attitude import quaternion
from models.dynamics.state_layout import ATTITUDE
from models.plants.assembly import Assembly
from sim.controllers.settings import ControlSettings, UnfalsifiedSettings
from sim.loop.closed_loop import System
from sim.loop.recording import Recording
from sim.metric import Metric
from sim.metrics.closed_loop_identification import Bounds, antenna_law, identify, multisine
from sim.scenario.one_body import Scenario

Array = NDArray[np.floating]

CHANNELS = ("azimuth", "elevation")


class Controllers(NamedTuple):
    """What a loop flew with, (trials, 2, 2): theta of azimuth and elevation, 1/C_p rad/(N m) and C_d/C_p s."""

    first: Array
    last: Array
    integral: Array | None = None  # which integral action the last have, (trials, 2); None: the law knows none


def judge(assembly: Assembly, recording: Recording, loop: str, law: ControlSettings) -> list[Metric]:
    """Metrics of the channels in a loop; none if the loop is not under unfalsified control."""
    if not isinstance(law, UnfalsifiedSettings):
        return []
    switching = "control/switched" in recording.channels and not law.frozen  # a user's own law may have taken the place of it
    return _pointing(recording, loop) + (_switching(assembly, recording) if switching else [])


def controllers(recording: Recording) -> Controllers | None:
    """The first and the last of a loop; None if it is not under unfalsified control."""
    theta = recording.channels.get("control/theta")
    integral = recording.channels.get("control/integral")
    return None if theta is None else Controllers(theta[0], theta[-1], None if integral is None else integral[-1])


def identified(
    scenario: Scenario, flown: dict[str, Controllers], rebuild: Callable[[Scenario], System]
) -> tuple[list[Metric], dict[str, Array]]:
    """Greatest weighted responses under the first, the nominal and the last controller, and the responses themselves.

    Args:
      scenario: with its loops and [identification].
      flown: controllers of every loop.
      rebuild: the same trials of another scenario, not yet flown.
    """
    settings = scenario.identification
    assert settings is not None
    single = scenario.singles()[settings.adaptive]
    adaptive, nominal = flown[settings.adaptive], flown[settings.nominal]
    assert isinstance(single.law, UnfalsifiedSettings)
    sines = multisine(settings, single.law.pace_rad_s, single.run.tick_s)
    longer = single.model_copy(update={"run": single.run.model_copy(update={"ticks": len(sines.reference)}), "faults": ()})
    metrics, findings = [], dict[str, Array]()
    for phase, chosen in {"initial": adaptive.first, "nominal": nominal.first, "final": adaptive.last}.items():
        system = rebuild(longer)
        law = antenna_law(system)
        responses = identify(system, settings, sines, chosen, adaptive.integral if phase == "final" else None)
        for i, (channel, response) in enumerate(zip(CHANNELS, responses, strict=True)):
            error, effort = Bounds.of(law.channels, settings.claim, i).weighted(response)
            metrics += [Metric(channel, "sup_w1_ter", phase, "1", error), Metric(channel, "sup_w2_tur", phase, "1", effort)]
            findings |= {
                f"{channel}/{phase}/frequency": np.tile(response.frequency, (len(chosen), 1)),
                f"{channel}/{phase}/error": np.abs(response.error),
                f"{channel}/{phase}/effort": np.abs(response.effort),
            }
    return metrics, findings


def _inertia(assembly: Assembly) -> Array:
    """True moments about the channels' axes, panels and wheels locked, (2,) kg m2."""
    return np.diag(assembly.inertia)[AXES]


def _pointing(recording: Recording, loop: str) -> list[Metric]:
    """RMS of the second half of a run, phase by phase: the phases are the loops."""
    half = slice(recording.ticks // 2, None)
    angle = quaternion.to_rotation_vector(recording.channels["truth/state"][half][..., ATTITUDE])
    wanted = quaternion.to_rotation_vector(recording.channels["reference/q"][half])
    out = []
    for channel, axis in zip(CHANNELS, AXES, strict=True):
        error = np.degrees(_rms(angle[..., axis] - wanted[:, None, axis]))
        torque = _rms(recording.channels["torque_B"][half][..., axis])
        out += [Metric(channel, "rms_pointing_deg", loop, "deg", error), Metric(channel, "rms_torque", loop, "N m", torque)]
    return out


def _switching(assembly: Assembly, recording: Recording) -> list[Metric]:
    """Switches and the last controller, by the true inertia."""
    switched = recording.channels["control/switched"].astype(bool)
    theta, inertia = recording.channels["control/theta"][-1], _inertia(assembly)
    out = []
    for i, channel in enumerate(CHANNELS):
        events = switched[..., i]
        first = np.where(events.any(axis=0), recording.dt * np.argmax(events, axis=0), np.nan)
        stiffness = 1.0 / theta[:, i, 0]
        rows = (
            ("switches", "1", np.sum(events, axis=0).astype(float)),
            ("first_switch_s", "s", first),
            ("from_grid", "1", np.sum(recording.channels["control/from_grid"][..., i].astype(bool), axis=0).astype(float)),
            ("natural_frequency", "rad/s", np.sqrt(stiffness / inertia[i])),
            ("damping_ratio", "1", 0.5 * theta[:, i, 1] * np.sqrt(stiffness / inertia[i])),
            *(
                [("integral_per_s", "1/s", recording.channels["control/integral_per_s"][-1][:, i])]
                if "control/integral_per_s" in recording.channels
                else []
            ),
            ("theta_1", "rad/(N m)", theta[:, i, 0]),
            ("theta_2", "s", theta[:, i, 1]),
        )
        out += [Metric(channel, metric, "all", unit, values) for metric, unit, values in rows]
    return out


def _rms(values: Array) -> Array:
    """Over ticks, (ticks, trials) to (trials,); the same whatever the batch."""
    return np.sqrt(np.mean(np.ascontiguousarray(values.T) ** 2, axis=-1))
