"""The cross-check's entry of the air-bearing testbed."""

from __future__ import annotations

from models.plants.nacs import PLANT_KIND, NacsParameters
from sim.crosscheck.attribution import Effect
from sim.crosscheck.family import FAULTS, PlantFamily, effects_of
from sim.crosscheck.kinds.physics_checks import NACS_CHECKS, clamp_masses, take_stop_away
from sim.crosscheck.kinds.printed_errors import NACS_FAILURES
from sim.crosscheck.model_variants import NACS_MODELS
from sim.crosscheck.open_loop import Change, Rig

NACS: PlantFamily[NacsParameters] = PlantFamily(
    models=NACS_MODELS,
    exact=lambda parameters: parameters.process(coupled=True),
    whole=lambda parameters: parameters.process(coupled=True),
    effects=(
        *effects_of(PLANT_KIND),
        Effect("balance masses give way", Change(built=(clamp_masses,))),
        FAULTS,
    ),
    checks=NACS_CHECKS,
    failures=NACS_FAILURES,
    rig=Rig(free=take_stop_away),
)
