"""Where two conics meet: points known beforehand, residuals, and the number of them by elimination."""

from itertools import combinations

import numpy as np
import pytest

from control.conics import homogeneous, intersections, value

PAIRS = 400
KINDS = ("ellipse", "hyperbola", "parabola", "lines")


def similarities(rng: np.random.Generator, number: int) -> np.ndarray:
    """Random similarities of the plane (n, 3, 3): those of conics are M' Q M, those of points M^-1 x."""
    angle, size = rng.uniform(0.0, 2 * np.pi, number), rng.uniform(0.3, 2.0, number)
    motion = np.zeros((number, 3, 3))
    motion[:, 0, 0] = motion[:, 1, 1] = size * np.cos(angle)
    motion[:, 1, 0] = size * np.sin(angle)
    motion[:, 0, 1] = -motion[:, 1, 0]
    motion[:, :2, 2] = rng.uniform(-1.0, 1.0, (number, 2))
    motion[:, 2, 2] = 1.0
    return motion


def random_conics(kind: str, rng: np.random.Generator, number: int = PAIRS) -> np.ndarray:
    """Conics (n, 3, 3) of a kind, anywhere in the plane."""
    a, b = rng.uniform(0.2, 3.0, (2, number))
    matrix = np.zeros((number, 3, 3))
    matrix[:, 0, 0] = a
    if kind == "parabola":
        matrix[:, 1, 2] = matrix[:, 2, 1] = -b
    else:
        matrix[:, 1, 1] = b if kind == "ellipse" else -b
        matrix[:, 2, 2] = 0.0 if kind == "lines" else -1.0
    motion = similarities(rng, number)
    return motion.swapaxes(1, 2) @ matrix @ motion


def residual(conic: np.ndarray, points: np.ndarray) -> np.ndarray:
    """|x' Q x| / (|Q| |x|^2), NaN where there is no point."""
    size = np.linalg.norm(conic, axis=(-2, -1))[..., None] * np.sum(homogeneous(points) ** 2, axis=-1)
    return np.abs(value(conic[..., None, :, :], points)) / size


def eliminated(first: np.ndarray, second: np.ndarray) -> np.ndarray:
    """Roots (4,) of the resultant, in x_1, of two conics taken as quadratics in x_2."""

    def quadratic(q: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        return np.array([q[1, 1]]), np.array([2 * q[0, 1], 2 * q[1, 2]]), np.array([q[0, 0], 2 * q[0, 2], q[2, 2]])

    (a, b, c), (d, e, f) = quadratic(first), quadratic(second)

    def minor(p: np.ndarray, q: np.ndarray, r: np.ndarray, s: np.ndarray) -> np.ndarray:
        return np.polysub(np.polymul(p, s), np.polymul(q, r))

    return np.roots(np.polysub(np.polymul(minor(a, c, d, f), minor(a, c, d, f)), np.polymul(minor(a, b, d, e), minor(b, c, e, f))))


def through(points: np.ndarray, mix: tuple[float, float]) -> np.ndarray:
    """A conic of the pencil through four points (4, 2): a mixture of two pairs of lines."""
    x = homogeneous(points)

    def lines(i: int, j: int, k: int, m: int) -> np.ndarray:
        pair = np.outer(np.cross(x[i], x[j]), np.cross(x[k], x[m]))
        return (pair + pair.T) / np.linalg.norm(pair)

    return mix[0] * lines(0, 1, 2, 3) + mix[1] * lines(0, 2, 1, 3)


def in_order(points: np.ndarray) -> np.ndarray:
    return points[np.lexsort(points.T)]


@pytest.mark.parametrize("kinds", [(a, b) for i, a in enumerate(KINDS) for b in KINDS[i:]], ids="-".join)
def test_common_points_lie_on_both_and_are_as_many_as_elimination_finds(kinds):
    rng = np.random.default_rng([KINDS.index(kind) for kind in kinds])
    first, second = random_conics(kinds[0], rng), random_conics(kinds[1], rng)
    points = intersections(first, second)
    found = np.isfinite(points[..., 0])
    assert np.nanmax(np.maximum(residual(first, points), residual(second, points))) < 1e-9
    roots = np.array([eliminated(a, b) for a, b in zip(first, second, strict=True)])
    imaginary = np.abs(roots.imag) / (1.0 + np.abs(roots))
    clear = np.all((imaginary == 0.0) | (imaginary > 1e-4), axis=1)  # not nearly tangent
    assert clear.mean() > 0.9
    expected = np.sum(imaginary == 0.0, axis=1)
    np.testing.assert_array_equal(found.sum(axis=1)[clear], expected[clear])
    if kinds == ("lines", "lines"):
        assert set(expected[clear]) == {4}
    else:
        assert len(set(expected[clear])) > 1  # the sample has pairs that meet in different numbers of points
    for roots_of, points_of, has in zip(roots[clear], points[clear], found[clear], strict=True):
        np.testing.assert_allclose(np.sort(points_of[has, 0]), np.sort(roots_of.real[roots_of.imag == 0]), rtol=1e-5, atol=1e-5)


@pytest.mark.parametrize(
    "mixes", [((1.0, 0.7), (1.0, -0.4)), ((1.0, 0.0), (0.2, 1.0)), ((1.0, 0.0), (0.0, 1.0)), ((1.0, 1e-9), (0.0, 1.0))]
)
def test_conics_through_four_points_meet_there_even_when_both_are_pairs_of_lines(mixes):
    rng = np.random.default_rng(4)
    for _ in range(50):
        points = np.array([[-1.0, -1.0], [1.0, -1.0], [-1.0, 1.0], [1.0, 1.0]]) + rng.uniform(-0.4, 0.4, (4, 2))
        met = intersections(through(points, mixes[0]), through(points, mixes[1]))
        np.testing.assert_allclose(in_order(met), in_order(points), atol=1e-9)


def test_conics_that_touch_meet_there():
    circle, parabola = np.diag([1.0, 1.0, -1.0]), np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -0.5], [0.0, -0.5, -1.0]])  # y = x^2 - 1
    motion = similarities(np.random.default_rng(7), 100)
    met = intersections(*(motion.swapaxes(1, 2) @ matrix @ motion for matrix in (circle, parabola)))
    for known in ([1.0, 0.0, 1.0], [-1.0, 0.0, 1.0], [0.0, -1.0, 1.0]):  # it touches at the lowest point and cuts at the sides
        there = np.linalg.solve(motion, np.broadcast_to(np.array(known)[:, None], (100, 3, 1)))[:, None, :2, 0]
        assert np.max(np.nanmin(np.linalg.norm(met - there, axis=-1), axis=1)) < 1e-6


def test_a_point_far_away_or_at_infinity_is_not_mistaken_for_another():
    hyperbola = np.array([[0.0, 0.5, 0.0], [0.5, 0.0, 0.0], [0.0, 0.0, -1.0]])  # x y = 1
    level = np.array([[0.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, -1.0]])  # y = 1 and y = -1, which meet it once each
    met = intersections(hyperbola, level)
    np.testing.assert_allclose(in_order(met[np.isfinite(met[:, 0])]), [[-1.0, -1.0], [1.0, 1.0]], atol=1e-12)


@pytest.mark.parametrize("other", [np.diag([1.0, 1.0, -4.0]), np.diag([1.0, 1.0, 4.0]), np.eye(3), np.zeros((3, 3))])
def test_conics_that_are_apart_or_have_no_real_points_do_not_meet(other):
    circle = np.diag([1.0, 1.0, -1.0])
    assert not np.isfinite(intersections(circle, other)).any()
    assert not np.isfinite(intersections(other, circle)).any()
    assert not np.isfinite(intersections(other, other)).any()


@pytest.mark.parametrize("turned", [0.0, 0.1])
def test_no_common_point_is_lost_wherever_on_the_circle_it_lies(turned):
    """Every four of eight points all around: for some of them any fixed place of t = infinity is a common point."""
    angles = turned + np.arange(8) * np.pi / 4
    around = np.stack([np.cos(angles), np.sin(angles)], axis=-1)
    fours = np.array(list(combinations(range(8), 4)))
    pairs = np.array([through(around[four], (1.0, 0.3)) for four in fours])
    met = intersections(np.diag([1.0, 1.0, -1.0]), pairs)
    for four, found in zip(fours, met, strict=True):
        np.testing.assert_allclose(in_order(np.round(found, 9)), in_order(np.round(around[four], 9)), atol=1e-8)


def test_the_quadratic_is_that_of_the_matrix():
    rng = np.random.default_rng(5)
    a, b, c, p = rng.standard_normal((2, 2)), rng.standard_normal(2), 0.3, rng.standard_normal((7, 2))
    conic = np.block([[a + a.T, -b[:, None]], [-b, np.array(c)]])
    np.testing.assert_allclose(value(conic, p), [x @ (a + a.T) @ x - 2 * x @ b + c for x in p], atol=1e-12)


def test_a_pair_has_the_same_bits_in_any_batch_and_any_shape():
    rng = np.random.default_rng(6)
    first, second = random_conics("ellipse", rng, 64), random_conics("hyperbola", rng, 64)
    everyone = intersections(first, second)
    for size in (1, 3, 10):
        np.testing.assert_array_equal(intersections(first[5 : 5 + size], second[5 : 5 + size]), everyone[5 : 5 + size])
    np.testing.assert_array_equal(intersections(first[5], second[5]), everyone[5])
    assert intersections(first.reshape(4, 16, 3, 3), second[0]).shape == (4, 16, 4, 2)


def test_pairs_of_lines_with_a_common_vertex_or_line_give_nothing():
    def lines(*slopes: float) -> np.ndarray:
        pair = np.outer([slopes[0], -1.0, 0.0], [slopes[1], -1.0, 0.0])
        return pair + pair.T

    assert not np.isfinite(intersections(lines(1.0, 2.0), lines(3.0, -1.0))).any()
    assert not np.isfinite(intersections(lines(1.0, 2.0), lines(1.0, -1.0))).any()
