"""Attitude mathematics: group axioms, SciPy as an oracle, and the same bits for a row whatever the batch."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from scipy.spatial.transform import Rotation

from models.attitude import quaternion as qt

ROUNDING = 1e-14  # a dozen operations on numbers of order one


def vectors(size: int, bound: float) -> st.SearchStrategy[np.ndarray]:
    return arrays(float, size, elements=st.floats(-bound, bound, allow_subnormal=False))


units = vectors(4, 1.0).filter(lambda q: np.linalg.norm(q) > 0.1).map(lambda q: q / np.linalg.norm(q))
triples = vectors(3, 10.0)
directions = vectors(3, 1.0).filter(lambda v: np.linalg.norm(v) > 0.1).map(lambda v: v / np.linalg.norm(v))


@given(units, units, units)
def test_the_product_is_associative(p, q, r):
    np.testing.assert_allclose(qt.multiply(qt.multiply(p, q), r), qt.multiply(p, qt.multiply(q, r)), atol=ROUNDING)


@given(units)
def test_the_identity_is_neutral_on_both_sides(q):
    np.testing.assert_array_equal(qt.multiply(q, qt.IDENTITY), q)
    np.testing.assert_array_equal(qt.multiply(qt.IDENTITY, q), q)


@given(units)
def test_the_inverse_undoes_on_both_sides(q):
    np.testing.assert_allclose(qt.multiply(q, qt.inverse(q)), qt.IDENTITY, atol=ROUNDING)
    np.testing.assert_allclose(qt.multiply(qt.inverse(q), q), qt.IDENTITY, atol=ROUNDING)


@given(units, units)
def test_the_inverse_of_a_product_is_the_product_of_inverses_turned_round(p, q):
    np.testing.assert_allclose(qt.inverse(qt.multiply(p, q)), qt.multiply(qt.inverse(q), qt.inverse(p)), atol=ROUNDING)


@given(units, units)
def test_the_attitude_matrix_of_a_product_is_the_product_of_attitude_matrices(p, q):
    np.testing.assert_allclose(qt.attitude_matrix(qt.multiply(p, q)), qt.attitude_matrix(p) @ qt.attitude_matrix(q), atol=ROUNDING)


@given(units)
def test_the_attitude_matrix_is_scipys_rotation_transposed(q):
    np.testing.assert_allclose(qt.attitude_matrix(q), Rotation.from_quat(q).as_matrix().T, atol=ROUNDING)


@given(units, units)
def test_the_product_is_scipys_in_the_other_order(p, q):
    theirs = (Rotation.from_quat(q) * Rotation.from_quat(p)).as_quat()
    np.testing.assert_allclose(qt.align(theirs, qt.multiply(p, q)), qt.multiply(p, q), atol=ROUNDING)


@given(units)
def test_the_attitude_matrix_is_a_rotation(q):
    matrix = qt.attitude_matrix(q)
    np.testing.assert_allclose(matrix @ matrix.T, np.eye(3), atol=ROUNDING)
    assert np.linalg.det(matrix) == pytest.approx(1.0)


@given(directions, st.floats(0.0, np.pi))
def test_exponential_and_logarithm_are_scipys(axis, angle):
    np.testing.assert_allclose(qt.from_rotation_vector(angle * axis), Rotation.from_rotvec(angle * axis).as_quat(), atol=ROUNDING)
    q = qt.from_rotation_vector(angle * axis)
    theirs = Rotation.from_quat(q).as_rotvec()
    close = np.allclose(qt.to_rotation_vector(q), theirs, atol=1e-14 * np.pi)
    half_turn = abs(angle - np.pi) < 1e-12  # there the axis is known but for its sign
    assert close or (half_turn and np.allclose(qt.to_rotation_vector(q), -theirs, atol=1e-11))


@pytest.mark.parametrize("angle", [0.0, 1e-300, 1e-160, 1e-12, 1e-8, 1e-4, 0.1, 1.0, 3.0, np.pi - 1e-4, np.pi - 1e-8, np.pi - 1e-12])
@given(axis=directions)
def test_the_logarithm_of_the_exponential_is_the_rotation_vector(axis, angle):
    there_and_back = qt.to_rotation_vector(qt.from_rotation_vector(angle * axis))
    np.testing.assert_allclose(there_and_back, angle * axis, rtol=1e-14, atol=1e-15 * angle)


@given(units)
def test_the_exponential_of_the_logarithm_is_the_attitude(q):
    np.testing.assert_allclose(qt.align(qt.from_rotation_vector(qt.to_rotation_vector(q)), q), q, atol=ROUNDING)


@given(units)
def test_both_signs_of_a_quaternion_have_the_same_shortest_rotation_vector(q):
    if q[3]:  # at exactly half a turn there are two shortest ones
        np.testing.assert_array_equal(qt.to_rotation_vector(q), qt.to_rotation_vector(-q))
    assert np.linalg.norm(qt.to_rotation_vector(q)) <= np.pi * (1 + 1e-15)


@given(units, triples)
def test_xi_gives_the_quaternion_rate(q, omega):
    h = 1e-4  # error of central differences: h^2 |omega|^3 / 24 < 4e-6; of rounding: 1e-12
    ahead, behind = (qt.multiply(qt.from_rotation_vector(t * omega), q) for t in (h, -h))
    np.testing.assert_allclose(0.5 * qt.xi(q) @ omega, (ahead - behind) / (2 * h), atol=1e-5)


@given(units)
def test_the_columns_of_xi_are_orthonormal_and_orthogonal_to_the_quaternion(q):
    np.testing.assert_allclose(qt.xi(q).T @ qt.xi(q), np.eye(3), atol=ROUNDING)
    np.testing.assert_allclose(qt.xi(q).T @ q, 0.0, atol=ROUNDING)


@given(units, triples)
def test_a_turning_frame_sees_a_fixed_vector_turn_backwards(q, omega):
    fixed, h = np.array([1.0, -2.0, 0.5]), 1e-4
    ahead, behind = (qt.attitude_matrix(qt.multiply(qt.from_rotation_vector(t * omega), q)) @ fixed for t in (h, -h))
    np.testing.assert_allclose((ahead - behind) / (2 * h), -np.cross(omega, qt.attitude_matrix(q) @ fixed), atol=1e-4)


@given(triples, triples)
def test_the_cross_matrix_crosses(v, w):
    np.testing.assert_allclose(qt.cross_matrix(v) @ w, np.cross(v, w), atol=1e-13)
    np.testing.assert_allclose(qt.cross(v, w), np.cross(v, w), atol=1e-13)
    np.testing.assert_array_equal(qt.cross_matrix(v), -qt.cross_matrix(v).T)


@given(units, units)
def test_align_keeps_the_attitude_and_takes_the_nearer_sign(q, reference):
    aligned = qt.align(q, reference)
    assert np.array_equal(aligned, q) or np.array_equal(aligned, -q)
    assert aligned @ reference >= -ROUNDING


@given(units, directions, st.floats(1e-6, 3.1))
def test_the_error_is_the_turn_in_the_body_frame_that_was_made(reference, axis, angle):
    turned = qt.multiply(qt.from_rotation_vector(angle * axis), reference)
    np.testing.assert_allclose(qt.error(turned, reference), angle * axis, atol=4 * ROUNDING)
    np.testing.assert_allclose(qt.error(-turned, reference), angle * axis, atol=4 * ROUNDING)
    assert qt.angle(turned, reference) == pytest.approx(angle, abs=4 * ROUNDING)
    np.testing.assert_allclose(qt.attitude_matrix(turned) @ qt.attitude_matrix(reference).T @ axis, axis, atol=ROUNDING)


@given(vectors(4, 1e3).filter(lambda q: np.linalg.norm(q) > 1e-3))
def test_normalizing_gives_unit_length_and_keeps_the_direction(q):
    np.testing.assert_allclose(np.linalg.norm(qt.normalize(q)), 1.0, rtol=1e-15)
    np.testing.assert_allclose(qt.normalize(q) * np.linalg.norm(q), q, rtol=1e-14, atol=1e-300)


FUNCTIONS = {  # function: (inputs, their lengths), (shape of the output)
    "cross_matrix": ((3,), (3, 3)),
    "cross": ((3, 3), (3,)),
    "multiply": ((4, 4), (4,)),
    "inverse": ((4,), (4,)),
    "normalize": ((4,), (4,)),
    "attitude_matrix": ((4,), (3, 3)),
    "xi": ((4,), (4, 3)),
    "from_rotation_vector": ((3,), (4,)),
    "to_rotation_vector": ((4,), (3,)),
    "error": ((4, 4), (3,)),
    "angle": ((4, 4), ()),
    "align": ((4, 4), (4,)),
}


def rows(sizes: tuple[int, ...], count: int) -> list[np.ndarray]:
    rng = np.random.default_rng(7)
    drawn = [rng.standard_normal((count, size)) for size in sizes]
    return [qt.normalize(x) if x.shape[-1] == 4 else x for x in drawn]


def test_every_public_function_is_tested_in_batches():
    public = {name for name, value in vars(qt).items() if getattr(value, "__module__", "") == qt.__name__ and not name.startswith("_")}
    assert public == set(FUNCTIONS)


@pytest.mark.parametrize("name", FUNCTIONS)
@pytest.mark.parametrize("lead", [(), (1,), (6,), (2, 3), (1, 2, 3)])
def test_any_leading_axes_pass_through(name, lead):
    sizes, shape = FUNCTIONS[name]
    given_rows = rows(sizes, int(np.prod(lead)))
    result = getattr(qt, name)(*(x.reshape(*lead, -1) for x in given_rows))
    flat = getattr(qt, name)(*given_rows)
    assert result.shape == (*lead, *shape)
    np.testing.assert_array_equal(result.reshape(flat.shape), flat)


@pytest.mark.parametrize("name", FUNCTIONS)
@pytest.mark.parametrize("size", [1, 3, 10, 64])
def test_a_row_has_the_same_bits_in_any_batch(name, size):
    function, inputs = getattr(qt, name), rows(FUNCTIONS[name][0], 1000)
    everyone = function(*inputs)
    for first in range(0, 1000 - size, 97):
        some = slice(first, first + size)
        assert np.array_equal(function(*(x[some] for x in inputs)), everyone[some])
    assert np.array_equal(function(*(x[5] for x in inputs)), everyone[5])  # and without any axis


def test_a_quaternion_with_a_missing_component_is_aligned_with_nothing():
    """Either sign may be the one, whatever the other components say: no answer, where a comparison with NaN would say "no"."""
    q = qt.normalize(np.array([[0.1, 0.2, 0.3, 0.9]] * 5))
    torn = np.array(q)
    torn[[0, 1, 2, 3], [0, 1, 2, 3]] = np.nan
    for sign in (1.0, -1.0):
        found = qt.align(sign * torn, q)
        assert np.isnan(found[:4]).all()
        np.testing.assert_array_equal(found[4], q[4])
    assert np.isnan(qt.align(q, torn)[:4]).all()
    assert np.isnan(qt.error(torn, q)[:4]).all()
    assert np.isnan(qt.to_rotation_vector(torn)[:4]).all()
