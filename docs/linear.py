"""Prints docs/linear.md, its table of margins computed anew: python docs/linear.py > docs/linear.md."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, NamedTuple

from sim.linear.of_loops import cases
from sim.scenario import files
from sim.tables.linear import COLUMNS, margin_rows


class Shown(NamedTuple):
    """What the table has of a loop: its situations as (believed, so), and what it is called."""

    scenario: str
    loop: str | None
    law: str
    situations: tuple[tuple[int, int], ...] = ((0, 0),)
    changes: dict[str, Any] = {}  # noqa: RUF012  # never written to
    flown: bool = False


ALL = ((0, 0), (1, 1), (0, 1), (1, 0))
SHOWN = (
    Shown("nacs/fault-free", None, "PD"),
    Shown("nacs/fault-free", None, "PD, readings 50 ms late", changes={"sensors.latency_s": 0.05}),
    Shown("nacs/imm-wheel-failure", "pd-imm", "PD, blended", ALL),
    Shown("nacs/imm-wheel-failure", "pd-imm-realloc", "PD, reallocation", ((1, 1), (0, 1), (1, 0))),
    Shown("nacs/imm-wheel-failure", "smc-imm", "sliding mode in its layer, blended", ALL),
    Shown("nacs/unfalsified", "adaptive", "unfalsified, first gains"),
    Shown("nacs/unfalsified", "nominal", "unfalsified, frozen"),
    Shown("nacs/fault-free", None, "PD", flown=True),
    Shown("nacs/imm-wheel-failure", "pd-imm", "PD, blended", flown=True),
    Shown("nacs/imm-wheel-failure", "smc-imm", "sliding mode in its layer, blended", flown=True),
    Shown("nacs/gyroless", "aukf-matched", "PD, no rate gyro", flown=True),
    Shown("nacs/unfalsified", "nominal", "unfalsified, frozen", flown=True),
)


def rows(shown: Shown) -> Iterator[str]:
    """A row for every situation of a loop."""
    found = cases(files.load(shown.scenario, dict(shown.changes)), shown.loop, flown=shown.flown)
    chosen = [case for case in found if (case.believed, case.mode) in shown.situations]
    for loop, *cells in margin_rows(chosen):
        place = f"`{shown.scenario}`" if shown.loop is None else f"`{shown.scenario}`, `{loop}`"
        yield f"| {place} | {shown.law} | {' | '.join(cells)} |"


def page(table: list[str]) -> str:
    """The whole page with the rows of its table."""
    heads = ["scenario, loop", "law", *COLUMNS[1:]]
    return f"""# Linear models and margins

`nacs linearize` gives the plant of a scenario of one body as a linear model: A, B, C, D, with names and units, poles and zeros. This
page is printed by `python docs/linear.py`; a test compares the two.

```sh
nacs linearize nacs/fault-free                                   # states, inputs, outputs, poles
nacs linearize nacs/fault-free --sampled --out plant.mat         # at the control period, with exact delays; or .npz
nacs linearize nacs/fault-free --at 5                            # about where the first trial is after 5 s
nacs linearize nacs/fault-free --set 'plant.centre_of_mass_um=[0,0,-500]' --set 'start.wheel_speed_rad_s=[200,200,200,200]'
nacs linearize nacs/imm-wheel-failure --loop smc-imm --margins   # gain, phase, delay and disk margins of a law
nacs linearize nacs/imm-wheel-failure --loop smc-imm --flown     # the same of the loop with its filter, from flights
```

```python
import nacs

model = nacs.linearize("nacs/fault-free", sampled=True)
model.A, model.B, model.C, model.D, model.dt
model.poles, model.rates, model.zeros("theta1", "torque1")
model.state_space()  # a scipy.signal.StateSpace
[case] = nacs.margins("nacs/fault-free")
print([round(one.gain_up, 2) for one in case.margins])  # axes 1, 2, 3 and all alike
```

[examples/lqr.py](examples/lqr.py) designs a regulator on such a model and flies it.

**python-control.** It cannot live in the twin's environment, whose own package is called `control`. Write a file, and in another
environment:

```text
m = numpy.load("plant.npz"); control.ss(m["A"], m["B"], m["C"], m["D"], float(m["dt"]))     # dt 0: continuous, as control has it
```

In MATLAB `load plant.mat; ss(A, B, C, D, dt)`.

## What the model is

dx/dt = A x + B u + drift, y = C x + D u; sampled, the next x is A x + B u + drift. x, u and y are deviations from the operating point.

| | |
|---|---|
| states | `theta1..3`: small rotation in B from the operating attitude, three coordinates and not the quaternion's four; `omega1..3`; \
`wheel1..4`, speeds; angles and rates of what else moves, such as panels and balance masses. Not: angles of balanced wheels and the \
place of a free body, on which nothing depends |
| inputs | `motor1..4`: torques of motors on wheels, N m; `torque1..3`: a torque on the body from outside, in B |
| outputs | what the sensors read: `theta`, `omega`, `wheel` |
| delays | `sensors.latency_s` and half of `jitter_s`: sampled, as states that hold older readings, between two samples by interpolation \
as the sensors do it; continuous, Pade's approximation of order 3. A law's own delay (`delay_ticks`) is in its margins |
| `drift` | what x does at the operating point itself: zero at an equilibrium; gravity on a centre of mass out of place gives one |
| left out | faults, noise, resolution, the limits of drives, and dry friction, which has no derivative where a wheel stands still |

The operating point is at rest in the reference's first attitude, with the wheels as they start; with `--at` it is where the first trial
is then, under the torque that the law asks for.

**Two ways.** `differences`, the default: central differences of the twin's own step (RK4), in all perturbations at once; the sampled
model reaches over a whole control period so, the continuous one is the logarithm of one physics step. `--way mujoco`: MuJoCo's own
derivatives (`mjd_transitionFD`), which refuse RK4, of a copy of the model that steps by `implicitfast`, a hundredth as far. The two
agree to 1e-3 in every coefficient but those of the stiff balance masses; poles of a pendulum, of wheels with friction and of a flexible
mode agree with closed forms to 1e-3 either way (`tests/test_linear.py`).

## Margins of the laws at the testbed

The loop is what the computer closes: torque asked for, shared among the wheels, held for a control period; the sampled plant; readings
with their delays; the law's slope at rest. Rows told the `state` leave the filter out. The others are flown with it (`--flown`): one
trial four times over with the same noise, three times with a pulse of torque that no filter is told of, about an axis each; the
difference of what the law asks for is T = -L / (1 + L), and so L. Flown with the true state, the two ways agree to three digits
(`tests/test_linear.py`).

| column | what it is |
|---|---|
| told | who tells the law the state |
| believes, is so | the mode that the law is told of, and the plant's: `mode 2` of a loop is wheel 1 without torque |
| gain | by which factors one axis can change, the others as they are: the weakest of the three axes |
| gain, all | the same of all three alike, the law's gain; confirmed by flights at 0.95 and 1.05 of it, which settle and do not |
| deg, ms | phase and delay of one axis |
| disk | alpha of the symmetric disk margin of one axis: gain and phase may both change, by (1 + d/2) / (1 - d/2) with any complex \
abs(d) < alpha; alpha = 1 is a gain of 1/3 to 3 and a phase of 53 deg |
| disk, all | of all axes at the same time, each in its own way; a lower bound (Seiler, Packard & Gahinet 2020) |

| {" | ".join(heads)} |
|{"---|" * len(heads)}
{chr(10).join(table)}

What it says: the sampling, not the body, sets these margins. PD and sliding mode lose stability where a torque that is held for a tick
turns the rate error over, at K_d T / J = 2, first about y, whose moment is the least. Gains that were raised for a failed wheel cost a
quarter of the gain margin if the alarm is false. With a wheel gone and no reallocation, axes are coupled: any one of them bears more
phase than before, all together, each in its own way, bear less; with reallocation nothing is lost. Readings late by half a tick take 9
deg and 15 % of the gain.

With its Kalman filter a loop has 10 deg less phase and four times the gain margin: a filter that knows the torque that was commanded
trusts its model beyond a few rad/s, and passes little of what the drives do besides. That is so for gains that the drives have wrong;
what the law itself has wrong its filter knows, and then the rows told the state hold. Without a rate gyro little of either is left. All
of it holds for small signals: near such a margin a start one degree off brings the drives to their limit, and the loop does not come
back.

A law that switches at rest (a sliding mode without boundary layer, finite-time laws) has no slope and no margins; the command says so.
"""


if __name__ == "__main__":
    print(page([row for shown in SHOWN for row in rows(shown)]), end="")
