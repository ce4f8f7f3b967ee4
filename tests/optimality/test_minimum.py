"""The second order where inequalities are active, against the eigenvalues of one dense matrix."""

from collections import Counter
from dataclasses import replace

import numpy as np
import pytest
import scipy.linalg

from ann_dc.optimality.by_stages import Minimum
from ann_dc.optimality.contact import Contact
from ann_dc.optimality.expansion import Expansion
from ann_dc.optimality.minimum import minimum_by_stages, minimum_of

STRICT, FALLING, FLAT = Minimum.STRICT, Minimum.NOT_A_MINIMUM, Minimum.FLAT
BORDER = 1e-8
"""Curvature over the largest one below which a random matrix says nothing."""

both_ways = pytest.mark.parametrize("way", [minimum_of, minimum_by_stages])


def expanded(J, W, end, fixed_start, fixed) -> Expansion:
    """An expansion of which only the second order matters."""
    N, n, z = J.shape
    nothing = np.zeros(n)
    return Expansion(
        fixed_start=fixed_start, fixed=fixed, ends=(nothing, nothing), state=np.ones(n), cost=1.0,
        q=np.zeros((N + 1, n)), u=np.zeros((N, z - n)), jacobian=J, hessian=W,
        slope=np.zeros((N, z)), end_hessian=end, end_slope=nothing, mu=np.zeros((N, n)),
        map=np.zeros((n, N)), objective=0.0,
    )  # fmt: skip


def touched(expansion: Expansion, rows: np.ndarray, strong: np.ndarray) -> Expansion:
    """With rows (N+1, R, n+m) that touch, the strong ones (N+1, R) with a multiplier."""
    n = len(expansion.fixed)
    rows, nothing = rows.copy(), np.zeros(rows.shape[:2])
    rows[-1, :, n:] = 0.0
    rows[0, :, :n][:, expansion.fixed_start] = rows[-1, :, :n][:, expansion.fixed] = 0.0
    there = rows.any(axis=-1)
    contact = Contact(
        is_row=there,
        value=nothing,
        distance=np.where(there, 0.0, -np.inf),
        slope=rows,
        multiplier=1.0 * (strong & there),
        product=nothing,
        compliance=nothing,
        room=np.full_like(nothing, np.inf),
    )
    return replace(expansion, contact=contact)


def eigenvalues(expansion: Expansion, rows: np.ndarray) -> np.ndarray:
    """Of the Hessian in all of (q_0, u_0, .., q_N), on the null space of all constraints at once.

    They are eliminated one by one, each normalised, so that what depends on others is found.
    """
    J, W, (N, n, z) = expansion.jacobian, expansion.hessian, expansion.jacobian.shape
    size = N * z + n
    H, A = np.zeros((size, size)), []
    for k in range(N):
        at = slice(z * k, z * (k + 1))
        H[at, at] += W[k]
        gap = np.zeros((n, size))
        gap[:, at] = J[k]
        gap[:, z * (k + 1) : z * (k + 1) + n] = -np.eye(n)
        own = np.zeros((rows.shape[1], size))
        own[:, at] = rows[k]
        A += [*gap, *own]
    H[-n:, -n:] += expansion.end_hessian
    last = np.zeros((rows.shape[1], size))
    last[:, -n:] = rows[-1, :, :n]
    A += [*np.eye(size)[:n][expansion.fixed_start], *np.eye(size)[-n:][expansion.fixed], *last]
    A = np.array([a / np.linalg.norm(a) for a in A if a.any()])
    tangent = scipy.linalg.null_space(A, rcond=1e-11)
    return np.linalg.eigvalsh(tangent.T @ H @ tangent)


def answer(values: np.ndarray, border: float) -> Minimum:
    if not len(values) or values[0] > border:
        return STRICT
    return FALLING if values[0] < -border else FLAT


def symmetric(A: np.ndarray) -> np.ndarray:
    return (A + A.swapaxes(-1, -2)) / 2


def random_rows(rng, shape: tuple[int, int, int], n: int) -> np.ndarray:
    """Mixed, of states alone, of one control alone, none at all, and some that repeat others."""
    rows = rng.normal(size=shape)
    kind = rng.integers(0, 5, shape[:2])
    rows[kind == 1, n:] = 0.0
    one = np.eye(shape[2])[rng.integers(n, shape[2], shape[:2])]
    rows[kind == 2] = one[kind == 2]
    rows[kind >= 3] = 0.0
    if shape[1] > 1 and rng.random() < 0.4:
        rows[:, -1] = rows[:, 0] * rng.uniform(0.5, 2)
    if shape[1] > 2 and rng.random() < 0.4:
        rows[:, -2] = rows[:, 0] - 2 * rows[:, 1]
    return rows


def random_expansion(rng) -> tuple[Expansion, np.ndarray]:
    n, m, N, R = (int(rng.integers(1, most)) for most in (5, 4, 7, 5))
    fixed_start, fixed = rng.random((2, n)) < rng.choice([0.0, 0.5, 1.0], (2, 1))
    J = rng.normal(size=(N, n, n + m))
    W = symmetric(rng.normal(size=(N, n + m, n + m))) + rng.uniform(-2, 3) * np.eye(n + m)
    end = symmetric(rng.normal(size=(n, n))) + rng.uniform(-2, 3) * np.eye(n)
    plain = expanded(J, W, end, fixed_start, fixed)
    return plain, random_rows(rng, (N + 1, R, n + m), n)


@pytest.mark.sampled(1)
@both_ways
def test_strongly_active_rows_hold_as_equations(way):
    rng, seen = np.random.default_rng(0), Counter()
    for _ in range(1000):
        plain, rows = random_expansion(rng)
        expansion = touched(plain, rows, np.ones(rows.shape[:2], bool))
        values = eigenvalues(expansion, expansion.contact.slope)
        border = BORDER * np.abs(values).max(initial=0.0)
        if answer(values, border) is FLAT:
            continue
        reported = way(expansion)
        assert reported is answer(values, border), (rows, values)
        seen[reported] += 1
    assert min(seen[STRICT], seen[FALLING]) > 200


@pytest.mark.sampled(1)
@both_ways
def test_whole_numbers_and_rows_that_follow_from_others(way):
    """Of low rank, flat, and full of rows that the ends and the map already say."""
    rng, seen = np.random.default_rng(1), Counter()
    for _ in range(1500):
        n, m, N, R = (int(rng.integers(1, most)) for most in (4, 3, 5, 4))
        fixed_start, fixed = rng.random((2, n)) < rng.choice([0.0, 0.5, 1.0], (2, 1))
        J = rng.integers(-1, 2, (N, n, n + m)) * (rng.random((n, n + m)) < 0.7) * 1.0
        root = rng.integers(-1, 2, (N, n + m, int(rng.integers(1, n + m + 1)))) * 1.0
        W = root @ np.diag(rng.choice([1.0, 1.0, -1.0], root.shape[2])) @ root.swapaxes(1, 2)
        end = rng.integers(-1, 2, (n, 1)) * 1.0
        rows = rng.integers(-1, 2, (N + 1, R, n + m)) * (rng.random((N + 1, R, 1)) < 0.4) * 1.0
        plain = expanded(J, W, end @ end.T, fixed_start, fixed)
        expansion = touched(plain, rows, np.ones(rows.shape[:2], bool))
        reported = way(expansion)
        values = eigenvalues(expansion, expansion.contact.slope)
        assert reported is answer(values, 1e-9), (J, W, end, rows, values)
        seen[reported] += 1
    assert min(seen[STRICT], seen[FALLING], seen[FLAT]) > 100


@both_ways
@pytest.mark.parametrize("growth", [1.0, 1.3])
@pytest.mark.parametrize("N", [10, 200])
def test_rows_that_say_the_same_at_every_stage(way, growth, N):
    """One state at its bound all along, said three times a stage, in coordinates that are turned.

    x' = growth x + a with x = 0 and a = 0, which follows from x = 0; the two others are free, and
    only their controls cost anything.
    """
    rng = np.random.default_rng(2)
    turn, other = (np.linalg.qr(rng.normal(size=(3, 3)))[0] for _ in range(2))
    J = np.hstack([turn.T @ np.diag([growth, 1.0, 1.0]) @ turn, turn.T @ other])
    x = np.array([*turn[0], 0.0, 0.0, 0.0])
    rows = np.array([x, 3 * x, np.array([0.0, 0.0, 0.0, *other[0]]), x @ np.vstack([J, 0 * J])])
    for cheapest in (0.1, -0.1):
        W = np.zeros((6, 6))
        W[3:, 3:] = other.T @ np.diag([-5.0, 1.0, cheapest]) @ other
        plain = expanded(
            np.tile(J, (N, 1, 1)), np.tile(W, (N, 1, 1)), np.zeros((3, 3)), np.ones(3, bool),
            np.zeros(3, bool),
        )  # fmt: skip
        expansion = touched(plain, np.tile(rows, (N + 1, 1, 1)), np.ones((N + 1, 4), bool))
        if N == 10:
            values = eigenvalues(expansion, expansion.contact.slope)
            assert np.sign(values[0]) == np.sign(cheapest)
        assert way(expansion) is (STRICT if cheapest > 0 else FALLING)


def test_weakly_active_rows_leave_what_depends_on_them_open():
    """Strict without them is strict, not even with them is none, and in between nobody knows."""
    rng, seen = np.random.default_rng(3), Counter()
    for _ in range(600):
        plain, rows = random_expansion(rng)
        strong = rng.random(rows.shape[:2]) < 0.5
        expansion = touched(plain, rows, strong)
        slope = expansion.contact.slope
        held = eigenvalues(expansion, np.where(strong[..., None], slope, 0.0))
        all_held = eigenvalues(expansion, slope)
        border = BORDER * max(np.abs(held).max(initial=0.0), 1e-300)
        without, along = answer(held, border), answer(all_held, border)
        if FLAT in (without, along):
            continue
        expected = without if without is STRICT or along is FALLING else Minimum.NOT_SHOWN
        assert minimum_of(expansion) is minimum_by_stages(expansion) is expected
        seen[expected] += 1
    assert min(seen[STRICT], seen[FALLING], seen[Minimum.NOT_SHOWN]) > 50


def test_a_row_that_is_no_number_is_not_checked():
    plain, rows = random_expansion(np.random.default_rng(4))
    rows[0, 0] = np.inf
    strong = np.ones(rows.shape[:2], bool)
    assert minimum_of(touched(plain, rows, strong)) is Minimum.NOT_CHECKED
