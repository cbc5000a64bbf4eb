"""Prints docs/parameters.md from the tables in the source: python docs/parameters.py > docs/parameters.md."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Protocol

import numpy as np

from models.plants import formation, monolithic
from models.plants.agents import AgentsParameters
from models.plants.flexible_parameters import FLEXIBLE_SETS, FlexibleParameters
from models.plants.formation import FormationParameters
from models.plants.formation_nacs import FormationNacsParameters
from models.plants.freeflyer import FreeflyerParameters
from models.plants.monolithic import MonolithicParameters
from models.plants.nacs import NacsParameters
from models.plants.register.entries import KINDS
from sim.sensors.sensors import SENSOR_SETS, SensorSettings


class Documented(Protocol):
    """Parameters that can say of each where it comes from."""

    def table(self) -> Iterator[tuple[str, str, str, str, str]]:
        """Rows (name, value, unit, meaning, provenance)."""
        ...


PROVENANCE = {  # of the values of set `bench`
    "attitude_noise_rad": "chosen: 0.023 deg, an attitude filter at rest",
    "attitude_resolution_rad": "chosen: off",
    "gyro_noise_rad_s": "published (sec. 5): variance 3e-6 rad2/s2",
    "gyro_bias_rad_s": "datasheet (VN-100): in-run bias 10 deg/h",
    "gyro_bias_walk_rad_s_sqrt_s": "chosen: 2e-5 rad/s in 100 s",
    "gyro_resolution_rad_s": "datasheet (VN-100): 0.02 deg/s",
    "gyro_range_rad_s": "datasheet (VN-100): 2000 deg/s",
    "wheel_noise_rad_s": "chosen: about one step of the monitor output",
    "wheel_full_scale_rad_s": "chosen: 8000 rpm, the no-load speed",
    "wheel_bits": "datasheet (ESCON: 12-bit monitor output over +-4 V)",
    "latency_s": "chosen: off",
    "jitter_s": "chosen: off",
    "dropout_probability": "chosen: off",
}

PLANT = NacsParameters()
MOMENTS = ", ".join(f"{moment:.6f}" for moment in np.linalg.eigvalsh(PLANT.inertia))
CORNER = (PLANT.supply_voltage_v - PLANT.drive_current_a * PLANT.winding_resistance_ohm) / PLANT.motor_constant_nm_a


def rows(parameters: Documented) -> str:
    """A table's rows."""
    return "\n".join(f"| `{name}` | {value} | {unit} | {meaning} | {source} |" for name, value, unit, meaning, source in parameters.table())


def tensors(sets: Mapping[str, object]) -> str:
    """Rows of named sets of inertias [xx, yy, zz, xy, xz, yz]."""
    return "\n".join(
        f"| `{name}` | {number} | {', '.join(f'{value:.4g}' for value in row)} |"
        for name, chosen in sets.items()
        for number, row in enumerate(np.atleast_2d(np.array(chosen)), start=1)
    )


FLEXIBLE = {name: FlexibleParameters.model_validate({"set": name}) for name in FLEXIBLE_SETS}
FLEXIBLE_ROWS = "\n".join(
    f"| `{name}` | {' | '.join(str(getattr(row, name)) for row in FLEXIBLE.values())} | {unit} | {meaning} | {source} |"
    for name, _, unit, meaning, source in FLEXIBLE["boeing702"].table()
    if name != "set"
)
SENSOR_ROWS = "\n".join(
    f"| `{name}` | {' | '.join(f'{getattr(row, name):.6g}' for row in SENSOR_SETS.values())} | {info.description} "
    f"| {PROVENANCE.get(name, 'chosen: off')} |"
    for name, info in SensorSettings.model_fields.items()
    if name != "distribution"
)

DESCRIBED = {"nacs", "freeflyer", "flexible", "monolithic", "formation", "formation-nacs", "agents"}  # with more than their parameters
OTHERS = "".join(
    f'## {kind.says[:1].upper()}{kind.says[1:]} (`type = "{name}"`)\n\n'
    f"| key | value | unit | meaning | provenance |\n|---|---|---|---|---|\n{rows(kind.parameters())}\n\n"
    for name, kind in KINDS.items()
    if name not in DESCRIBED
)

MARKDOWN = f"""\
# Parameters

Printed by `docs/parameters.py` from the tables in `models/` and `sim/sensors/sensors.py`: change a number there, not here. Every key can
be set in a scenario (`[plant]`, `[sensors]`) or by `--set plant.mass_kg=3.4`; keys carry their unit. *Published*: McCafferty-Leroux et
al. 2024. *Datasheet*: see the sources below. *Chosen*: unpublished, set once to a sensible value; conclusions must not hinge on it.

## Plant

| key | value | unit | meaning | provenance |
|---|---|---|---|---|
{rows(PLANT)}

What follows from them:

| quantity | value | from |
|---|---|---|
| principal moments of J_B | {MOMENTS} kg m2 | `inertia_kg_m2` |
| torque limit of a wheel | {PLANT.torque_limit:.5f} N m | motor constant x drive current |
| no-load speed | {PLANT.no_load_speed:.1f} rad/s | usable voltage / motor constant |
| speed up to which the torque limit holds | {CORNER:.1f} rad/s | (usable voltage - current x resistance) / motor constant |
| momentum of a wheel at no-load speed | {PLANT.wheel_inertia_kg_m2 * PLANT.no_load_speed:.5f} N m s | J_w x no-load speed |
| step of the torque set-point | {2e6 * PLANT.torque_limit / 2**PLANT.command_bits:.2f} uN m | twice the torque limit / 2^bits |

## The probe (`type = "freeflyer"`)

*Published* here: Hill, Gadsden & Biglarbegian 2021.

| key | value | unit | meaning | provenance |
|---|---|---|---|---|
{rows(FreeflyerParameters())}

## The flexible spacecraft (`type = "flexible"`)

`set` names the column; any key can be given besides.

| key | {" | ".join(f"`{name}`" for name in FLEXIBLE)} | unit | meaning | provenance |
|---|{"---|" * len(FLEXIBLE)}---|---|---|
{FLEXIBLE_ROWS}

## The rigid spacecraft (`type = "monolithic"`)

*Published* here and below: Rososhansky 2017.

| key | value | unit | meaning | provenance |
|---|---|---|---|---|
{rows(MonolithicParameters())}

| set | row | xx, yy, zz, xy, xz, yz, kg m2 |
|---|---|---|
{tensors(monolithic.INERTIA_SETS)}

## Spacecraft in formation (`type = "formation"`)

| key | value | unit | meaning | provenance |
|---|---|---|---|---|
{rows(FormationParameters())}

| set | spacecraft | xx, yy, zz, xy, xz, yz, kg m2 |
|---|---|---|
{tensors(formation.INERTIA_SETS)}

## Testbeds in formation (`type = "formation-nacs"`)

What each has beyond the parameters of the plant above, which are keys of `testbed` here (`--set plant.testbed.air_torque_nm=0`).

| key | value | unit | meaning | provenance |
|---|---|---|---|---|
{rows(FormationNacsParameters())}

## Agents in the plane (`type = "agents"`)

| key | value | unit | meaning | provenance |
|---|---|---|---|---|
{rows(AgentsParameters())}

{OTHERS}## Sensors

| key | {" | ".join(f"`{name}`" for name in SENSOR_SETS)} | meaning | provenance of `bench` |
|---|{"---|" * len(SENSOR_SETS)}---|---|
{SENSOR_ROWS}

`bench` is what a well set-up testbed would read. `paper` takes the variances that the paper uses for its R as if they were the sensors'
own: 3e-6 of a quaternion component is a rotation of 2 sqrt(3e-6) rad about an axis; 2.42e-3 V2 of a wheel is read at 1 V = 52.36 rad/s
([errata](errata.md), 16). `vn100` is the gyro's noise density over 5 Hz, half the loop's rate. `ideal` says the truth.

## Sources

- **Published.** A. McCafferty-Leroux, W. Hilal, S. A. Gadsden, M. Al-Shabi, *Adaptive SIF-EKF Estimation for Fault Detection in Attitude
  Control Experiments*, 2024: eq. 6 (pyramid), eq. 26 (inertias), sec. 5 (variances). Its J_yy is used with one zero restored, a
  hypothesis ([errata](errata.md), 1).
- **VN-100** (VectorNav), datasheet figures as quoted by others: gyro noise density 0.0035 deg/s/sqrt(Hz) = 6.1e-5 rad/s/sqrt(Hz), in-run
  bias 10 deg/h, range 2000 deg/s, resolution 0.02 deg/s, IMU output to 800 Hz, attitude output to 400 Hz. The density has been misread
  elsewhere as rad/s, 57 times too much. Over the 800 Hz of the raw output it gives a variance of 2.99e-6 rad2/s2: the paper's 3e-6 is
  that of one raw sample.
- **ESCON 24/2** (maxon), figures of the ESCON family, not all of this very module: supply 10 to 24 V, 2 A continuous, 6 A peak, usable
  motor voltage 0.98 Vcc, 12-bit set-point, 12-bit monitor output over +-4 V, current loop at 53 kHz (here instantaneous). The peak
  current is not used.
- **The wheels.** Only J_w is published; motor, torque and speed limits are not. The motor constant is chosen so that the drive runs out
  of voltage at 8000 rpm.
- **Balance.** S. Chesi, Q. Gong, V. Pellegrini, R. Cristi, M. Romano, *Automatic Mass Balancing of a Spacecraft Three-Axis Simulator:
  Analysis and Experimentation*, J. Guidance, Control, and Dynamics 37(1), 2014: sliding masses bring the centre of mass within
  micrometres of the centre of rotation.
"""

if __name__ == "__main__":
    print(MARKDOWN, end="")
