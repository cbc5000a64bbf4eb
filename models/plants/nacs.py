"""The NACS testbed: its parameters, each with its provenance, and the compilation of nacs.xml with them."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property
from pathlib import Path
from typing import Annotated, Literal

import mujoco
import numpy as np
from numpy.typing import NDArray
from pydantic import Field, model_validator

from models.dynamics.rigid_body import RigidBody
from models.dynamics.state_layout import StateLayout
from models.dynamics.unmodelled_torque import UnmodelledTorque
from models.dynamics.wheel_faults import WheelFault
from models.dynamics.wheeled_body import WheeledBody
from models.plants import inertia as mass_geometry
from models.plants.assembly import Assembly, Carrier, Prepared, assemble, prepare
from models.plants.provenance import known
from models.plants.register.kind import AirTorque, DriveErrors, Joint, Learnable, PlantKind
from models.plants.register.parameters import PlantParameters
from models.plants.wheels import FRICTIONS, alike, check_wheel, joints_of, mount, pyramid
from models.sections import NonNegative, Positive, Sextuple

Array = NDArray[np.floating]

MJCF = Path(__file__).with_name("nacs.xml")
WHEELS = ("wheel_1", "wheel_2", "wheel_3", "wheel_4")
BALANCE_MASSES = ("balance_x", "balance_y", "balance_z")

# Published J_B with wheels locked (McCafferty-Leroux et al. 2024, eq. 26), kg m2 as [xx, yy, zz, xy, xz, yz]. No rigid body has the
# printed J_yy; with one zero restored it is physical and fits the printed gains. No other source confirms that: a hypothesis.
INERTIA_SETS: dict[str, tuple[float, ...]] = {
    "hypothesis": (0.021867, 0.0172994, 0.0316484, -0.001532, -0.000631, -0.000781),
    "printed": (0.021867, 0.172994, 0.0316484, -0.001532, -0.000631, -0.000781),
}

MOTOR_BEHIND_M = 0.0111  # middle of a motor, along the axis from that of its wheel
TILT_LIMIT_DEG = 30.0  # where the plate meets the dome of nacs.xml

Vector3 = tuple[float, float, float]
OnRail = Annotated[float, Field(ge=-40, le=40)]  # mm, between the stops of nacs.xml


class NacsParameters(PlantParameters):
    """Every number of the NACS plant."""

    type: Literal["nacs"] = "nacs"
    inertia_kg_m2: Literal["hypothesis", "printed"] | Sextuple = known(
        "hypothesis",
        "whole with wheels locked, about the centre of rotation: a named set or [xx, yy, zz, xy, xz, yz]",
        "kg m2",
        "published (eq. 26), J_yy by hypothesis: printed 0.172994, used 0.0172994",
    )
    wheel_inertia_kg_m2: Positive = known(1.740138e-5, "of a wheel about its spin axis", "kg m2", "published (eq. 26)")
    wheel_azimuth_deg: float = known(45.0, "alpha of the pyramid", "deg", "published (eq. 6)")
    wheel_elevation_deg: float = known(45.0, "beta of the pyramid", "deg", "published (eq. 6)")
    wheel_transverse_inertia_kg_m2: Positive = known(9.29e-6, "of a wheel across its spin axis", "kg m2", "chosen: disc of 43 mm x 10 mm")
    wheel_mass_kg: Positive = known(0.075, "of a wheel", "kg", "chosen: disc of 43 mm, fits J_w")
    mass_kg: Positive = known(
        3.2,
        "whole floating part",
        "kg",
        "chosen: what the parts drawn in nacs.xml weigh together; they make J_B to 1.6 % and are balanced to 0.5 mm. J_B is that of "
        "something flat and wide: a CubeSat of one unit fits if it is sunk through a light plate, one that stands on the plate, of two "
        "units, or with the batteries in it does not (docs/physics.md)",
    )
    centre_of_mass_um: Vector3 = known(
        (0.5, -0.4, 1.0),
        "of the whole in B from the centre of rotation, masses at home",
        "um",
        "chosen: well balanced, slightly bottom-heavy (Chesi et al. 2014 reach a few um)",
    )
    balance_mass_kg: Positive = known(0.05, "each of three sliding masses", "kg", "chosen")
    balance_position_mm: tuple[OnRail, OnRail, OnRail] = known(
        (0.0, 0.0, 0.0), "set-points of the masses on their rails", "mm", "chosen; travel +-40 mm"
    )
    motor_constant_nm_a: Positive = known(
        0.01404, "torque per current = back-EMF per speed", "N m/A = V s/rad", "chosen: no-load speed 8000 rpm at the usable supply voltage"
    )
    winding_resistance_ohm: Positive = known(2.0, "terminal resistance", "ohm", "chosen: stall at 6 A")
    supply_voltage_v: Positive = known(11.76, "usable motor voltage", "V", "datasheet (ESCON: 0.98 Vcc), 12 V supply chosen")
    drive_current_a: Positive = known(2.0, "continuous limit of the drive", "A", "datasheet (ESCON 24/2)")
    command_bits: Annotated[int, Field(ge=0, le=24)] = known(
        12, "resolution of the torque set-point; 0: none", "bit", "datasheet (ESCON: 12-bit set-point)"
    )
    drive_torque_noise_nm: NonNegative = known(
        2e-5, "standard deviation of a drive's torque error, anew each control tick", "N m", "chosen: about one set-point step"
    )
    wheel_coulomb_nm: NonNegative = known(1e-5, "dry friction of a wheel bearing", "N m", "chosen: small")
    wheel_viscous_nms: NonNegative = known(2e-7, "viscous friction of a wheel bearing", "N m s/rad", "chosen")
    wheel_imbalance_um: NonNegative = known(
        0.0,
        "offset of each rotor's centre of mass from its axis",
        "um",
        "chosen: balanced; 1 um x 75 g = 75 mg mm is a usual static imbalance",
    )
    bearing_viscous_nms: NonNegative = known(2e-5, "drag of the air film", "N m s/rad", "chosen: small")
    air_torque_nm: NonNegative = known(
        1e-4,
        "standard deviation of the air flow's torque, each axis",
        "N m",
        "chosen: the paper's unmodelled 'small process noise'; 0.5 mrad/s a tick",
    )
    air_torque_correlation_s: Positive = known(0.2, "correlation time of that torque (first-order Gauss-Markov)", "s", "chosen")
    gravity_m_s2: NonNegative = known(9.80665, "standard gravity", "m/s2", "published (CGPM 1901)")
    step_s: Positive = known(0.01, "physics step (RK4)", "s", "chosen by measurement: docs/physics.md")

    @model_validator(mode="after")
    def _steps_resolve_imbalance(self) -> NacsParameters:
        if self.wheel_imbalance_um > 0 and self.step_s > 5e-4:
            raise ValueError(f"step_s = {self.step_s:g}: wheel imbalance shakes at wheel speed and needs step_s <= 0.0005")
        if 4 * self.wheel_mass_kg + 3 * self.balance_mass_kg >= self.mass_kg:
            raise ValueError(f"mass_kg = {self.mass_kg:g} must exceed that of four wheels and three balance masses together")
        check_wheel(self)
        return self

    @cached_property
    def inertia(self) -> Array:
        """J_B with wheels locked about the centre of rotation, (3, 3) kg m2; physical or not."""
        chosen = self.inertia_kg_m2
        return mass_geometry.tensor(INERTIA_SETS[chosen] if isinstance(chosen, str) else chosen)

    @property
    def centre_of_mass(self) -> Array:
        """Of the whole from the centre of rotation, (3,) m in B."""
        return 1e-6 * np.array(self.centre_of_mass_um)

    @cached_property
    def wheel_axes(self) -> Array:
        """Spin axes in B, (3, 4)."""
        return pyramid(np.radians(self.wheel_azimuth_deg), np.radians(self.wheel_elevation_deg))

    @property
    def torque_limit(self) -> float:
        """Torque that the drive's continuous current gives, N m a wheel."""
        return self.motor_constant_nm_a * self.drive_current_a

    @property
    def no_load_speed(self) -> float:
        """Speed at which back-EMF has used up the supply voltage, rad/s."""
        return self.supply_voltage_v / self.motor_constant_nm_a

    @property
    def wheel_momentum(self) -> float:
        """Of a wheel at its no-load speed, N m s."""
        return self.wheel_inertia_kg_m2 * self.no_load_speed

    @property
    def filled_s(self) -> float:
        """Time after which gravity on the centre of mass has run the wheels of a level testbed that holds its attitude to no-load speed."""
        x, y, _ = self.centre_of_mass
        torque = self.mass_kg * self.gravity_m_s2 * np.array([-y, x, 0.0])
        share = float(np.max(np.abs(np.linalg.pinv(self.wheel_axes) @ torque)))
        return self.wheel_momentum / share if share > 0 else np.inf

    def process(
        self, coupled: bool = False, gyroscopic_sign: float = -1.0, wheel_drag: bool = False, fault: WheelFault | None = None
    ) -> WheeledBody:
        """Analytic model with these parameters, believing in a fault or none; runs the printed inertia too."""
        return WheeledBody(
            inertia=self.inertia,
            wheel_axes=self.wheel_axes,
            wheel_inertia=self.wheel_inertia_kg_m2,
            coupled=coupled,
            gyroscopic_sign=gyroscopic_sign,
            wheel_coulomb=self.wheel_coulomb_nm if wheel_drag else 0.0,
            wheel_viscous=self.wheel_viscous_nms if wheel_drag else 0.0,
            fault=fault,
        )

    def driven_body(self) -> RigidBody:
        """Rigid body in seven states under the torques of the motors alone; wheel speeds are read."""
        axes = self.wheel_axes
        return RigidBody(self.inertia, -axes, self.wheel_inertia_kg_m2 * axes)


def prepare_nacs(parameters: NacsParameters) -> Prepared:
    """Fill nacs.xml with parameters, without compiling it.

    Raises:
      ImpossibleInertia: no rigid body has the tensor of the whole, or what is left of it for the bus.
    """
    spec = mujoco.MjSpec.from_file(str(MJCF))
    _set_wheels(spec, parameters)
    _set_environment(spec, parameters)
    mass, moment, inertia = _attached(spec, parameters)
    bus = Carrier("bus", parameters.mass_kg - mass, parameters.mass_kg, moment, inertia, about_mass_centre=False)
    return prepare(spec, parameters, bus.reassemble, "wheels and masses")


def compile_nacs(parameters: NacsParameters | None = None) -> Assembly:
    """Compile the testbed; raises ImpossibleInertia as `prepare_nacs` does."""
    chosen = parameters or NacsParameters()
    wheels = alike(WHEELS, chosen, chosen.no_load_speed)
    return assemble(lambda: prepare_nacs(chosen), chosen, "bearing", chosen.process(), wheels, keyframe="level")


def _set_wheels(spec: mujoco.MjSpec, parameters: NacsParameters) -> None:
    mount(spec, WHEELS, parameters)
    limit, voltage = parameters.torque_limit, parameters.supply_voltage_v
    for name, axis in zip(WHEELS, parameters.wheel_axes.T, strict=True):
        drive, motor = spec.actuator(name), spec.geom(name.replace("wheel", "motor"))
        motor.pos = spec.body(name).pos - MOTOR_BEHIND_M * axis
        motor.alt.type, motor.alt.zaxis = mujoco.mjtOrientation.mjORIENTATION_ZAXIS, axis
        spec.body(name).ipos = [1e-6 * parameters.wheel_imbalance_um, 0, 0]
        drive.set_to_dcmotor(
            motorconst=[parameters.motor_constant_nm_a] * 2,
            resistance=parameters.winding_resistance_ohm,
            saturation=[limit, 0, 0],
            controller=[0, 0, 0, 0, 0, voltage],
            ctrlspec=drive.ctrlspec,
        )
        drive.ctrlrange = [-limit, limit]


def _set_environment(spec: mujoco.MjSpec, parameters: NacsParameters) -> None:
    spec.option.timestep = parameters.step_s
    spec.option.gravity = [0, 0, -parameters.gravity_m_s2]
    spec.joint("bearing").damping[0] = parameters.bearing_viscous_nms
    for name in BALANCE_MASSES:
        spec.body(name).mass = parameters.balance_mass_kg


def _attached(spec: mujoco.MjSpec, parameters: NacsParameters) -> tuple[float, Array, Array]:
    """Mass, first moment (3,) and inertia about the centre of rotation (3, 3) of wheels and balance masses at home."""
    mass, moment, total = 0.0, np.zeros(3), np.zeros((3, 3))
    across, along = parameters.wheel_transverse_inertia_kg_m2, parameters.wheel_inertia_kg_m2
    own = {
        name: across * np.eye(3) + (along - across) * np.outer(axis, axis)
        for name, axis in zip(WHEELS, parameters.wheel_axes.T, strict=True)
    } | {name: np.diag(spec.body(name).inertia) for name in BALANCE_MASSES}
    for name, tensor in own.items():
        body = spec.body(name)
        position = np.array(body.pos)
        mass += body.mass
        moment += body.mass * position
        total += tensor + mass_geometry.point_mass(body.mass, position)
    return mass, moment, total


def drive_errors(parameters: NacsParameters) -> DriveErrors:
    """Of the wheels' drives."""
    return DriveErrors(parameters.command_bits, parameters.drive_torque_noise_nm)


def air_torque(parameters: NacsParameters) -> AirTorque:
    """Of the air that flows out of the bearing."""
    return AirTorque(parameters.air_torque_nm, parameters.air_torque_correlation_s)


def held_masses(parameters: NacsParameters, prefix: str = "") -> dict[str, float]:
    """Set-points of the balance masses on their rails, m; names of actuators begin with `prefix`."""
    places = 1e-3 * np.array(parameters.balance_position_mm)
    return {prefix + name: float(place) for name, place in zip(BALANCE_MASSES, places, strict=True)}


def _joints(parameters: NacsParameters) -> dict[str, Joint]:
    """What resists in wheels' bearings and in the air bearing."""
    return joints_of(WHEELS, parameters) | {"bearing": Joint(damping=parameters.bearing_viscous_nms)}


def _unmodelled(testbeds: Sequence[NacsParameters]) -> UnmodelledTorque:
    """The torque that each trial's testbed has and no filter knows."""

    def value(name: str) -> Array:
        return np.array([getattr(testbed, name) for testbed in testbeds], dtype=float)

    return UnmodelledTorque(
        weight=value("mass_kg") * value("gravity_m_s2"),
        centre_of_mass=1e-6 * value("centre_of_mass_um"),
        wheel_axes=testbeds[0].wheel_axes,
        wheel_coulomb=value("wheel_coulomb_nm"),
        wheel_viscous=value("wheel_viscous_nms"),
        bearing_viscous=value("bearing_viscous_nms"),
    )


PLANT_KIND = PlantKind(
    parameters=NacsParameters,
    says="the air-bearing testbed with four reaction wheels",
    compile=compile_nacs,
    prepare=prepare_nacs,
    believed=lambda parameters, wheel_drag, fault: parameters.process(wheel_drag=wheel_drag, fault=fault),
    layout=lambda _: StateLayout.of_a_body(len(WHEELS)),
    drives=drive_errors,
    air=air_torque,
    holds=held_masses,
    joints=_joints,
    tilt_limit_deg=TILT_LIMIT_DEG,
    no_load_speed=lambda parameters: parameters.no_load_speed,
    wheel_momentum=lambda parameters: parameters.wheel_momentum,
    filled_s=lambda parameters: parameters.filled_s,
    dispersible=(
        "inertia_kg_m2",
        "centre_of_mass_um",
        "balance_position_mm",
        "wheel_coulomb_nm",
        "wheel_viscous_nms",
        "bearing_viscous_nms",
        "drive_torque_noise_nm",
        "air_torque_nm",
        "air_torque_correlation_s",
    ),
    effects={
        "centre of mass under gravity": {"gravity_m_s2": 0.0},
        "air torque": {"air_torque_nm": 0.0},
        **FRICTIONS,
        "drive torque noise": {"drive_torque_noise_nm": 0.0},
        "set-point quantisation": {"command_bits": 0},
        "drive limits": {"drive_current_a": 1e4, "supply_voltage_v": 1e6},
        "bearing drag": {"bearing_viscous_nms": 0.0},
        "wheel imbalance": {"wheel_imbalance_um": 0.0},
    },
    learnable=Learnable(body=lambda parameters: parameters.driven_body(), torque=_unmodelled),
)
