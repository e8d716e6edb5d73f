"""Nothing that matters is left out: thousands of made-up databases, all pairs beside them."""

from __future__ import annotations

import math
import pickle
import threading

import numpy as np
import pytest

from database.cost_definition import skip_costs
from database.errors import SelectionError
from unitsel.costs import Weights
from unitsel.search import SearchResult, SearchSpace, priced, search
from unitsel.search.check import least_cost

SHAPES = ((1, 1, 3, 5), (3, 2, 1), (1,), (1, 1), (1, 1, 1, 2), (7,), (2, 6, 1), (4, 4, 4))


def made_up_space(rng, n, sizes, kind, p=5, beta3=0.6):
    """Units of some clips. `kind` says how like one another they are."""
    lengths = rng.integers(1, 30, n)
    sequence = np.repeat(np.arange(n), lengths)[:n]
    gaps = rng.choice([1, 1, 1, 1, 1, 2, 3, 7], n)
    frame = np.cumsum(gaps)
    width = sum(sizes)
    if kind == "same":
        features = np.ones((n, width))
    elif kind == "few":
        features = rng.integers(0, 2, (n, width))
    elif kind == "smooth":
        features = np.cumsum(rng.normal(size=(n, width)), axis=0) / 5
    elif kind == "tiny":
        features = rng.normal(size=(n, width)) * 1e-12
    elif kind == "huge":
        features = rng.normal(size=(n, width)) * 1e12
    else:
        features = rng.normal(size=(n, width))
    groups = np.concatenate([[0], np.cumsum(sizes)])
    return SearchSpace(sequence, frame, features.astype(np.float32), groups, skip_costs(beta3, p))


def made_up_graph(rng, space, n_frames):
    """Runs of frames with a list in common, as phones make them, and single odd lists."""
    n = len(space)
    lists = [np.sort(rng.choice(n, rng.integers(1, n + 1), replace=False)) for _ in range(3)]
    lists.append(np.sort(rng.choice(n, 1)))
    candidates = []
    while len(candidates) < n_frames:
        candidates += [lists[rng.integers(len(lists))]] * int(rng.integers(1, 5))
    candidates = candidates[:n_frames]
    kind = rng.integers(4)
    target = []
    for units in candidates:
        if kind == 0:
            cost = np.zeros(len(units))
        elif kind == 1:
            cost = rng.integers(0, 3, len(units)).astype(float)
        else:
            cost = rng.exponential(float(rng.choice([0.05, 1.0, 20.0])), len(units))
        target.append(cost)
    return candidates, target


def random_weights(rng):
    """Each weight may be 0, ordinary or far from the others."""
    while True:
        values = np.where(
            rng.random(4) < 0.15, 0.0, 10.0 ** rng.normal(0, rng.choice([0.5, 1, 3]), 4)
        )
        if values[0] > 0 or values[1] * max(values[2], values[3]) > 0:
            return Weights(*values.tolist())


def assert_exact(space, candidates, target, weights):
    result = search(space, candidates, target, weights)
    places = [
        int(np.searchsorted(c, u)) for c, u in zip(candidates, result.path.tolist(), strict=True)
    ]
    assert all(c[i] == u for c, i, u in zip(candidates, places, result.path.tolist(), strict=True))
    terms = np.array([t[i] for t, i in zip(target, places, strict=True)])
    price = priced(space, result.path, terms, weights)
    assert result.cost == price.cost
    least = least_cost(space, candidates, target, weights)
    assert result.cost == pytest.approx(least, rel=1e-9, abs=1e-12)
    assert result.optimum == pytest.approx(least, rel=1e-9, abs=1e-12)


@pytest.mark.parametrize("kind", ["plain", "few", "same", "smooth", "tiny", "huge"])
def test_small_databases(kind):
    for seed in range(340):
        rng = np.random.default_rng([seed, len(kind)])
        space = made_up_space(
            rng,
            int(rng.integers(1, 60)),
            SHAPES[rng.integers(len(SHAPES))],
            kind,
            p=int(rng.choice([2, 3, 5, 5, 12])),
            beta3=float(rng.choice([0.0, 0.6, 0.6])),
        )
        candidates, target = made_up_graph(rng, space, int(rng.integers(1, 9)))
        assert_exact(space, candidates, target, random_weights(rng))


@pytest.mark.parametrize("kind", ["plain", "few", "smooth"])
def test_databases_with_many_sources_and_lists_of_many_tiles(kind):
    for seed in range(30):
        rng = np.random.default_rng([seed, 1])
        space = made_up_space(rng, 700, SHAPES[seed % 4], kind)
        candidates, target = made_up_graph(rng, space, 6)
        jump = float(rng.choice([0, 0.02, 0.2, 1, 5]))
        spread = float(rng.choice([0.01, 0.1, 0.4]))
        target = [t * spread for t in target]
        assert_exact(space, candidates, target, Weights(1, 1, 1, jump / space.skip[-1]))


def test_smooth_target_costs_over_long_runs():
    # As in speech: what is cheap stays cheap for a while, and paths live long.
    for seed in range(20):
        rng = np.random.default_rng([seed, 2])
        space = made_up_space(rng, 300, (1, 1, 3, 5), "smooth")
        everything = np.arange(300)
        half = np.sort(rng.choice(300, 150, replace=False))
        candidates = [everything] * 12 + [half] * 9 + [everything[::2]] * 9
        walk = np.cumsum(rng.normal(size=(30, 300)), axis=0)
        target = [np.abs(walk[t, c]) * 0.1 for t, c in enumerate(candidates)]
        for jump in (0.0, 0.05, 0.5, 5.0):
            assert_exact(space, candidates, target, Weights(1, 1, 1, jump / space.skip[-1]))


@pytest.mark.parametrize(
    "weights",
    [
        Weights(1, 1, 1e25, 1e25),
        Weights(1e-25, 1, 1e-25, 1e-25),
        Weights(1e20, 1, 1, 1),
        Weights(1, 1e-30, 1, 1),
        Weights(0, 1, 1e-30, 0),
        Weights(1, 1, 1e20, 1e-20),
        Weights(1, 1, 1e-20, 1e20),
    ],
)
def test_weights_far_apart(weights):
    for seed in range(10):
        rng = np.random.default_rng([seed, 3])
        space = made_up_space(rng, 80, (1, 1, 3, 5), "plain")
        candidates, target = made_up_graph(rng, space, 8)
        result = search(space, candidates, target, weights)
        assert result.cost == pytest.approx(
            least_cost(space, candidates, target, weights), rel=1e-9
        )


def test_target_costs_with_a_great_offset():
    rng = np.random.default_rng(5)
    space = made_up_space(rng, 200, (1, 1, 3, 5), "smooth")
    target = [1e6 + rng.normal(size=200) for _ in range(10)]
    assert_exact(space, [np.arange(200)] * 10, target, Weights(1, 1, 1, 0.05))


def test_certificate_and_check():
    rng = np.random.default_rng(6)
    space = made_up_space(rng, 120, (1, 1, 3, 5), "smooth")
    candidates, target = made_up_graph(rng, space, 12)
    found = search(space, candidates, target, Weights(1, 1, 1, 0.05), verify=True)
    assert found.optimum == pytest.approx(found.cost, rel=1e-12)
    assert found.checked == pytest.approx(found.cost, rel=1e-12)
    assert found.relative_excess < 1e-12
    assert search(space, candidates, target, Weights()).checked is None


def test_excess_of_a_path_that_is_not_the_cheapest():
    nothing = np.zeros(0)
    result = SearchResult(np.zeros(1, np.int64), 3.0, np.zeros(1), nothing, nothing, optimum=2.0)
    assert (result.excess, result.relative_excess) == (1.0, 0.5)
    free = SearchResult(np.zeros(1, np.int64), 3.0, np.zeros(1), nothing, nothing, optimum=0.0)
    assert free.relative_excess == math.inf


def test_check_that_finds_another_cost_is_an_error(monkeypatch):
    rng = np.random.default_rng(7)
    space = made_up_space(rng, 20, (2,), "plain")
    monkeypatch.setattr("unitsel.search.viterbi.least_cost", lambda *_: 0.5)
    with pytest.raises(SelectionError, match="looking at every pair"):
        search(space, [np.arange(20)] * 3, [np.ones(20)] * 3, Weights(), verify=True)


def test_lists_that_change_are_seen():
    # The same array with other units in it is another list.
    rng = np.random.default_rng(8)
    space = made_up_space(rng, 50, (3,), "plain")
    units = np.arange(10)
    target = [np.zeros(10)] * 3
    first = search(space, [units] * 3, target, Weights())
    units += 30
    second = search(space, [units] * 3, target, Weights())
    assert first.path.max() < 10 and second.path.min() >= 30


def test_many_lists_are_forgotten_again():
    rng = np.random.default_rng(9)
    space = made_up_space(rng, 30, (3,), "plain")
    for _ in range(100):
        candidates, target = made_up_graph(rng, space, 4)
        search(space, candidates, target, Weights())
    kept = space._ready.lists.values()
    assert sum(map(len, kept)) <= 8 * len(space)


def test_space_goes_to_another_process_without_what_is_ready():
    rng = np.random.default_rng(10)
    space = made_up_space(rng, 200, (3,), "plain")
    bare = len(pickle.dumps(space))
    candidates, target = made_up_graph(rng, space, 6)
    found = search(space, candidates, target, Weights())
    sent = pickle.dumps(space)
    assert len(sent) == bare
    again = search(pickle.loads(sent), candidates, target, Weights())
    assert (again.path == found.path).all()


def test_threads_share_a_space():
    rng = np.random.default_rng(11)
    space = made_up_space(rng, 300, (1, 1, 3, 5), "smooth")
    graphs = [made_up_graph(rng, space, 10) for _ in range(8)]
    alone = [search(space, *graph, Weights()).cost for graph in graphs]
    together: dict[int, float] = {}

    def work(i):
        together[i] = search(space, *graphs[i % 8], Weights()).cost

    threads = [threading.Thread(target=work, args=(i,)) for i in range(16)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert [together[i] for i in range(16)] == alone * 2


@pytest.mark.parametrize(
    ("skip", "word"),
    [
        ([1.0], "2 or more"),
        ([1.0, np.inf], "finite"),
        ([-1.0, 1.0], "below 0"),
        ([2.0, 1.0], "last"),
    ],
)
def test_skip_costs_that_cannot_be_searched_with(skip, word):
    with pytest.raises(SelectionError, match=word):
        SearchSpace(np.zeros(2), np.arange(2), np.zeros((2, 1)), np.array([0, 1]), np.array(skip))
