"""The vector environment: its pace beside plant and sensors alone, and a trained policy beside two laws of the field."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from statistics import median

import numpy as np
from numpy.typing import NDArray

from benchmarks import tracking_policy
from benchmarks.measure import cpu_seconds
from benchmarks.show import figure, table
from nacs.environments import TrackingVectorEnv
from sim.controllers.settings import MemorylessSettings, PdSettings, SlidingModeSettings
from sim.loop import tracking_task
from sim.loop.body import build_body
from sim.loop.closed_loop import System

Array = NDArray[np.floating]
Policy = Callable[[TrackingVectorEnv, Array], Array]

TRIALS, TICKS = 64, 200
FLOWN, SEED = 16, 99  # trials of the second table
SETTLED = 100  # ticks after which errors count
NO_PAST = np.empty(0)  # no reading of these scenarios is late
SCENARIOS = ("nacs/fault-free", "nacs/disturbance", "nacs/wheel-failure")


def environment() -> None:
    """Environment, and plant and sensors alone under the same torques, a tick of each in turn."""
    flown = TrackingVectorEnv(TRIALS, "nacs/fault-free", set={"run.ticks": TICKS})
    gains = tracking_policy.read()
    flown.reset(seed=SEED)
    bare = build_body(flown.loop.scenario, np.arange(TRIALS))
    shares, steps, push = np.linalg.pinv(bare.plant.assembly.wheel_axes), round(bare.dt / bare.plant.step_s), np.zeros((TRIALS, 3))
    ours, theirs = [], []
    for tick in range(TICKS - 1):
        action = tracking_policy.action(gains, tracking_task.observation(flown.loop))
        motors = -flown.task.torque_nm * action @ shares.T
        theirs.append(cpu_seconds(partial(_alone, bare, motors, push, steps, tick + 1)))
        ours.append(cpu_seconds(partial(flown.step, action)))
    rows = [[name, figure(1e3 * median(times))] for name, times in (("plant and sensors", theirs), ("environment", ours))]
    pace = 100.0 * median(theirs) / median(ours)
    table(f"A tick of {TRIALS} trials", ["", "ms CPU"], rows, f"The environment has {pace:.0f} % of the pace of plant and sensors alone.")


def policies() -> None:
    """The policy that was trained, proportional-derivative and sliding mode, all on the last readings."""
    gains = tracking_policy.read()
    laws: dict[str, Policy] = {
        "linear policy by CEM": lambda _, observed: tracking_policy.action(gains, observed),
        "PD": _of(PdSettings(type="pd", feedback="measurement")),
        "sliding mode": _of(
            SlidingModeSettings(type="sliding-mode", slope_rad_s=6.0, reaching_rad_s2=0.3, boundary_layer_rad_s=0.1, feedback="measurement")
        ),
    }
    rows = [[f"{scenario}, {name}", *_fly(scenario, law)] for scenario in SCENARIOS for name, law in laws.items()]
    table(f"{FLOWN} episodes", ["", "reward a tick", "RMS error, deg", "RMS torque, mN m", "failed"], rows)


def _alone(bare: System, motors: Array, push: Array, steps: int, tick: int) -> None:
    bare.plant.advance(motors, push, steps)
    bare.sensors.read(tick, bare.plant.truth(), NO_PAST)


def _of(settings: MemorylessSettings) -> Policy:
    """A law as a policy, its torque clipped as actions are."""

    def act(flown: TrackingVectorEnv, _: Array) -> Array:
        law = settings.controller(flown.loop.plant.assembly, flown.loop.dt)
        return law.step(flown.loop.estimate, flown.loop.asked) / flown.task.torque_nm

    return act


def _fly(scenario: str, policy: Policy) -> list[str]:
    """Reward, error and torque of a flight, and the share of bodies that failed."""
    flown = TrackingVectorEnv(FLOWN, scenario)
    observed, _ = flown.reset(seed=SEED)
    rewards, errors, torques, failed = [], [], [], np.zeros(FLOWN, dtype=bool)
    while not flown.loop.over:
        asked = np.clip(policy(flown, observed), -1.0, 1.0)
        observed, reward, terminated, _, info = flown.step(asked)
        rewards.append(reward)
        errors.append(info["error_deg"])
        torques.append(flown.task.torque_nm * asked)
        failed |= terminated
    rms = float(np.sqrt(np.mean(np.square(errors[SETTLED:]))))
    effort = float(np.sqrt(np.mean(np.square(torques[SETTLED:]))))
    return [f"{np.mean(rewards):.3f}", f"{rms:.3f}", f"{1e3 * effort:.2f}", f"{np.sum(failed)}"]
