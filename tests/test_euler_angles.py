"""3-1-3 Euler angles, and the reference of steady precession and spin that is made of them."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from pydantic import TypeAdapter, ValidationError

from models.attitude.euler_angles import from_euler_313, to_euler_313, wrapped_difference
from models.attitude.quaternion import angle, attitude_matrix, inverse, multiply, normalize, to_rotation_vector
from sim.scenario.references import EulerRates, ReferenceSettings

SCAN = EulerRates(type="euler-rates", nutation_deg=22.5, precession_rev_h=1.0, spin_rpm=0.464)
FAST = EulerRates(type="euler-rates", nutation_deg=70.0, precession_rev_h=-90.0, spin_rpm=5.0, start_deg=(40.0, -100.0))

turns = st.floats(-3.1, 3.1)
angles_313 = st.tuples(turns, st.floats(0.01, 3.13), turns).map(np.array)


def about_1(t: float) -> np.ndarray:
    return np.array([[1.0, 0.0, 0.0], [0.0, np.cos(t), np.sin(t)], [0.0, -np.sin(t), np.cos(t)]])


def about_3(t: float) -> np.ndarray:
    return np.array([[np.cos(t), np.sin(t), 0.0], [-np.sin(t), np.cos(t), 0.0], [0.0, 0.0, 1.0]])


@given(angles_313)
def test_the_attitude_is_three_turns_of_the_frame(angles):
    phi, theta, psi = angles
    np.testing.assert_allclose(attitude_matrix(from_euler_313(angles)), about_3(psi) @ about_1(theta) @ about_3(phi), atol=1e-14)


def test_an_attitude_that_is_missing_has_no_angles_and_costs_no_other():
    attitudes = from_euler_313(np.array([[0.3, 0.4, 0.5], [1.0, 1.1, 1.2], [-2.0, 0.7, 0.1]]))
    attitudes[1, 2] = np.nan
    np.testing.assert_allclose(to_euler_313(attitudes)[[0, 2]], [[0.3, 0.4, 0.5], [-2.0, 0.7, 0.1]], atol=1e-12)
    assert np.isnan(to_euler_313(attitudes)[1]).all()
    assert np.isnan(to_euler_313(np.full((2, 3, 4), np.nan))).all()


@given(angles_313)
def test_there_and_back(angles):
    np.testing.assert_allclose(to_euler_313(from_euler_313(angles)), angles, atol=1e-12)  # rounding over sin(theta)
    np.testing.assert_allclose(to_euler_313(-from_euler_313(angles)), angles, atol=1e-12)


@pytest.mark.parametrize("theta", [0.0, np.pi])
def test_at_the_singularities_the_attitude_is_right_and_nobody_is_warned(theta):
    q = from_euler_313(np.array([0.7, theta, 0.4]))
    found = to_euler_313(q)
    assert found[1:] == pytest.approx([theta, 0.0], abs=1e-7)
    assert angle(from_euler_313(found), q) < 1e-7


@given(arrays(float, 5, elements=st.floats(-1e3, 1e3)), arrays(float, 5, elements=st.floats(-1e3, 1e3)))
def test_a_wrapped_difference_is_the_difference_but_for_whole_turns(left, right):
    difference = wrapped_difference(left, right)
    assert (np.abs(difference) <= np.pi).all()
    turned = (left - right - difference) / (2 * np.pi)
    np.testing.assert_allclose(turned, np.round(turned), atol=1e-12)


def test_any_leading_axes_pass_through_and_a_row_has_the_same_bits_in_any_batch():
    rng = np.random.default_rng(4)
    q, angles = normalize(rng.standard_normal((1000, 4))), rng.uniform(0.1, 3.0, (1000, 3))
    for function, rows in ((to_euler_313, q), (from_euler_313, angles)):
        everyone = function(rows)
        for size in (1, 3, 10, 64):
            np.testing.assert_array_equal(function(rows[9 : 9 + size]), everyone[9 : 9 + size])
        np.testing.assert_array_equal(function(rows[5]), everyone[5])
        np.testing.assert_array_equal(function(rows.reshape(10, 20, 5, -1)).reshape(1000, -1), everyone)


# the reference -----------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("reference", [SCAN, FAST])
def test_rates_and_accelerations_of_a_scan_are_its_derivatives(reference):
    time, h = np.linspace(0.0, 60.0, 601), 1e-3
    now, ahead, behind = (reference.at(time + t) for t in (0.0, h, -h))
    np.testing.assert_allclose(np.linalg.norm(now.q_DN, axis=-1), 1.0, rtol=1e-14)
    rate = to_rotation_vector(multiply(ahead.q_DN, inverse(behind.q_DN))) / (2 * h)
    np.testing.assert_allclose(now.omega_DN_D, rate, atol=3e-8)  # h^2 / 6 of rate 0.52 times acceleration 0.08
    np.testing.assert_allclose(now.alpha_DN_D, (ahead.omega_DN_D - behind.omega_DN_D) / (2 * h), atol=1e-8)
    assert np.abs(now.alpha_DN_D).max() > 3e-5  # something was tested: 1.7e-3 rad/s about a side axis, turned at 0.049 rad/s


def test_a_scan_has_the_angles_that_its_settings_say():
    time = np.linspace(0.0, 900.0, 91)
    phi, theta, psi = np.degrees(to_euler_313(SCAN.at(time).q_DN)).T
    np.testing.assert_allclose(theta, 22.5, rtol=1e-12)
    np.testing.assert_allclose(phi, time * 360.0 / 3600.0, atol=1e-10)
    np.testing.assert_allclose(wrapped_difference(np.radians(psi), np.radians(time * 0.464 * 6.0)), 0.0, atol=1e-12)
    np.testing.assert_allclose(np.degrees(to_euler_313(FAST.at(np.array(0.0)).q_DN)), [40.0, 70.0, -100.0], rtol=1e-12)


def test_a_scan_answers_for_one_instant_as_for_many():
    time = np.linspace(0.0, 10.0, 6)
    for many, one in zip(SCAN.at(time), SCAN.at(time[4]), strict=True):
        np.testing.assert_array_equal(many[4], one)


def test_a_scan_can_be_written_in_a_scenario():
    written = {"type": "euler-rates", "nutation_deg": 22.5, "precession_rev_h": 1.0, "spin_rpm": 0.464}
    assert TypeAdapter(ReferenceSettings).validate_python(written) == SCAN
    with pytest.raises(ValidationError, match="nutation_deg"):
        TypeAdapter(ReferenceSettings).validate_python(written | {"nutation_deg": 181.0})
