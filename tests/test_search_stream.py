"""Decisions with a bounded look-ahead: valid, bounded in memory, and exact where it suffices."""

from __future__ import annotations

import numpy as np
import pytest

from database.cost_definition import skip_costs
from database.errors import SelectionError
from unitsel.costs import Weights
from unitsel.search import SearchSpace, StreamingSearch, priced, search

WEIGHTS = Weights(1, 1, 1, 0.05)


def smooth_sentence(seed, n_frames=60, n=200):
    rng = np.random.default_rng(seed)
    features = np.cumsum(rng.normal(size=(n, 5)), axis=0) / 4
    space = SearchSpace(
        np.arange(n) // 25,
        np.arange(n) % 25,
        features.astype(np.float32),
        np.array([0, 1, 2, 5]),
        skip_costs(0.6, 5),
    )
    lists = [np.sort(rng.choice(n, n // 3, replace=False)) for _ in range(4)]
    candidates = [lists[i] for i in np.repeat(rng.integers(4, size=n_frames), 5)[:n_frames]]
    walk = np.cumsum(rng.normal(size=(n_frames, n)), axis=0)
    target = [np.abs(walk[t, c]) * 0.1 for t, c in enumerate(candidates)]
    return space, candidates, target


@pytest.mark.parametrize("lookahead", [0, 1, 3, 10, 59, 60, 1000])
def test_path_is_valid_and_priced(lookahead):
    for seed in range(10):
        space, candidates, target = smooth_sentence(seed)
        exact = search(space, candidates, target, WEIGHTS)
        found = search(space, candidates, target, WEIGHTS, lookahead=lookahead)
        places = [
            int(np.flatnonzero(c == u)[0])
            for c, u in zip(candidates, found.path.tolist(), strict=True)
        ]
        terms = np.array([t[i] for t, i in zip(target, places, strict=True)])
        assert found.cost == priced(space, found.path, terms, WEIGHTS).cost
        assert found.optimum == pytest.approx(exact.cost, rel=1e-12)
        assert found.excess == pytest.approx(max(0.0, found.cost - exact.cost), abs=1e-9)
        if lookahead >= 59:
            assert found.cost == pytest.approx(exact.cost, rel=1e-12)


def test_more_lookahead_costs_less_on_the_whole():
    costs = dict.fromkeys((0, 5, 20, 60), 0.0)
    for seed in range(15):
        space, candidates, target = smooth_sentence(seed)
        for n in costs:
            costs[n] += search(space, candidates, target, WEIGHTS, lookahead=n).cost
    assert costs[0] > costs[5] > costs[60]
    assert costs[5] >= costs[20] >= costs[60] * (1 - 1e-12)


def test_decisions_come_as_soon_as_they_may_and_stay():
    space, candidates, target = smooth_sentence(3)
    stream = StreamingSearch(space, WEIGHTS, 7)
    given = []
    for t, (units, costs) in enumerate(zip(candidates, target, strict=True)):
        decided = stream.push(units, costs)
        assert len(decided) == (t >= 7)
        given += decided
    result = stream.finish()
    assert result.path[: len(given)].tolist() == given
    assert len(result.path) == len(candidates)


def test_decisions_depend_on_what_was_seen_only():
    space, candidates, target = smooth_sentence(4)
    whole = search(space, candidates, target, WEIGHTS, lookahead=6).path
    part = search(space, candidates[:40], target[:40], WEIGHTS, lookahead=6).path
    assert (whole[:34] == part[:34]).all()


def test_each_decision_goes_on_from_the_last():
    # Two far places, then a frame that makes the dearer the better: what was said stays said.
    space = SearchSpace(
        np.array([0, 1, 2, 3]), np.zeros(4), np.array([[0.0], [10.0], [0.0], [10.0]]),
        np.array([0, 1]), skip_costs(0.6, 5),
    )  # fmt: skip
    stream = StreamingSearch(space, Weights(1, 1, 1, 0.01), 0)
    assert stream.push(np.array([0, 1]), np.array([0.0, 1.0])) == [0]
    assert stream.push(np.array([2, 3]), np.array([5.0, 0.0])) == [2]
    result = stream.finish()
    assert result.cost == pytest.approx(5 + 0.01 * space.skip[-1])
    assert result.optimum == pytest.approx(1 + 0.01 * space.skip[-1])
    assert result.excess == pytest.approx(4)


def test_memory_does_not_grow_with_the_sentence():
    space, candidates, target = smooth_sentence(5)
    stream = StreamingSearch(space, WEIGHTS, 5)
    for _ in range(20):
        for units, costs in zip(candidates, target, strict=True):
            stream.push(units, costs)
            assert len(stream._window) <= 5
            assert len(stream._free._stretches) <= 8
    assert len(stream.finish().path) == 20 * len(candidates)


def test_progress_of_a_stream_ends_at_the_last_frame():
    space, candidates, target = smooth_sentence(6, 5)
    calls = []
    search(space, candidates, target, WEIGHTS, lambda i, n: calls.append((i, n)), lookahead=2)
    assert calls == [(1, 5), (2, 5), (3, 5), (4, 5), (5, 5)]


def test_streams_that_cannot_be():
    space, candidates, target = smooth_sentence(7)
    with pytest.raises(SelectionError, match="look-ahead"):
        StreamingSearch(space, WEIGHTS, -1)
    with pytest.raises(SelectionError, match="no frame"):
        StreamingSearch(space, WEIGHTS, 1).finish()
    stream = StreamingSearch(space, WEIGHTS, 1)
    stream.push(candidates[0], target[0])
    with pytest.raises(SelectionError, match="frame 1 has no candidate"):
        stream.push(np.zeros(0, int), np.zeros(0))
    with pytest.raises(SelectionError, match="frame 1 needs"):
        stream.push(candidates[1], np.full(len(candidates[1]), np.nan))
    # What could not be used has left nothing behind.
    stream.push(candidates[1], target[1])
    assert len(stream.finish().path) == 2
