"""The register of signals: what each channel of a recording is, by family of scenarios."""

from __future__ import annotations

from types import MappingProxyType

from sim.series.signals.arrangement import (
    by_sender,
    hinge_angles,
    hinge_names,
    hinge_rates,
    in_double,
    place,
    senders,
    slide_names,
    slide_positions,
    slide_speeds,
)
from sim.series.signals.entry import Entry, Part
from sim.series.signals.quantities import (
    ATTITUDE,
    BODY_TORQUE,
    CHANNEL,
    DESIRED_ACCELERATION,
    DESIRED_ATTITUDE,
    DESIRED_RATE,
    FORCE,
    JOINT_ANGLE,
    JOINT_RATE,
    MASS_POSITION,
    MASS_SPEED,
    MODE,
    MOMENTUM,
    POSITION,
    RATE,
    ROTATION,
    SENDER,
    SIGMA,
    SIGMA_ACCELERATION,
    SIGMA_RATE,
    SURFACE,
    TOLD_FORCE,
    TOLD_TORQUE,
    TORQUE,
    UNMODELLED,
    VELOCITY,
    WEIGHT,
    WHEEL_SPEED,
    WHEEL_TORQUE,
    WORLD_POSITION,
    WORLD_VELOCITY,
    numbered,
    scalar,
)

_STATE, _ERRORS = (ATTITUDE, RATE, WHEEL_SPEED), (ROTATION, RATE, WHEEL_SPEED)
_DUE = tuple(part._replace(unit="1", what=f"whether a reading is due: {part.what}") for part in _STATE)
_TRUE, _READ = "as it is", "as the sensors read it; missing where nothing is read"
_TOLD = "as filters are told it, of this tick until the next"


def _pointing(channel: str, what: str, unit: str = "1") -> Entry:
    """Of unfalsified control, one number for each of an antenna's channels."""
    return Entry(f"control/{channel}", f"control/{channel}", (numbered(CHANNEL, what, unit),), "")


BODY = (
    Entry("truth/state", "truth", _STATE, _TRUE),
    Entry("truth/qpos", "truth", (JOINT_ANGLE,), "", arranged=hinge_angles, labels=hinge_names),
    Entry("truth/qvel", "truth", (JOINT_RATE,), "", arranged=hinge_rates, labels=hinge_names),
    Entry("truth/qpos", "truth", (MASS_POSITION,), "", arranged=slide_positions, labels=slide_names),
    Entry("truth/qvel", "truth", (MASS_SPEED,), "", arranged=slide_speeds, labels=slide_names),
    Entry("truth/qpos", "truth", (WORLD_POSITION,), "", arranged=place),
    Entry("truth/qvel", "truth", (WORLD_VELOCITY,), "", arranged=place),
    Entry("truth/unmodelled", "truth", (UNMODELLED,), _TRUE),
    Entry("reading", "reading", _STATE, _READ),
    Entry("due", "due", _DUE, "of sensors that are slower than the loop"),
    Entry("reference/q", "reference", (DESIRED_ATTITUDE,), ""),
    Entry("reference/omega", "reference", (DESIRED_RATE,), ""),
    Entry("reference/alpha", "reference", (DESIRED_ACCELERATION,), ""),
    Entry("torque_B", "torque_demanded", (TORQUE,), "that the control law demands"),
    Entry("command", "command", (WHEEL_TORQUE._replace(name=""),), "as commanded", wheels=True),
    Entry("command", "command", (TORQUE,), "as commanded", wheels=False),
    Entry("applied", "torque_applied", (WHEEL_TORQUE,), "as applied, after errors and faults of the drives", wheels=True),
    Entry("applied", "torque_applied", (BODY_TORQUE,), "as applied, after errors and faults", wheels=False),
    Entry("fault", "fault", (scalar("whether a fault is active"),), ""),
    Entry("control/latched", "control/latched", (scalar("whether a failed wheel is believed for good by the allocation"),), ""),
    Entry(
        "control/theta",
        "control",
        (scalar("1/C_p of the running controller", "rad/(N m)", "compliance"), scalar("C_d/C_p of the running controller", "s", "lead")),
        "unfalsified control",
        lead=CHANNEL,
    ),
    Entry(
        "control/score",
        "control",
        (
            scalar("error test of the running controller", name="error_test"),
            scalar("effort test of the running controller", name="effort_test"),
        ),
        "falsified where >= 0; 0 while there is too little data",
        lead=CHANNEL,
    ),
    _pointing("falsified", "whether the running controller failed a test"),
    _pointing("switched", "whether the controller was replaced at the end of the tick"),
    _pointing("from_grid", "whether its replacement is a point of the grid"),
    _pointing("integral", "number of the running controller's integral action, 0 for none"),
    _pointing("integral_per_s", "integral action of the running controller", "1/s"),
    _pointing("asked", "torque that the channel's law asks for, before delays", "N m"),
)

FORMATION = (
    Entry("truth/state", "truth", (SIGMA, SIGMA_RATE), _TRUE),
    Entry("truth/q_BN", "truth", (ATTITUDE,), _TRUE),
    Entry("truth/wheel_speed", "truth", (WHEEL_SPEED,), _TRUE),
    Entry("reading", "reading", (SIGMA,), _READ),
    Entry("reference/leader", "leader", (SIGMA, SIGMA_RATE, SIGMA_ACCELERATION), "of the leader"),
    Entry("torque_B", "torque_demanded", (TORQUE,), "that the control law demands"),
    Entry("applied", "torque_applied", (BODY_TORQUE,), "as asked of the drives, after faults of commands"),
    Entry("wheel_torque", "torque_applied", (WHEEL_TORQUE,), "as applied, after errors and faults of the drives"),
    Entry("known", "told", (TOLD_TORQUE, MOMENTUM), _TOLD),
    Entry("control/acceleration", "control", (SIGMA_ACCELERATION,), "of the leader, as the agent believes"),
    Entry(
        "messages/received",
        "received",
        (numbered(SENDER, "1 where a message came, 0 where it was lost, missing where there is no link", stem="from_"),),
        "",
        arranged=by_sender,
        labels=senders,
    ),
)

CONSENSUS = (
    Entry("truth/state", "truth", (POSITION, VELOCITY), _TRUE),
    Entry("reading", "reading", (POSITION, VELOCITY), _READ),
    Entry("estimate", "feedback", (POSITION, VELOCITY), "that the control law acts on"),
    Entry("reference/leader", "leader", (POSITION,), "of the leader"),
    Entry("reference/leader_rate", "leader", (VELOCITY,), "of the leader"),
    Entry("force", "force_applied", (FORCE,), "as applied, after faults"),
    Entry("known", "told", (TOLD_FORCE, SURFACE), _TOLD),
    Entry("unknown", "force_unknown", (FORCE,), "that the agents do not know, as it is"),
    Entry("learned", "force_learned", (FORCE,), "that the agents do not know, as each believes it"),
    Entry("weights", "weights", (numbered(WEIGHT, "weights of the network that stands for the force", "N"),), "", arranged=in_double),
)

_ESTIMATED, _DEVIATION = "as the observer estimates it", "standard deviation of the estimate as the observer believes it"


def _observed(state: tuple[Part, ...], errors: tuple[Part, ...]) -> tuple[Entry, ...]:
    """Channels of an observer that has these components of state and of its error."""
    return (
        Entry("mean", "estimate/{observer}", state, _ESTIMATED),
        Entry("sigma", "sigma/{observer}", errors, _DEVIATION),
        Entry("nees", "nees/{observer}", (scalar("normalized squared error of the estimate"),), ""),
        Entry("nis", "nis/{observer}", (scalar("normalized squared innovation; missing where nothing is read"),), ""),
        Entry("dof", "dof/{observer}", (scalar("degrees of freedom of the innovation"),), ""),
        Entry("statistic", "statistic/{observer}", (scalar("what the fault detector compares with its thresholds"),), ""),
        Entry("declared", "declared/{observer}", (scalar("whether the fault detector declares a fault"),), ""),
        Entry("modes", "mode_probability/{observer}", (numbered(MODE, "probability of each mode", stem="mode"),), "the first is healthy"),
        Entry("lost", "repairs/{observer}", (scalar("covariances that were repaired so far"),), ""),
        Entry("ess", "effective_particles/{observer}", (scalar("effective number of particles"),), ""),
        Entry("fading", "fading/{observer}", (scalar("fading factor of an adaptive filter"),), ""),
        Entry("learned", "learned/{observer}", (TORQUE,), "that no rigid body's model has, as the observer learned it"),
    )


OF_RUN = MappingProxyType({"body": BODY, "formation": FORMATION, "consensus": CONSENSUS})
OF_OBSERVER = MappingProxyType(
    {
        "body": _observed(_STATE, _ERRORS),
        "formation": _observed((SIGMA, SIGMA_RATE), (SIGMA, SIGMA_RATE)),
        "consensus": _observed((POSITION, VELOCITY), (POSITION, VELOCITY)),
    }
)
# channels that are no signals: MuJoCo's own coordinates of several agents say again what `truth/state` says
LEFT_OUT = MappingProxyType({"body": (), "formation": ("truth/qpos",), "consensus": ("truth/qpos",)})
