"""Candidates with integral action: their conics and their memory against the laws themselves, and a loop that they close."""

from __future__ import annotations

from typing import cast

import numpy as np
import pytest

from control.candidate_controllers import CandidateSearch, Choice
from control.falsification import Specification, values
from control.integral_control import IntegralControl
from control.integral_databank import IntegralDatabank
from control.unfalsified import UnfalsifiedController
from sim.controllers.settings import UnfalsifiedSettings
from sim.loop.build import assembly_of
from sim.scenario.files import load

TICK = 0.1  # lambda times the sampling time
RATES = (0.02, 0.1)
THETA = np.array([6.0, 3.0])
ASKED = Specification(zero=0.3, error_bound=2.25, effort_bound=np.array([0.09, 0.2]), tick=TICK)  # of two axes
BANK = IntegralDatabank(RATES, TICK)


def record(ticks: int = 150) -> np.ndarray:
    """Effort, rate and position of two axes, (ticks, 3, 2)."""
    return 0.05 * np.cumsum(np.random.default_rng(6).normal(size=(ticks, 3, 2)), axis=0)


def law(rate: float) -> IntegralControl:
    """That of THETA and an integral, without unit."""
    proportional = np.array(1.0 / THETA[0])
    return IntegralControl(proportional, proportional * rate, proportional * THETA[1], np.array(False), TICK)


def heard() -> tuple:
    """The databank after the record, its conics, and the fictitious errors of THETA with each integral, (3, ticks, 2)."""
    memory, evidence = BANK.start(ASKED, (2,), 4), ASKED.start((2,))
    for effort, rate, position in record():
        memory, evidence = BANK.record(memory, ASKED, effort, rate, position), ASKED.record(evidence, effort, rate, position)
    errors, inverses = [], []
    for rate in (0.0, *RATES):
        inverse, found = law(rate).start((2,)), []
        for effort, speed, _ in record():
            error, inverse = law(rate).error(inverse, effort, speed)
            found.append(error)
        errors.append(found)
        inverses.append(inverse)
    return memory, BANK.tests(memory, ASKED, ASKED.tests(evidence)), np.array(errors), inverses


def test_conics_of_every_integral_are_the_norms_of_the_laws_own_errors() -> None:
    _, every, errors, _ = heard()
    found = values(every, np.broadcast_to(THETA, (2, 3, 2)))  # axis, integral, test
    effort, position = record()[:, 0], record()[:, 2]
    b_0, b_1, a_1 = ASKED.weight
    for axis, bound in enumerate(ASKED.effort_bound):
        for i in range(3):
            weighted = np.zeros(2)
            lag = np.zeros(2)
            for e, u in zip(errors[i, :, axis], effort[:, axis], strict=True):
                x = np.array([e, u])
                through = b_0 * x + lag
                lag = b_1 * x - a_1 * through
                weighted += TICK * through**2 * np.array([1.0, (ASKED.error_bound / bound) ** 2])
            asked = TICK * np.sum((errors[i, :, axis] + position[:, axis]) ** 2)
            np.testing.assert_allclose(found[axis, i], weighted - asked, rtol=1e-9)


@pytest.mark.parametrize("chosen", [1, 2])
def test_who_takes_over_has_the_integral_that_the_law_would_have(chosen: int) -> None:
    memory, _, _, inverses = heard()
    after = BANK.taken_over(memory, np.tile(THETA, (2, 1)), np.full(2, chosen), np.array([True, False]))
    np.testing.assert_allclose(after.total, [inverses[chosen].total[0], 0.0], rtol=1e-9)
    assert after.chosen.tolist() == [chosen, 0]


def flown(integrals: tuple[float, ...], ticks: int, chosen: int, push: float = 0.0) -> tuple:
    """A rigid body, inertia 2, that follows a sine under a steady torque; memory and errors."""
    controller = UnfalsifiedController(2.0, 1.0, TICK, 1e-4, frequency=0.2, damping=1.0, integrals=integrals, frozen=True, gate=5.0)
    memory, y, v, errors = controller.start((1,)), np.zeros(1), np.zeros(1), []
    memory = memory._replace(databank=memory.databank._replace(chosen=np.array([chosen])))
    for k in range(ticks):
        wanted = np.array([0.05 * np.sin(0.05 * TICK * k)])
        torque, memory, _ = controller.step(memory, wanted, y, v)
        errors.append(wanted[0] - y[0])
        acceleration = (torque + push) / 2.0
        y, v = y + TICK * v + 0.5 * TICK**2 * acceleration, v + TICK * acceleration
    return controller, memory, np.array(errors)


def test_integral_action_bears_a_steady_torque() -> None:
    left = {chosen: np.mean(flown((0.05,), 2515, chosen, push=4e-3)[2][-1257:]) for chosen in (0, 1)}  # of one period
    assert left[0] == pytest.approx(-4e-3 / (2.0 * 0.2**2), rel=0.02)  # torque over C_p
    assert abs(left[1]) < 0.05 * abs(left[0])


def test_a_law_of_the_databank_in_the_loop_finds_its_own_error() -> None:
    controller, memory, errors = flown((0.05,), 400, 1)
    own = np.sum(memory.theta[0] * memory.databank.washed[0, 0])
    assert own == pytest.approx(errors[-1], abs=1e-9)
    np.testing.assert_allclose(controller.integral(memory), 0.05)


class Told:
    """In place of the search: what it finds without integral action, with the first and with the second."""

    def __init__(self, *found: tuple[float, float, bool] | None) -> None:
        self.found = [None if one is None else Choice(np.array(one[:2]), one[2]) for one in found]

    def nearest(self, *_: object) -> Choice | None:
        self.found.append(self.found.pop(0))
        return self.found[-1]


@pytest.mark.parametrize(
    ("found", "taken"),
    [
        ((None, (20.0, 8.0, False), None), (20.0, 8.0, 0.02)),  # the only one
        (((20.0, 8.0, False), (20.0, 8.0, False), (20.0, 8.0, False)), (20.0, 8.0, 0.0)),  # among equals the present one
        (((9.0, 5.0, False), (20.0, 8.0, False), (24.0, 9.9, False)), (24.0, 9.9, 0.05)),  # the nearest to (25, 10)
        (((24.0, 9.9, True), (20.0, 8.0, False), None), (20.0, 8.0, 0.02)),  # rather than one of the grid
        (((20.0, 8.0, False), None, (24.9, 1.0, False)), (20.0, 8.0, 0.0)),  # by Routh the nearer one is unstable: 1.0 < 0.05 * 24.9
        ((None, None, None), (25.0, 10.0, 0.0)),
    ],
)
def test_the_nearest_candidate_of_all_integral_actions_takes_over(found: tuple, taken: tuple) -> None:
    controller = UnfalsifiedController(
        2.0, 1.0, TICK, 1e-4, frequency=0.2, damping=1.0, integrals=(0.02, 0.05), gate=0.0, search=cast("CandidateSearch", Told(*found))
    )
    memory, switched = controller.start((1,)), False
    for k in range(1, 51):  # a body that flees: everything is falsified when the first tests are due
        _, memory, events = controller.step(memory, np.zeros(1), np.array([0.01 * k]), np.array([0.1]))
        switched |= bool(events.switched[0])
    np.testing.assert_allclose([*memory.theta[0], controller.integral(memory)[0]], taken)
    assert switched == any(found)


def test_a_trial_is_the_same_alone_and_in_a_batch() -> None:
    controller = UnfalsifiedController(2.0, 1.0, TICK, 1e-4, frequency=0.2, integrals=(0.02, 0.05), gate=5.0)
    random = np.random.default_rng(9)
    wanted = 0.05 * np.cumsum(random.normal(size=(200, 3)), axis=0) * TICK
    together, alone = controller.start((3,)), controller.start((1,))
    for k in range(200):
        y = 0.7 * wanted[max(0, k - 9)]
        v = 0.7 * (wanted[max(0, k - 9)] - wanted[max(0, k - 10)]) / TICK
        first, together, _ = controller.step(together, wanted[k], y, v)
        second, alone, _ = controller.step(alone, wanted[k, 1:2], y[1:2], v[1:2])
        np.testing.assert_array_equal(first[1:2], second)


def test_settings_say_which_candidates_there_are() -> None:
    scenario = load("nacs/unfalsified", {"loops.adaptive.control.candidates": "pid"})
    for name, rates in (("adaptive", (0.01, 0.02, 0.05)), ("nominal", ())):
        settings = scenario.loops[name].control
        assert isinstance(settings, UnfalsifiedSettings)
        assert settings.controller(assembly_of(scenario), 0.1).channels.integrals == rates
