"""Linear models against closed forms, margins against those of loops that can be worked out by hand and against flights."""

from __future__ import annotations

import runpy
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy import linalg, signal
from scipy.io import loadmat

import nacs
from control.allocation import PseudoInverseAllocation
from control.feed_forward import BodyModel
from control.output_feedback import OutputFeedback
from control.proportional_derivative import ProportionalDerivative
from control.sliding_mode import SlidingMode
from sim.linear.delays import late_readings
from sim.linear.flown_loop import SMOOTH_PLANT, SMOOTH_SENSORS
from sim.linear.law_gain import Switches, allocation_gain, law_gain
from sim.linear.linear_model import LinearModel, Quantities
from sim.linear.margins import SampledLoop
from sim.loop.build import build
from sim.loop.closed_loop import Flight

GRAVITY, MASS, ARM, WHEEL = 9.80665, 3.2, 2e-3, 1.740138e-5  # m/s2, kg, m, kg m2
MOMENTS = np.array([0.02, 0.018, 0.03])  # kg m2
SMOOTH = {"plant.wheel_viscous_nms": 0.0, "plant.bearing_viscous_nms": 0.0, "reference": {"type": "hold"}}
QUIET = {
    "sensors": {"set": "ideal"},
    "reference": {"type": "hold"},
    "start.attitude_error_deg": 0.01,
    "run.ticks": 110,
    **{f"plant.{key}": 0 for key in ("air_torque_nm", "drive_torque_noise_nm", "command_bits", "wheel_coulomb_nm")},
}


def heavy(below_m: float) -> dict[str, Any]:
    return SMOOTH | {"plant.centre_of_mass_um": [0.0, 0.0, 1e6 * below_m], "plant.inertia_kg_m2": [*MOMENTS, 0.0, 0.0, 0.0]}


def nearest(values: NDArray[Any], wanted: complex) -> complex:
    return complex(values[np.argmin(np.abs(values - wanted))])


# ---- poles against closed forms


@pytest.mark.parametrize("way", ["differences", "mujoco"])
@pytest.mark.parametrize(("below", "turn"), [(ARM, 1j), (-ARM, 1.0)], ids=["hangs", "stands"])
def test_a_table_that_is_out_of_balance_is_a_pendulum(way, below: float, turn: complex) -> None:
    """+-sqrt(m g l / J), of a body in which wheels without friction do not turn with it about their axes: J - sum of a^2 J_w."""
    poles = nacs.linearize("nacs/fault-free", set=heavy(below), way=way).poles
    axes = nacs.load("nacs/fault-free").plant.wheel_axes
    for axis in (0, 1):
        free = MOMENTS[axis] - WHEEL * np.sum(axes[axis] ** 2)
        wanted = turn * np.sqrt(MASS * GRAVITY * ARM / free)
        for sign in (1.0, -1.0):
            assert abs(nearest(poles, sign * wanted) / (sign * wanted) - 1.0) < 1e-3


def test_wheels_slow_down_as_their_friction_says() -> None:
    """Alike about the pyramid's axes they push nothing: -b / J_w. The others push the body too, of J: -b (1/J_w + a^2 / J)."""
    viscous = 5e-5
    changes = heavy(0.0) | {"plant.wheel_viscous_nms": viscous, "plant.gravity_m_s2": 0.0}
    model = nacs.linearize("nacs/fault-free", set=changes)
    axes = nacs.load("nacs/fault-free").plant.wheel_axes
    free = np.diag(MOMENTS) - WHEEL * axes @ axes.T
    wanted = -viscous * np.linalg.eigvalsh(np.eye(4) / WHEEL + axes.T @ np.linalg.solve(free, axes))
    assert wanted.max() == pytest.approx(-viscous / WHEEL, rel=1e-9)
    for one in wanted:
        assert abs(nearest(model.poles, one) / one - 1.0) < 1e-3


@pytest.mark.parametrize("way", ["differences", "mujoco"])
def test_a_flexible_spacecraft_has_its_mode_and_its_zero(way) -> None:
    """Likins' hybrid coordinates: pole at the free frequency, zero at the one with the hub held."""
    model = nacs.linearize("antenna-mapping/panelsat", way=way)
    channel = nacs.load("antenna-mapping/panelsat").plant.linear_channel(0)
    assert abs(nearest(model.poles, 1j * channel.free_frequency) / (1j * channel.free_frequency) - 1.0) < 1e-3
    zeros = model.zeros("theta1", "torque1")
    assert abs(nearest(zeros, 1j * channel.held_frequency) / (1j * channel.held_frequency) - 1.0) < 1e-3
    assert np.abs(zeros).max() < 1e3


def test_a_torque_from_outside_turns_the_free_inertia_and_a_motor_its_wheel() -> None:
    model = nacs.linearize("nacs/fault-free", set=heavy(0.0))
    axes = nacs.load("nacs/fault-free").plant.wheel_axes
    free = np.diag(MOMENTS) - WHEEL * axes @ axes.T
    body = [model.state.names.index(f"omega{i}") for i in (1, 2, 3)]
    wheels = [model.state.names.index(f"wheel{i}") for i in (1, 2, 3, 4)]
    outside = [model.input.names.index(f"torque{i}") for i in (1, 2, 3)]
    np.testing.assert_allclose(model.B[np.ix_(body, outside)], np.linalg.inv(free), rtol=1e-4, atol=1e-3)
    np.testing.assert_allclose(model.B[np.ix_(body, [0, 1, 2, 3])], -np.linalg.solve(free, axes), rtol=1e-4, atol=1e-3)
    turned = np.eye(4) / WHEEL + axes.T @ np.linalg.solve(free, axes)
    np.testing.assert_allclose(model.B[np.ix_(wheels, [0, 1, 2, 3])], turned, rtol=1e-3)
    assert model.state.units[wheels[0]] == "rad/s"
    assert model.state.units[model.state.names.index("balance_z")] == "m"
    assert model.state.units[model.state.names.index("balance_z_rate")] == "m/s"
    assert set(model.input.units) == {"N m"}


def test_a_spinning_wheel_couples_the_axes_as_a_gyroscope() -> None:
    """J domega/dt = -omega x W J_w Omega about rest."""
    speeds = np.array([300.0, -100.0, 50.0, 200.0])
    model = nacs.linearize("nacs/fault-free", set=heavy(0.0) | {"start.wheel_speed_rad_s": speeds.tolist(), "plant.gravity_m_s2": 0.0})
    axes = nacs.load("nacs/fault-free").plant.wheel_axes
    free, momentum = np.diag(MOMENTS) - WHEEL * axes @ axes.T, WHEEL * axes @ speeds
    body = [model.state.names.index(f"omega{i}") for i in (1, 2, 3)]
    turning = np.cross(np.eye(3), momentum).T  # columns e_i x h
    np.testing.assert_allclose(model.A[np.ix_(body, body)], -np.linalg.solve(free, turning), rtol=1e-3, atol=1e-5)
    np.testing.assert_array_equal(model.point[7:], speeds)


def test_both_ways_give_the_same_model() -> None:
    one, other = (nacs.linearize("nacs/fault-free", set=heavy(ARM), way=way) for way in ("differences", "mujoco"))
    assert one.state == other.state
    slow = [i for i, name in enumerate(one.state.names) if not name.startswith("balance")]  # those of the masses are fast
    scale = np.abs(one.A[np.ix_(slow, slow)]).max()
    np.testing.assert_allclose(one.A[np.ix_(slow, slow)], other.A[np.ix_(slow, slow)], rtol=1e-3, atol=1e-3 * scale)
    np.testing.assert_allclose(one.B[slow], other.B[slow], rtol=1e-3, atol=1e-2)  # of 50 to 57 000 rad/s2 a N m; implicitfast: half a step


def test_an_imbalance_makes_the_angle_of_a_wheel_a_state() -> None:
    shaken = {"plant.wheel_imbalance_um": 1000.0, "plant.step_s": 5e-4, "reference": {"type": "hold"}}
    assert "angle1" in nacs.linearize("nacs/fault-free", set=shaken).state.names
    assert "angle1" not in nacs.linearize("nacs/fault-free").state.names


# ---- sampled, and delayed


def test_sampled_is_the_continuous_one_under_torques_that_are_held() -> None:
    continuous = nacs.linearize("nacs/fault-free", set=heavy(ARM))
    sampled = nacs.linearize("nacs/fault-free", set=heavy(ARM), sampled=True)
    assert sampled.dt == pytest.approx(0.1)
    a, b, *_ = signal.cont2discrete((continuous.A, continuous.B, continuous.C, continuous.D), 0.1, method="zoh")
    slow = [i for i, name in enumerate(sampled.state.names) if not name.startswith("balance")]
    np.testing.assert_allclose(sampled.A[np.ix_(slow, slow)], a[np.ix_(slow, slow)], rtol=1e-4, atol=1e-4)
    np.testing.assert_allclose(sampled.B[slow], b[slow], rtol=1e-3, atol=1e-3)


def test_a_tick_of_the_twin_is_a_step_of_the_model() -> None:
    """Near the operating point: what the sampled model says of a tick under a torque is what the twin does in it."""
    changes = QUIET | {
        "observers": {},
        "control.feedback": "truth",
        "start.attitude_error_deg": 0.05,
        "start.rate_deg_s": [0.02, -0.01, 0.03],
    }
    model = nacs.linearize("nacs/fault-free", set=changes, sampled=True)
    twin = nacs.Twin("nacs/fault-free", trials=1, seed=3, set=changes)
    axes = twin.scenario.plant.wheel_axes
    torque = np.array([1e-3, -2e-3, 5e-4])
    before = twin.truth[0]
    twin.step(torque)
    twin.step(torque)  # the balance masses have sunk by then
    middle = twin.truth[0]
    twin.step(torque)
    after = twin.truth[0]

    def error(state: NDArray[Any]) -> NDArray[Any]:
        return np.concatenate([2.0 * state[:3], state[4:]])  # small rotations

    places = [model.state.names.index(name) for name in model.output.names]
    motors = -np.linalg.pinv(axes) @ torque
    said = (model.A[np.ix_(places, places)] @ error(middle)) + model.B[places][:, :4] @ motors + model.drift[places]
    moved = np.abs(error(after) - error(middle))
    assert not np.allclose(before, middle)
    np.testing.assert_array_less(np.abs(said - error(after)), 2e-3 * moved + 1e-8)


def test_late_readings_of_a_sampled_model_lie_between_two_samples() -> None:
    prompt = nacs.linearize("nacs/fault-free", sampled=True)
    late = nacs.linearize("nacs/fault-free", set={"sensors.latency_s": 0.13}, sampled=True)
    pulsation = np.array([0.1, 1.0, 10.0])
    back = np.exp(-1j * pulsation * 0.1)[:, None, None]
    np.testing.assert_allclose(late.response(pulsation), prompt.response(pulsation) * (0.7 * back + 0.3 * back**2), rtol=1e-9)
    whole = late_readings(prompt, 0.2)
    np.testing.assert_allclose(whole.response(pulsation), prompt.response(pulsation) * back**2, rtol=1e-9)
    assert len(whole.A) == len(prompt.A) + 2 * len(prompt.C)
    assert np.isneginf(whole.rates[: 2 * len(prompt.C)].real).all()


def test_late_readings_of_a_continuous_model_are_those_of_pade() -> None:
    prompt = nacs.linearize("nacs/fault-free")
    late = nacs.linearize("nacs/fault-free", set={"sensors.latency_s": 0.2, "sensors.jitter_s": 0.2})  # 0.3 s on the average
    pulsation = np.array([0.3, 1.0, 3.3])
    delay = np.exp(-0.3j * pulsation)[:, None, None]
    np.testing.assert_allclose(late.response(pulsation), prompt.response(pulsation) * delay, rtol=2e-4)
    assert late.poles.real.max() < 1e-3


# ---- the model as others take it


def test_scipy_takes_it() -> None:
    for model in (nacs.linearize("nacs/fault-free"), nacs.linearize("nacs/fault-free", sampled=True)):
        system = model.state_space()
        assert isinstance(system, signal.StateSpace)
        assert system.dt == model.dt
        np.testing.assert_allclose(np.sort_complex(linalg.eigvals(system.A)), np.sort_complex(model.poles))


def test_the_frequency_response_is_scipys() -> None:
    one = Quantities(("x", "v"), ("m", "m/s")), Quantities(("f",), ("N",)), Quantities(("x",), ("m",))
    matrices = np.array([[0.0, 1.0], [-4.0, -0.4]]), np.array([[0.0], [1.0]]), np.array([[1.0, 0.5]]), np.array([[0.1]])
    pulsation = np.array([0.5, 2.0, 7.0])
    model = LinearModel(*matrices, *one, None, np.zeros(2), np.zeros(7))
    _, wanted = signal.freqresp(signal.StateSpace(*matrices), pulsation)
    np.testing.assert_allclose(model.response(pulsation)[:, 0, 0], wanted, rtol=1e-9)
    np.testing.assert_allclose(np.sort_complex(model.zeros("x", "f")), np.sort_complex(model.state_space().zeros), rtol=1e-9)
    sampled = LinearModel(linalg.expm(0.2 * matrices[0]), *matrices[1:], *one, 0.2, np.zeros(2), np.zeros(7))
    _, wanted = signal.dfreqresp(sampled.state_space(), 0.2 * pulsation)
    np.testing.assert_allclose(sampled.response(pulsation)[:, 0, 0], wanted, rtol=1e-9)
    np.testing.assert_allclose(np.sort_complex(sampled.rates), np.sort_complex(model.poles), rtol=1e-9)


def test_a_file_holds_what_python_has(nacs_command, tmp_path: Path) -> None:
    model = nacs.linearize("nacs/fault-free", sampled=True)
    for suffix in ("npz", "mat"):
        ended = nacs_command("linearize", "nacs/fault-free", "--sampled", "--out", tmp_path / f"it.{suffix}")
        assert ended.code == 0, ended.err
        assert "16 states" in ended.out
        read = loadmat(tmp_path / "it.mat") if suffix == "mat" else np.load(tmp_path / "it.npz")
        for name in ("A", "B", "C", "D"):
            np.testing.assert_array_equal(read[name], getattr(model, name))
        assert float(np.squeeze(read["dt"])) == 0.1
        names = [str(np.squeeze(one)) for one in np.ravel(read["output_names"])]
        assert tuple(names) == model.output.names


def test_about_where_a_flight_is() -> None:
    """The point is the first trial's truth after so many seconds; what moves there drifts."""
    model = nacs.linearize("nacs/fault-free", at=0.5, set={"run.ticks": 8})
    twin = nacs.Twin("nacs/fault-free", trials=1, set={"run.ticks": 8})
    while twin.tick < 5:
        twin.step()
    np.testing.assert_array_equal(model.point, twin.truth[0])
    places = [model.state.names.index(f"theta{i}") for i in (1, 2, 3)]
    np.testing.assert_allclose(model.drift[places], model.point[4:7], rtol=1e-5)


# ---- laws


def body() -> BodyModel:
    return BodyModel(np.diag([0.02, 0.03, 0.04]), 1e-5 * np.eye(3))


REST = np.array([0.0, 0.0, 0.0, 1.0, *np.zeros(6)])


def test_the_slope_of_a_pd_law_is_half_its_gain_of_the_angle() -> None:
    law = ProportionalDerivative((0.4, 0.6), (0.07, 0.1), body())
    for modes, proportional, derivative in ((None, 0.4, 0.07), (np.array([0.0, 1.0]), 0.6, 0.1), (np.array([0.5, 0.5]), 0.5, 0.085)):
        wanted = -np.hstack([proportional / 2.0 * np.eye(3), derivative * np.eye(3), np.zeros((3, 3))])
        np.testing.assert_allclose(law_gain(law, REST, modes), wanted, rtol=1e-6, atol=1e-9)


def test_the_slope_of_a_sliding_mode_is_that_of_its_boundary_layer() -> None:
    """At rest: -J [K / phi (omega + lambda theta / 2) + lambda omega / 2]."""
    model = body()
    law = SlidingMode(6.0, 0.3, model, 0.1)
    wanted = -np.hstack([model.inertia * 0.3 / 0.1 * 6.0 / 2.0, model.inertia * (0.3 / 0.1 + 6.0 / 2.0), np.zeros((3, 3))])
    np.testing.assert_allclose(law_gain(law, REST), wanted, rtol=1e-5, atol=1e-8)


def test_a_law_that_switches_has_no_slope() -> None:
    with pytest.raises(Switches):
        law_gain(SlidingMode(6.0, 0.3, body()), REST)
    with pytest.raises(Switches):
        law_gain(OutputFeedback(body(), power=0.7), REST)
    assert law_gain(OutputFeedback(body()), REST).shape == (3, 9)


def test_the_slope_of_an_allocation_is_its_matrix() -> None:
    axes = nacs.load("nacs/fault-free").plant.wheel_axes
    np.testing.assert_allclose(allocation_gain(PseudoInverseAllocation(axes, 0.03), 4), -np.linalg.pinv(axes), rtol=1e-6, atol=1e-9)


# ---- margins


def integrators(gains: NDArray[Any]) -> SampledLoop:
    """Three axes, each x_next = x + k u, u = -x, sampled every 0.1 s."""
    three = Quantities(("1", "2", "3"), ("", "", ""))
    plant = LinearModel(np.eye(3), np.diag(gains), np.eye(3), np.zeros((3, 3)), three, three, three, 0.1, np.zeros(3), np.zeros(7))
    return SampledLoop(plant, np.eye(3))


def test_margins_of_sampled_integrators_by_hand() -> None:
    """L = k / (z - 1): unstable at k = 2; |L| = 1 where 2 sin(w T / 2) = k, with phase -(90 deg + w T / 2); S - 1/2 greatest at -1."""
    gains = np.array([0.2, 0.5, 1.0])
    *axes, every = integrators(gains).margins()
    for one, k in zip(axes, gains, strict=True):
        half = np.arcsin(k / 2.0)
        lag, pulsation = np.pi / 2.0 - half, 20.0 * half
        assert one.stable
        assert one.gain_up == pytest.approx(2.0 / k, rel=1e-6)
        assert one.gain_down == 0.0
        assert one.phase_deg == pytest.approx(np.degrees(lag), rel=1e-6)
        assert one.crossover_rad_s == pytest.approx(pulsation, rel=1e-6)
        assert one.delay_s == pytest.approx(lag / pulsation, rel=1e-6)
        assert one.disk == pytest.approx(2.0 * (2.0 - k) / (2.0 + k), rel=1e-4)
    assert every.gain_up == pytest.approx(2.0, rel=1e-6)
    assert every.phase_deg == pytest.approx(60.0, rel=1e-6)
    assert every.disk == pytest.approx(axes[2].disk, rel=1e-4)


def test_a_loop_that_is_unstable_has_no_margins() -> None:
    for one in integrators(np.array([0.2, 0.5, 2.5])).margins():
        assert not one.stable
        assert np.isnan(one[2:]).all()


def test_a_plant_that_falls_needs_gain() -> None:
    """x_next = 1.1 x + 0.5 u: stable for gains between 0.1 / 0.5 and 2.1 / 0.5."""
    plant = integrators(np.full(3, 0.5)).plant
    falling = LinearModel(1.1 * np.eye(3), *(getattr(plant, name) for name in LinearModel.__dataclass_fields__ if name != "A"))
    for one in SampledLoop(falling, np.eye(3)).margins():
        assert one.gain_down == pytest.approx(0.2, rel=1e-3)
        assert one.gain_up == pytest.approx(4.2, rel=1e-6)


LOOPS = [
    ("nacs/fault-free", None),
    ("nacs/imm-wheel-failure", "smc-nis"),
    ("nacs/imm-wheel-failure", "pd-imm"),
    ("nacs/unfalsified", "nominal"),
]


@pytest.mark.parametrize(("scenario", "loop"), LOOPS, ids=["pd", "sliding mode", "blended pd", "unfalsified"])
def test_a_flight_is_stable_below_the_gain_margin_and_unstable_above(scenario: str, loop: str | None) -> None:
    """All torques that the law asks for are raised to 0.95 and 1.05 of the margin; rates die out, and grow."""
    place = "control" if loop is None else f"loops.{loop}.control"
    told = nacs.load(scenario).singles()[loop or "loop"].law
    changes = QUIET | {"faults": [], f"{place}.feedback": "truth"} | ({"observers": {}} if loop is None else {})
    if told.type == "pd" and isinstance(told.proportional_nm, tuple):  # nobody says the mode: the healthy one's
        changes |= {f"{place}.proportional_nm": told.proportional_nm[0], f"{place}.derivative_nms": told.derivative_nms[0]}
    [case] = nacs.margins(scenario, loop=loop, set=changes)
    margin = case.margins[-1].gain_up
    growth = []
    for share in (0.95, 1.05):
        twin = nacs.Twin(scenario, trials=1, seed=1, set=changes, loop=loop)
        rates = []
        while not twin.over:
            rates.append(np.abs(twin.truth[0, 4:7]).max())
            twin.step(share * margin * twin.torque)
        growth.append(max(rates[95:]) / max(rates[15:30]))
    assert growth[0] < 0.2
    assert growth[1] > 5.0


def test_a_wheel_that_has_failed_and_a_law_that_knows_it() -> None:
    found = {(case.believed, case.mode): case for case in nacs.margins("nacs/imm-wheel-failure", loop="pd-imm")}
    assert set(found) == {(0, 0), (1, 1), (0, 1), (1, 0)}
    healthy, alarmed = (found[key].margins[-1].gain_up for key in ((0, 0), (1, 0)))
    assert alarmed == pytest.approx(healthy * 0.075 / 0.1, rel=0.02)  # limited by K_d
    shared = {(case.believed, case.mode): case for case in nacs.margins("nacs/imm-wheel-failure", loop="pd-imm-realloc")}
    assert len(shared) == 13
    assert shared[2, 2].margins[-1].gain_up == pytest.approx(healthy, rel=1e-2)  # three wheels do what four did


# ---- loops as they are flown


def test_a_loop_that_is_flown_with_the_true_state_has_the_margins_of_its_model() -> None:
    changes = {"observers": {}, "control.feedback": "truth", "start.attitude_error_deg": 0.01, "reference": {"type": "hold"}}
    [[model], [flight]] = (nacs.margins("nacs/fault-free", set=changes, flown=flown) for flown in (False, True))
    assert flight.told == "truth"
    for one, other in zip(model.margins, flight.margins, strict=True):
        np.testing.assert_allclose(one[2:], other[2:], rtol=2e-3, err_msg=one.axis)


class Stronger:
    """Drives that do more than they are told, and no filter knows it."""

    def __init__(self, faults: Any, factor: float) -> None:
        self.faults, self.factor = faults, factor

    def given(self, tick: int, told: NDArray[Any]) -> NDArray[Any]:
        return self.factor * self.faults.given(tick, told)

    def __getattr__(self, name: str) -> Any:
        return getattr(self.faults, name)


def test_a_filter_in_the_loop_has_the_margin_that_its_flight_says() -> None:
    """Drives with 0.93 and 1.07 of the margin: what a pulse makes of one of two trials that are else the same dies out, and grows."""
    smooth = {f"sensors.{key}": value for key, value in SMOOTH_SENSORS.items()} | {f"plant.{key}": 0 for key in SMOOTH_PLANT}
    changes = smooth | {"observers": {"ekf": {"type": "ekf"}}, "control.feedback": "ekf", "run.ticks": 160}
    changes |= {"reference": {"type": "hold"}, "start.attitude_error_deg": 0.0}  # one degree brings the drives to their limit
    [case] = nacs.margins("nacs/fault-free", set=changes, flown=True)
    margin, _ = case.sampled.gains([0, 1, 2])
    told_the_state, _ = nacs.margins("nacs/fault-free", set=changes)[0].sampled.gains([0, 1, 2])
    assert margin > 2.0 * told_the_state
    growth = []
    for share in (0.93, 1.07):
        system = build(nacs.load("nacs/fault-free", set=changes), np.zeros(2, dtype=np.int64))
        noise = system.effectors.drive_noise.copy()
        noise[40, 1] += 1e-6
        stronger = Stronger(system.effectors.faults, share * margin)
        effectors = replace(system.effectors, drive_noise=noise, faults=stronger)
        rates = np.array([sensed.truth.omega_BN_B for sensed in Flight(replace(system, effectors=effectors))])
        apart = np.abs(rates[:, 1] - rates[:, 0]).max(axis=-1)
        growth.append(apart[-10:].max() / apart[41:46].max())
    assert growth[0] < 0.01
    assert growth[1] > 10.0


def test_margins_at_the_terminal(nacs_command, monkeypatch: pytest.MonkeyPatch) -> None:
    """In eighty columns nothing is cut off; what would be alike in all rows is not shown."""
    monkeypatch.setenv("COLUMNS", "80")
    ended = nacs_command("linearize", "nacs/imm-wheel-failure", "--loop", "pd-imm", "--margins")
    assert ended.code == 0
    assert "\u2026" not in ended.out
    *_, last = ended.out.splitlines()
    assert last.split() == ["pd-imm", "mode", "2", "healthy", "<", "3.42", "<", "3.35", "43.3", "133", "0.769", "0.767"]
    plain = nacs_command("linearize", "nacs/fault-free", "--margins").out.splitlines()
    assert plain[-2].split() == ["loop", "gain", "all", "deg", "ms", "disk", "all"]


# ---- what cannot be


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (("formation/fault-free",), "scenarios of family formation have several bodies; linear models are of one"),
        (("consensus/fault-free", "--margins"), "scenarios of family consensus have several bodies; linear models are of one"),
        (("nacs/fault-free", "--loop", "x"), "loop x: no such loop; there are loop"),
        (("nacs/fault-free", "--at", "100"), "at 100 s: the run lasts from 0 to 99.9 s"),
        (("nacs/fault-free", "--at", "nan"), "at nan s: the run lasts from 0 to 99.9 s"),
        (("nacs/fault-free", "--way", "x"), "way x: must be one of differences, mujoco"),
        (("nacs/fault-free", "--way", "mujoco", "--sampled"), "way mujoco: MuJoCo's derivatives are of a step"),
        (("nacs/fault-free", "--out", "it.csv"), "--out it.csv: must end in .npz or .mat"),
        (("nacs/fault-free", "--at", "1", "--flown"), "at 1 s: loops are flown from their start; leave it out, or `flown`"),
        (("wmap/smc-ukf", "--margins"), "loop smc-ukf: its law switches at rest and has no slope; a boundary layer"),
    ],
    ids=lambda value: value if isinstance(value, str) else "",
)
def test_what_cannot_be_is_one_line(nacs_command, arguments, said: str) -> None:
    ended = nacs_command("linearize", *arguments)
    assert ended.code == 2
    assert len(ended.err.splitlines()) == 1
    assert said in ended.err
    assert list(Path().iterdir()) == []


def test_a_file_that_is_there_stays(nacs_command) -> None:
    Path("it.npz").write_text("mine")
    ended = nacs_command("linearize", "nacs/fault-free", "--out", "it.npz")
    assert ended.code == 2
    assert "is there already" in ended.err
    assert Path("it.npz").read_text() == "mine"


def test_python_is_told_the_same() -> None:
    with pytest.raises(nacs.NacsError, match="no such loop"):
        nacs.linearize("nacs/fault-free", loop="x")
    with pytest.raises(nacs.NacsError, match="have several bodies"):
        nacs.margins("formation/fault-free")
    with pytest.raises(ValueError, match="output 'x': there is none; there are theta1, theta2"):
        nacs.linearize("nacs/fault-free").zeros("x", "motor1")


# ---- the page and its example

DOCS = Path(__file__).parents[1] / "docs"


def test_the_page_is_what_its_script_prints() -> None:
    """All of its text, and three loops of its table flown anew."""
    script, written = runpy.run_path(str(DOCS / "linear.py")), (DOCS / "linear.md").read_text(encoding="utf-8")
    table = [line for line in written.splitlines() if line.startswith("| `") and line.count("|") > 8]
    anew = "print it anew: python docs/linear.py > docs/linear.md"
    assert written == script["page"](table), anew
    assert len(table) == sum(len(shown.situations) for shown in script["SHOWN"])
    for shown in (*script["SHOWN"][:2], script["SHOWN"][-6]):
        assert set(script["rows"](shown)) <= set(table), anew


def test_a_regulator_that_is_designed_on_the_model_settles_the_twin() -> None:
    example = runpy.run_path(str(DOCS / "examples" / "lqr.py"))
    model = nacs.linearize("nacs/fault-free", set=example["AT_REST"], sampled=True)
    gain = example["design"](model)
    angles = example["fly"](gain, seconds=4.0)
    assert angles[0].max() > 2.0
    assert angles[-1].max() < 0.1 * angles[0].max()
