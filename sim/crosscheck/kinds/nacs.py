"""The cross-check's entry of the air-bearing testbed."""

from __future__ import annotations

from models.plants.nacs import BALANCE_MASSES, NacsParameters
from sim.crosscheck.attribution import Effect
from sim.crosscheck.family import FAULTS, PlantFamily, off
from sim.crosscheck.kinds.physics_checks import NACS_CHECKS, clamp_masses, take_stop_away
from sim.crosscheck.kinds.printed_errors import NACS_FAILURES
from sim.crosscheck.model_variants import NACS_MODELS
from sim.crosscheck.open_loop import Change, Rig
from sim.plant.batch import Plant


def hold_masses(plant: Plant, parameters: NacsParameters) -> None:
    """Keep the balance masses where the parameters have them."""
    for name, position in zip(BALANCE_MASSES, parameters.balance_position_mm, strict=True):
        plant.hold(name, 1e-3 * position)


NACS: PlantFamily[NacsParameters] = PlantFamily(
    models=NACS_MODELS,
    exact=lambda parameters: parameters.process(coupled=True),
    whole=lambda parameters: parameters.process(coupled=True),
    effects=(
        off("centre of mass under gravity", gravity_m_s2=0.0),
        off("air torque", air_torque_nm=0.0),
        off("wheel dry friction", wheel_coulomb_nm=0.0),
        off("wheel viscous friction", wheel_viscous_nms=0.0),
        off("drive torque noise", drive_torque_noise_nm=0.0),
        off("set-point quantisation", command_bits=0),
        off("drive limits", drive_current_a=1e4, supply_voltage_v=1e6),
        off("bearing drag", bearing_viscous_nms=0.0),
        off("wheel imbalance", wheel_imbalance_um=0.0),
        Effect("balance masses give way", Change(built=(clamp_masses,))),
        FAULTS,
    ),
    checks=NACS_CHECKS,
    failures=NACS_FAILURES,
    rig=Rig(free=take_stop_away, settle=hold_masses),
)
