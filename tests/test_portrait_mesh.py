"""The Talk Mask: its size, its names, its order, and what moves it."""

from __future__ import annotations

import numpy as np
import pytest

import database.portrait_mesh as mesh
from database.portrait_mesh import (
    EYE_TRIANGLES,
    FRAME,
    GENERIC,
    HEAD,
    INNER_LIPS,
    LEFT_EYE,
    LEFT_LOWER_LID,
    LEFT_UPPER_LID,
    LOWER_INNER,
    MESH_INDEX,
    MIRROR,
    N_MASK,
    OUTER_LIPS,
    SKIN_TRIANGLES,
    UPPER_INNER,
)
from database.talk_mask import TalkMask

TRIANGLES = np.concatenate([SKIN_TRIANGLES, EYE_TRIANGLES])


def areas(points: np.ndarray, triangles: np.ndarray = TRIANGLES) -> np.ndarray:
    a, b, c = (points[triangles[:, k]] for k in range(3))
    u, v = b - a, c - a
    return (u[:, 0] * v[:, 1] - u[:, 1] * v[:, 0]) / 2


@pytest.fixture
def mask() -> TalkMask:
    """Lay the generic mask over a picture, turned a little."""
    c, s = 100 * np.cos(0.1), 100 * np.sin(0.1)
    return TalkMask(GENERIC @ np.array([[c, s], [-s, c]]) + (250.0, 220.0), 500, 520)


def test_it_is_as_small_as_the_paper_says() -> None:
    assert N_MASK < 200 and len(TRIANGLES) < 350
    assert len(GENERIC) == len(MESH_INDEX) == len(MIRROR) == N_MASK
    assert sorted(set(TRIANGLES.ravel())) == list(range(N_MASK))


def test_triangles_neither_fold_nor_overlap() -> None:
    assert areas(GENERIC).min() > 0
    edges = np.sort(
        np.concatenate([TRIANGLES[:, [0, 1]], TRIANGLES[:, [1, 2]], TRIANGLES[:, [2, 0]]])
    )
    _, counts = np.unique(edges, axis=0, return_counts=True)
    assert counts.max() == 2
    # All of the frame's polygon is covered once; the closed mouth has no area.
    x, y = GENERIC[FRAME].T
    whole = abs(x @ np.roll(y, -1) - y @ np.roll(x, -1)) / 2
    assert areas(GENERIC).sum() == pytest.approx(whole, rel=1e-6)


def test_it_is_symmetric() -> None:
    np.testing.assert_array_equal(MIRROR[MIRROR], np.arange(N_MASK))
    np.testing.assert_allclose(GENERIC[MIRROR] * (-1, 1), GENERIC, atol=0.0011)
    mirrored = {tuple(sorted(t)) for t in MIRROR[TRIANGLES].tolist()}
    assert mirrored == {tuple(sorted(t)) for t in TRIANGLES.tolist()}


def test_lips_and_rings_are_where_their_names_say() -> None:
    np.testing.assert_array_equal(GENERIC[UPPER_INNER], GENERIC[LOWER_INNER])
    assert (GENERIC[OUTER_LIPS[1:10], 1] < GENERIC[OUTER_LIPS[:10:-1], 1]).all()
    assert (MESH_INDEX[np.concatenate([HEAD, FRAME])] == -1).all()
    assert (np.delete(MESH_INDEX, np.concatenate([HEAD, FRAME])) >= 0).all()
    named = [v for k, v in vars(mesh).items() if isinstance(v, np.ndarray) and v.ndim == 1]
    assert set(np.concatenate([v for v in named if len(v) < 30]).tolist()) >= set(range(N_MASK))
    assert not set(INNER_LIPS) & set(OUTER_LIPS)


def test_there_and_back(mask: TalkMask) -> None:
    assert mask.unit == pytest.approx(100, rel=1e-3)
    np.testing.assert_allclose(mask.normalised, GENERIC, atol=1e-3)
    moved = np.random.default_rng(0).normal(size=(5, N_MASK, 2))
    np.testing.assert_allclose(mask.from_pixels(mask.to_pixels(moved)), moved)
    assert mask.folded() == 0


def test_shut_eyes_are_shut(mask: TalkMask) -> None:
    shut = mask.normalised + mask.shut_eyes()
    corners = shut[LEFT_EYE[[0, 7]]]
    line = np.concatenate([corners[:1], shut[LEFT_LOWER_LID], corners[1:]])
    below = np.interp(shut[LEFT_UPPER_LID, 0], line[:, 0], line[:, 1])
    gap = below - shut[LEFT_UPPER_LID, 1]
    before = mask.normalised
    opened = before[LEFT_LOWER_LID, 1].max() - before[LEFT_UPPER_LID, 1].min()
    assert np.abs(gap).max() < 0.1 * opened
    still = np.setdiff1d(np.arange(N_MASK), np.flatnonzero(np.abs(mask.shut_eyes()).any(axis=1)))
    assert set(OUTER_LIPS) <= set(still)


def test_open_lips_are_closed(mask: TalkMask) -> None:
    vertices = mask.vertices.copy()
    vertices[LOWER_INNER] += (0, 6)
    opened = TalkMask(vertices, 500, 520)
    assert opened.opening == pytest.approx(0.06, abs=1e-3)
    closed = opened.normalised + opened.close_lips()
    np.testing.assert_allclose(closed[UPPER_INNER], closed[LOWER_INNER], atol=1e-12)
    assert not mask.close_lips().any()


def test_what_lies_on_the_edge_holds_still() -> None:
    vertices = GENERIC * 100 + (100.0, 100.0)
    mask = TalkMask(np.clip(vertices, 0, 299), 300, 300)
    assert not mask.free[FRAME].any()
    assert not mask.free[HEAD[np.flatnonzero(vertices[HEAD, 0] < 0)]].any()
    assert mask.free[OUTER_LIPS].all()
