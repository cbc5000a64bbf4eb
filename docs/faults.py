"""Prints docs/faults.md from the register of kinds: python docs/faults.py > docs/faults.md."""

from __future__ import annotations

from collections.abc import Iterator

from sim.faults.events import KINDS, Event, OfAgents, OfLinks, OfSensor, OfWheel
from sim.faults.kinds import GROUPS
from sim.faults.parts import FAMILIES

TARGETS = {OfWheel: "wheel", OfSensor: "sensor", OfAgents: "agents", OfLinks: "links"}


def targets(kind: type[Event]) -> list[str]:
    """Keys that say which part it is of."""
    return [key for of, key in TARGETS.items() if issubclass(kind, of)]


def keys(kind: type[Event]) -> Iterator[str]:
    """Keys of its size, with their defaults."""
    for name, field in kind.model_fields.items():
        if name not in Event.model_fields and name not in targets(kind):
            default = getattr(field.default, "constant", field.default)
            optional = "" if field.is_required() or default is None else f" = {str(default).lower() if default is True else default!r}"
            yield f"`{name}{optional}`"


def rows() -> Iterator[str]:
    """A row for every kind, by what it is of."""
    groups = [group.__name__ for group in GROUPS]
    for name, kind in sorted(KINDS.items(), key=lambda item: groups.index(item[1].__module__)):
        where = ["x" if family in kind.families else "" for family in FAMILIES]
        older = ", ".join(f"`{alias.kind}` ({alias.family})" for alias in kind.aliases)
        shapes = "all" if kind.shapes == Event.shapes else ", ".join(kind.shapes)
        what = " ".join((kind.__doc__ or "").split("\n\n")[0].split())
        of = ", ".join(f"`{key}`" for key in targets(kind))
        yield f"| `{name}` | {what} | {of} | {', '.join(keys(kind))} | {' | '.join(where)} | {shapes} | {older} |"


PAGE = f"""# Faults

What goes wrong, in every family of scenarios by the same names. This page is printed by `python docs/faults.py`; a test compares the
two.

```toml
[[faults]]
kind = "bias"
sensor = "gyro"
size = {{ uniform = [0.01, 0.02] }}   # rad/s, drawn anew in every trial
start_s = 20.0
end_s = 60.0
shape = "ramp"
ramp_s = 10.0
```

```sh
nacs run nacs/fault-free --set "faults=[{{kind='float',wheel=2,start_s=20,duration_s=30}}]"
nacs run consensus/fault-free --set "faults=[{{kind='message-loss',probability=0.5,start_s=2,end_s=8}}]"
nacs run formation/nacs --set "faults=[{{kind='drop-out',agents=[3],start_s=20,end_s=25}}]"
```

## When, and how it grows

| key | what it is |
|---|---|
| `start_s` | when it begins, s |
| `duration_s` | how long it lasts, s; it must end within the run |
| or `end_s` | when it ends, s; beyond the run it is the run's end |
| `shape` | `step` (default); `ramp`: grows linearly from nothing; `intermittent`: comes and goes |
| `ramp_s` | in which a ramp reaches its full size, which then stays; without it, at the end of the fault |
| `period_s`, `duty` | of an intermittent fault: it is there for the first `duty` of every period; a half without it |

A fault has one of `duration_s` and `end_s`; `dynamics` and `disturbance-change` may have neither, and last until the next of their kind.
These numbers and all sizes may be drawn anew in every trial, as `{{ uniform = [1, 2] }}`, `{{ normal = [mean, deviation] }}`, `{{
log_uniform = [1, 2] }}` or `{{ choice = [1, 2, 3] }}`; `inertia_kg_m2`, `direction` and `pulsation_rad_s` are numbers. Trial i draws
the same whatever the batch: each fault has a stream of random numbers of its own, by its place in the file. Ticks are those of
[conventions.md](conventions.md).

A ramp that has grown to the share w of its size does this: what is added is added w-fold; a factor f is 1 + w (f - 1); what takes the
place of something is w-fold beside (1 - w) of what it replaces. A bearing that seizes so gets 1 - w of its own dry friction and w of
that of a seized one, 40 times the drive's torque.

**Of which part.** `wheel` is a number from 1 or `"all"`; `agents` is a list of numbers from 1 or `"all"` (default), and is left out
where the plant is one body; `sensor` is a name or `"all"` (default): `attitude`, `gyro`, `wheels` of one body, `attitude` of a
formation, `position`, `speed` of agents in the plane; `links` is a list of pairs, 0 being the leader, or `"all"` (default of
`message-loss`). Biases and deviations are in the unit of the reading: rad, rad/s, of sigma in a formation, m and m/s in the plane.

**Two at once.** Torques, forces, biases, delays of readings and added inertia add up; factors (`effectiveness`, `factor` of `noise`)
multiply; of two that put different things in the place of one, the one later in the file is heard.

## Kinds

{" | ".join(["| kind", "what happens", "of", "keys", *FAMILIES.values(), "shapes", "older name |"])}
|{"---|" * (6 + len(FAMILIES))}
{chr(10).join(rows())}

Older names are still read in files of the family that is named; `disturbance` of a formation had `size_nm`, now `amplitude_nm`. `delay`
of a formation or of agents in the plane is one of messages unless it says which `agents`' readings it is of.

Wheel faults need wheels, faults of links a network; where there is none, one line says so before anything runs. A wheeled body's
`constant-command` is `constant-output` of its wheels; in a formation of testbeds it takes the place of what the law asks of the wheels.
Filters are told what the law commands, not what faults make of it. While an agent's sensor is silent its filter predicts; without a
filter, in the plane, the last reading stands, and until the first one zero.

**Another kind** is a class in one of the files in sim/faults (`wheels.py`, `commands.py`, `pushes.py`, `bodies.py`, `readings.py`,
`links.py`) with `kind`, its keys and `lay`, which puts, adds or scales one of the effects of sim/faults/effects.py; and a test. It is
then in the register, in this table, and in every check."""

if __name__ == "__main__":
    print(PAGE, end="")
