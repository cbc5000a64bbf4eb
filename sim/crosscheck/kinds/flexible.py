"""The cross-check's entry of the spacecraft with sprung panels: its models and effects."""

from __future__ import annotations

from functools import partial

from models.plants.flexible import PLANT_KIND
from models.plants.flexible_parameters import FlexibleParameters
from models.plants.panelled_body import PanelledBody
from sim.crosscheck.attribution import Effect
from sim.crosscheck.family import FAULTS, PlantFamily, effects_of
from sim.crosscheck.kinds import free_body
from sim.crosscheck.kinds.conic import conic_signs
from sim.crosscheck.kinds.panels import BENCH, PANEL_CHECKS, lock_panels, rigid_body
from sim.crosscheck.model_variants import Model
from sim.crosscheck.open_loop import Change

INSTANTS = (12.0, 30.0, 60.0, 100.0)  # s: the antenna rests for the first ten


def believed(parameters: FlexibleParameters) -> Model:
    """Rigid body of the whole in seven states whose wheel speeds are read: what the twin's filters believe."""
    return Model("believed", parameters.process(), "J_w / J left out", reads_wheels=True)


def rigid(parameters: FlexibleParameters) -> Model:
    """Rigid body of the whole and balanced wheels without any loss: exact if the panels did not bend."""
    return Model("rigid", rigid_body(parameters), "")


def panels(parameters: FlexibleParameters) -> Model:
    """The same with the panels' linear mode about their hinges."""
    return Model("panels", panelled_body(parameters), "panels, small deflections", hidden=2)


def panelled_body(parameters: FlexibleParameters) -> PanelledBody:
    """Equations of the plant with small deflections of its panels."""
    return PanelledBody(parameters.inertia, parameters.wheel_axes, parameters.wheel_inertia_kg_m2, parameters.linear_channel(0))


FLEXIBLE: PlantFamily[FlexibleParameters] = PlantFamily(
    models={"believed": believed, "rigid": rigid, "panels": panels},
    exact=rigid_body,
    whole=rigid_body,
    effects=(
        Effect("panels bend", Change(built=(lock_panels,))),
        *effects_of(PLANT_KIND),
        FAULTS,
    ),
    checks=tuple(partial(check, BENCH) for check in (*free_body.WHEELED_CHECKS, *PANEL_CHECKS)),
    failures=(conic_signs,),
    instants=INSTANTS,
)
