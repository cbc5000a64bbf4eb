"""A dumbbell with a reaction wheel about each of its axes: a plant that no part of the twin knows.

It shows all that a plant needs: parameters with a `type`, its MJCF, and one PLANT_KIND.
"""

from __future__ import annotations

from typing import Literal

import mujoco
import numpy as np

from models.dynamics.rigid_body import RigidBody
from models.dynamics.state_layout import StateLayout
from models.dynamics.wheel_faults import WheelFault
from models.plants import inertia as mass_geometry
from models.plants.assembly import Assembly, Carrier, Prepared, assemble, prepare
from models.plants.provenance import known
from models.plants.register.kind import PlantKind
from models.plants.register.parameters import PlantParameters
from models.plants.wheels import FRICTIONS, alike, attached, joints_of, mount
from models.sections import NonNegative, Positive, Sextuple

WHEELS = ("wheel_1", "wheel_2", "wheel_3")

MJCF = """
<mujoco model="dumbbell">
  <compiler angle="radian" autolimits="true" inertiafromgeom="false"/>
  <option timestep="0.01" integrator="RK4" gravity="0 0 0"><flag energy="enable" contact="disable"/></option>
  <worldbody>
    <light pos="0 -3 3" dir="0 1 -1"/>
    <body name="bar">
      <freejoint name="bar" align="false"/>
      <inertial pos="0 0 0" mass="1" diaginertia="1 1 1"/>
      <geom type="capsule" size="0.03" fromto="-0.5 0 0 0.5 0 0" mass="0"/>
      <geom type="sphere" size="0.1" pos="-0.5 0 0" mass="0"/>
      <geom type="sphere" size="0.1" pos="0.5 0 0" mass="0"/>
      WHEELS
    </body>
  </worldbody>
  <actuator>MOTORS</actuator>
  <keyframe><key name="rest" qpos="0 0 0 1 0 0 0 0 0 0"/></keyframe>
</mujoco>
"""
WHEEL = """<body name="{0}" pos="{1} 0 0"><joint name="{0}" type="hinge" axis="0 0 1"/>
  <inertial pos="0 0 0" mass="1" diaginertia="1 1 1"/><geom type="cylinder" size="0.05 0.01" mass="0"/></body>"""


class DumbbellParameters(PlantParameters):
    """Every number of the dumbbell."""

    type: Literal["dumbbell"] = "dumbbell"
    inertia_kg_m2: Sextuple = known((0.04, 0.5, 0.52, 0.0, 0.01, 0.0), "whole, wheels locked", "kg m2", "made up")
    mass_kg: Positive = known(4.0, "whole", "kg", "made up")
    wheel_inertia_kg_m2: Positive = known(1e-3, "about its spin axis", "kg m2", "made up")
    wheel_transverse_inertia_kg_m2: Positive = known(6e-4, "across it", "kg m2", "made up")
    wheel_mass_kg: Positive = known(0.2, "of a wheel", "kg", "made up")
    wheel_torque_limit_nm: Positive = known(0.2, "of a motor", "N m", "made up")
    wheel_coulomb_nm: NonNegative = known(1e-4, "dry friction of a bearing", "N m", "made up")
    wheel_viscous_nms: NonNegative = known(1e-6, "viscous friction of a bearing", "N m s/rad", "made up")
    step_s: Positive = known(0.01, "physics step", "s", "made up")

    @property
    def inertia(self) -> np.ndarray:
        """J with wheels locked, (3, 3) kg m2."""
        return mass_geometry.tensor(self.inertia_kg_m2)

    @property
    def wheel_axes(self) -> np.ndarray:
        """One wheel about each axis of B, (3, 3)."""
        return np.eye(3)

    @property
    def torque_limit(self) -> float:
        """N m a wheel."""
        return self.wheel_torque_limit_nm

    def process(self, fault: WheelFault | None = None) -> RigidBody:
        """Rigid body in seven states; wheel speeds are read."""
        motors = (fault or WheelFault.healthy(len(WHEELS))).on_body(self.wheel_axes)
        return RigidBody(self.inertia, motors.torque_map, self.wheel_inertia_kg_m2 * self.wheel_axes, motors.constant_torque_B)


def prepare_dumbbell(parameters: DumbbellParameters) -> Prepared:
    """The MJCF with its parameters."""
    wheels = "".join(WHEEL.format(name, 0.1 * number) for number, name in enumerate(WHEELS))
    motors = "".join(f'<motor name="{name}" joint="{name}"/>' for name in WHEELS)
    spec = mujoco.MjSpec.from_string(MJCF.replace("WHEELS", wheels).replace("MOTORS", motors))
    spec.option.timestep = parameters.step_s
    mount(spec, WHEELS, parameters)
    own = parameters.mass_kg - len(WHEELS) * parameters.wheel_mass_kg
    bar = Carrier("bar", own, parameters.mass_kg, *attached(spec, WHEELS, parameters), about_mass_centre=True)
    return prepare(spec, parameters, bar.reassemble, "wheels")


def compile_dumbbell(parameters: DumbbellParameters) -> Assembly:
    """Ready to be stepped."""
    return assemble(lambda: prepare_dumbbell(parameters), parameters, "bar", parameters.process(), alike(WHEELS, parameters))


PLANT_KIND = PlantKind(
    parameters=DumbbellParameters,
    says="a dumbbell with a reaction wheel about each of its axes",
    compile=compile_dumbbell,
    prepare=prepare_dumbbell,
    believed=lambda parameters, _, fault: parameters.process(fault),
    layout=lambda _: StateLayout.of_a_body(0),
    joints=lambda parameters: joints_of(WHEELS, parameters),
    dispersible=("inertia_kg_m2", "wheel_coulomb_nm", "wheel_viscous_nms"),
    effects=FRICTIONS,
)
