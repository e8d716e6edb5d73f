"""The search against a brute force that shares no code with it."""

from __future__ import annotations

import itertools
import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from database.cost_definition import skip_costs
from database.errors import SelectionError
from unitsel.costs import Weights
from unitsel.search import SearchSpace, priced, search

BETA3, P = 0.6, 5

WEIGHTS = [
    Weights(1, 1, 1, 0.1),
    Weights(1, 1, 1, 0.01),
    Weights(0.3, 2, 0.5, 0.05),
    Weights(1, 1, 0, 0.1),
    Weights(1, 1, 1, 0),
    Weights(0, 1, 1, 0.05),
    Weights(0, 1, 1, 0),
    Weights(0, 1, 0, 1),
    Weights(1, 0, 1, 1),
    Weights(0.02, 1, 1, 0.001),
]


def make_space(rng, n_units, sizes=(3, 2, 1), ties=False):
    """Units in sequences of random lengths, with gaps in the frame numbers."""
    sequence, frame = [], []
    for s in range(10_000):
        length = int(rng.integers(1, 9))
        frame += list(rng.integers(0, 5) + np.cumsum(rng.choice([1, 1, 1, 1, 2, 3, 6], length)))
        sequence += [s] * length
        if len(sequence) >= n_units:
            break
    shape = (n_units, sum(sizes))
    features = rng.integers(0, 3, shape) if ties else rng.normal(size=shape)
    groups = np.concatenate([[0], np.cumsum(sizes)])
    return SearchSpace(
        np.array(sequence[:n_units]),
        np.array(frame[:n_units]),
        features.astype(np.float32),
        groups,
        skip_costs(BETA3, P),
    )


def make_graph(rng, space, n_frames, most, ties=False):
    candidates, target = [], []
    for _ in range(n_frames):
        m = int(rng.integers(1, most + 1))
        candidates.append(np.sort(rng.choice(len(space), min(m, len(space)), replace=False)))
        m = len(candidates[-1])
        target.append(rng.integers(0, 3, m).astype(float) if ties else rng.exponential(1.0, m))
    return candidates, target


def step_cost(space, a, b, weights):
    """Write f and g down once more from equations 7 and 8, in plain Python."""
    f = 0.0
    for start, end in itertools.pairwise(space.groups.tolist()):
        f += math.dist(space.features[a, start:end].tolist(), space.features[b, start:end].tolist())
    difference = int(space.frame[b]) - int(space.frame[a])
    if space.sequence[a] != space.sequence[b] or difference < 0 or difference >= P:
        g = math.exp(BETA3 * P)
    elif difference == 1:
        g = 0.0
    elif difference == 0:
        g = math.exp(BETA3 * 1)
    else:
        g = math.exp(BETA3 * difference)
    return weights.concatenation * (weights.visual * f + weights.skip * g)


def path_cost(space, path, targets, weights):
    cost = sum(weights.target * t for t in targets)
    return cost + sum(step_cost(space, a, b, weights) for a, b in itertools.pairwise(path))


def enumerate_paths(space, candidates, target, weights):
    """Cost of every path, cheapest first."""
    places = itertools.product(*(range(len(c)) for c in candidates))
    found = []
    for place in places:
        path = [int(c[i]) for c, i in zip(candidates, place, strict=True)]
        terms = [float(c[i]) for c, i in zip(target, place, strict=True)]
        found.append((path_cost(space, path, terms, weights), path))
    return sorted(found)


def all_pairs(space, candidates, target, weights):
    """Least cost by dynamic programming over all pairs."""
    cost = [weights.target * c for c in target[0]]
    for t in range(1, len(candidates)):
        cost = [
            min(cost[i] + step_cost(space, a, b, weights) for i, a in enumerate(candidates[t - 1]))
            + weights.target * target[t][j]
            for j, b in enumerate(candidates[t])
        ]
    return min(cost)


def check(space, candidates, target, weights, result):
    """Whether a result is a path of the graph and costs what it says."""
    assert result.path.shape == (len(candidates),)
    for t, u in enumerate(result.path):
        (place,) = np.flatnonzero(candidates[t] == u)
        assert result.target[t] == target[t][place]
    assert result.cost == pytest.approx(
        path_cost(space, result.path.tolist(), result.target, weights), rel=1e-9, abs=1e-9
    )
    weighed = weights.target * result.target.sum() + weights.concatenation * (
        weights.visual * result.visual.sum() + weights.skip * result.skip.sum()
    )
    assert result.cost == pytest.approx(weighed, rel=1e-9, abs=1e-12)


@pytest.mark.parametrize("ties", [False, True])
@pytest.mark.parametrize("weights", WEIGHTS)
def test_tiny_graphs_against_every_path(weights, ties):
    unique = 0
    for seed in range(30):
        rng = np.random.default_rng(seed)
        space = make_space(rng, int(rng.integers(3, 14)), ties=ties)
        candidates, target = make_graph(rng, space, int(rng.integers(1, 6)), 5, ties)
        result = search(space, candidates, target, weights)
        check(space, candidates, target, weights, result)
        paths = enumerate_paths(space, candidates, target, weights)
        assert result.cost == pytest.approx(paths[0][0], rel=1e-9, abs=1e-9)
        if len(paths) == 1 or paths[1][0] - paths[0][0] > 1e-6:
            unique += 1
            assert result.path.tolist() == paths[0][1]
    assert ties or unique > 5 or weights.target == 0


@pytest.mark.parametrize("weights", WEIGHTS)
def test_small_graphs_against_all_pairs(weights):
    for seed in range(18):
        rng = np.random.default_rng(100 + seed)
        ties = seed % 3 == 0
        # On a line, sources come between others and their targets, so dominance decides much.
        sizes = [(3, 2, 1), (1,), (1, 1)][seed % 3 if seed < 9 else seed % 2 + 1]
        space = make_space(rng, 40, sizes, ties)
        candidates, target = make_graph(rng, space, 7, 25, ties)
        result = search(space, candidates, target, weights)
        check(space, candidates, target, weights, result)
        least = all_pairs(space, candidates, target, weights)
        assert result.cost == pytest.approx(least, rel=1e-9, abs=1e-9)


def all_pairs_matrix(space, candidates, target, weights):
    """Do the same in numpy, for sizes at which every shortcut of the search is taken."""
    cost = weights.target * target[0]
    for before, after, own in zip(candidates, candidates[1:], target[1:], strict=False):
        total = np.zeros((len(before), len(after)))
        for start, end in itertools.pairwise(space.groups):
            x = space.features[:, start:end].astype(float)
            total += np.sqrt(((x[before][:, None] - x[after][None]) ** 2).sum(axis=2))
        d = space.frame[after][None].astype(int) - space.frame[before][:, None]
        same = space.sequence[after][None] == space.sequence[before][:, None]
        g = np.full(total.shape, math.exp(BETA3 * P))
        for i in range(P):
            g[same & (d == i)] = [math.exp(BETA3), 0.0, *(math.exp(BETA3 * k) for k in (2, 3, 4))][
                i
            ]
        step = weights.concatenation * (weights.visual * total + weights.skip * g)
        cost = (cost[:, None] + step).min(axis=0) + weights.target * own
    return cost.min()


@pytest.mark.parametrize("weights", WEIGHTS)
@pytest.mark.parametrize("flat", [False, True])
def test_frames_with_hundreds_of_candidates(weights, flat):
    # Flat target costs, as in silence, leave many sources undominated.
    rng = np.random.default_rng(7)
    space = make_space(rng, 400, sizes=(4, 3, 1, 1))
    everything = np.arange(400)
    few = np.sort(rng.choice(400, 30, replace=False))
    candidates = [everything, everything, few, few, everything, everything[::2]]
    target = [np.full(len(c), 0.5) if flat else rng.normal(1, 0.2, len(c)) for c in candidates]
    result = search(space, candidates, target, weights)
    check(space, candidates, target, weights, result)
    least = all_pairs_matrix(space, candidates, target, weights)
    assert result.cost == pytest.approx(least, rel=1e-9, abs=1e-9)


weight = st.one_of(st.just(0.0), st.floats(1e-6, 100.0))


@settings(max_examples=150, deadline=None)
@given(
    seed=st.integers(0, 2**32 - 1),
    values=st.tuples(weight, weight, weight, weight).filter(
        lambda w: w[0] > 0 or w[1] * max(w[2], w[3]) > 0
    ),
    n_units=st.integers(1, 25),
    n_frames=st.integers(1, 6),
    ties=st.booleans(),
)
def test_any_weights_give_the_least_cost(seed, values, n_units, n_frames, ties):
    rng = np.random.default_rng(seed)
    weights = Weights(*values)
    space = make_space(rng, n_units, ties=ties)
    candidates, target = make_graph(rng, space, n_frames, 12, ties)
    result = search(space, candidates, target, weights)
    check(space, candidates, target, weights, result)
    least = all_pairs(space, candidates, target, weights)
    assert result.cost == pytest.approx(least, rel=1e-9, abs=1e-9)


def one_sequence(n, features=None):
    features = np.zeros((n, 1)) if features is None else features
    return SearchSpace(
        np.zeros(n), np.arange(n), np.asarray(features), np.array([0, 1]), skip_costs(BETA3, P)
    )


def test_steps_cost_what_equation_8_says():
    w = [math.exp(0.6 * i) for i in range(6)]
    space = SearchSpace(
        np.array([0, 0, 0, 0, 0, 0, 0, 1]),
        np.array([0, 1, 2, 3, 4, 5, 8, 1]),
        np.zeros((8, 1)),
        np.array([0, 1]),
        skip_costs(0.6, 5),
    )
    before = np.array([0, 0, 0, 0, 0, 0, 0, 0, 3, 5])
    after = np.array([0, 1, 2, 3, 4, 5, 6, 7, 2, 6])
    expected = [w[1], 0, w[2], w[3], w[4], w[5], w[5], w[5], w[5], w[3]]
    assert space.skip_costs(before, after) == pytest.approx(expected)


@pytest.mark.parametrize("difference", range(-2, 8))
def test_search_knows_the_price_of_every_step(difference):
    # From unit 10 to one `difference` further on, or to another clip at a target cost that
    # makes it a little dearer, then a little cheaper.
    sequence = np.concatenate([np.zeros(20), np.ones(3)])
    frame = np.concatenate([np.arange(20), np.arange(3)])
    space = SearchSpace(sequence, frame, np.zeros((23, 1)), np.array([0, 1]), skip_costs(BETA3, P))
    g = skip_costs(BETA3, P)
    advantage = g[P] - (g[difference] if 0 <= difference < P else g[P])
    candidates = [np.array([10]), np.array([10 + difference, 21])]
    for margin, expected in ((-0.01, 10 + difference), (0.01, 21)):
        target = [np.zeros(1), np.array([1 + advantage + margin, 1.0])]
        assert search(space, candidates, target, Weights(1, 1, 1, 1)).path[1] == expected


@pytest.mark.parametrize(("ahead", "source"), [(0.9, 1), (1.1, 0)])
def test_a_dearer_source_counts_until_it_is_dominated(ahead, source):
    # Sources at 0 and 1 on a line, the second dearer by `ahead`, and a target at 2.
    space = SearchSpace(
        np.arange(3), np.zeros(3), np.array([[0.0], [1.0], [2.0]]), np.array([0, 1]),
        skip_costs(BETA3, P),
    )  # fmt: skip
    result = search(
        space,
        [np.array([0, 1]), np.array([2])],
        [np.array([0.0, ahead]), np.zeros(1)],
        Weights(1, 1, 1, 0.1),
    )
    assert result.path.tolist() == [source, 2]


def test_natural_run_wins_a_tie():
    # Nothing distinguishes the units but their order, so the recorded run is the cheapest,
    # and among equal runs the first.
    space = one_sequence(8)
    everything = np.arange(8)
    result = search(space, [everything] * 4, [np.zeros(8)] * 4, Weights(1, 1, 1, 1))
    assert result.path.tolist() == [0, 1, 2, 3]
    assert result.cost == 0
    free = search(space, [everything] * 4, [np.zeros(8)] * 4, Weights(1, 1, 1, 0))
    assert free.path.tolist() == [0, 0, 0, 0]


def test_visual_weight_and_skip_weight_share_the_concatenation_weight():
    space = one_sequence(3, [[0.0], [2.0], [5.0]])
    path = np.array([0, 2, 2])
    price = priced(space, path, np.array([1.0, 1.0, 1.0]), Weights(2, 3, 5, 7))
    w1, w2 = math.exp(0.6), math.exp(1.2)
    assert price.visual == pytest.approx([5, 0])
    assert price.skip == pytest.approx([w2, w1])
    assert price.cost == pytest.approx(2 * 3 + 3 * (5 * 5 + 7 * (w1 + w2)))


def test_same_input_gives_the_same_path():
    rng = np.random.default_rng(0)
    space = make_space(rng, 200, ties=True)
    candidates = [np.arange(200)] * 5
    target = [rng.integers(0, 3, 200).astype(float) for _ in range(5)]
    paths = [search(space, candidates, target, Weights()).path.tolist() for _ in range(2)]
    assert paths[0] == paths[1]


def test_progress_ends_at_the_last_frame():
    calls = []
    space = one_sequence(3)
    search(
        space, [np.arange(3)] * 4, [np.zeros(3)] * 4, Weights(), lambda i, n: calls.append((i, n))
    )
    assert calls == [(1, 4), (2, 4), (3, 4), (4, 4)]


@pytest.mark.parametrize(
    ("candidates", "target", "word"),
    [
        ([], [], "at least 1"),
        ([[0]], [[0.0], [0.0]], "same number"),
        ([[0], []], [[0.0], []], "frame 1 has no candidate"),
        ([[0, 3]], [[0.0, 0.0]], "0..2"),
        ([[-1, 2]], [[0.0, 0.0]], "0..2"),
        ([[1, 1]], [[0.0, 0.0]], "ascend"),
        ([[2, 1]], [[0.0, 0.0]], "ascend"),
        ([[0, 1]], [[0.0, np.nan]], "finite"),
        ([[0], [0, 1]], [[0.0], [0.0]], "frame 1 needs 2"),
    ],
)
def test_graphs_that_cannot_be_searched(candidates, target, word):
    arrays = [np.array(c, dtype=int) for c in candidates]
    with pytest.raises(SelectionError, match=word):
        search(one_sequence(3), arrays, [np.array(c, dtype=float) for c in target], Weights())


@pytest.mark.parametrize(
    ("sequence", "frame", "features", "word"),
    [
        ([], [], np.zeros((0, 1)), "no unit"),
        ([0, 0], [1, 1], np.zeros((2, 1)), "order"),
        ([0, 0], [2, 1], np.zeros((2, 1)), "order"),
        ([0, 1, 0], [0, 0, 1], np.zeros((3, 1)), "order"),
        ([0, 0], [0, 1], np.array([[0.0], [np.nan]]), "unit 1"),
        ([0, 0], [0, 1], np.zeros((3, 1)), "number"),
    ],
)
def test_units_that_cannot_be_searched(sequence, frame, features, word):
    with pytest.raises(SelectionError, match=word):
        SearchSpace(
            np.array(sequence), np.array(frame), features, np.array([0, 1]), skip_costs(BETA3, P)
        )
