"""The optimisation that training uses: fronts with known answers, and the grid of the weights."""

from __future__ import annotations

import itertools
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import settings as examples
from hypothesis import strategies as st

from database.cost_definition import CostSettings, FeatureWeights
from database.errors import SelectionError
from unitsel.costs import Weights
from unitsel.settings import SelectionSettings, TargetSettings
from unitsel.training.pareto import Box, ParetoSettings, evolve, non_dominated
from unitsel.training.weight_space import WeightSpace

BOX = Box(np.array([-2.0, -2.0]), np.array([2.0, 2.0]), np.array([0.01, 0.01]))


def three_corners(sets: np.ndarray) -> np.ndarray:
    """Distances to three corners: the front is the triangle between them."""
    corners = np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]])
    return np.linalg.norm(sets[:, None] - corners, axis=2)


def test_front_by_hand() -> None:
    objectives = np.array(
        [[1, 5, 0], [2, 2, 0], [3, 3, 0], [5, 1, 0], [2, 2, 0], [9, 9, -1]], dtype=float
    )
    # The third is beaten by the second, the fifth is the second again.
    assert non_dominated(objectives).tolist() == [0, 1, 3, 5]


@examples(max_examples=50, deadline=None)
@given(seed=st.integers(0, 2**32 - 1), n=st.integers(1, 40))
def test_front_is_what_nobody_beats(seed: int, n: int) -> None:
    objectives = np.random.default_rng(seed).integers(0, 5, (n, 3)).astype(float)
    front = non_dominated(objectives)
    for i in range(n):
        beaten = ((objectives <= objectives[i]).all(1) & (objectives < objectives[i]).any(1)).any()
        first = not (objectives[:i] == objectives[i]).all(1).any()
        assert (i in front) == (not beaten and first)


def test_snapping_is_onto_the_lattice_and_into_the_box() -> None:
    box = Box(np.array([-1.0, 0.0]), np.array([1.0, 10.0]), np.array([0.1, 1.0]))
    snapped = box.snap(np.array([[0.13, 4.4], [-7.0, 11.0]]))
    assert snapped.tolist() == [[0.1, 4.0], [-1.0, 10.0]]
    assert (box.snap(snapped) == snapped).all()


def test_two_numbers_stay_together_where_they_should() -> None:
    box = Box(np.array([-3.0, -3.0, 0.0]), np.array([1.0, 1.0, 9.0]), np.full(3, 0.1), apart=1.5)
    given = np.array([[0.5, -0.5, 7], [0.5, -2.5, 7], [-2.5, 0.5, 7], [9, -9, 7]])
    expected = np.array([[0.5, -0.5, 7], [-1.0, -2.5, 7], [-2.5, -1.0, 7], [-1.5, -3.0, 7]])
    assert box.snap(given) == pytest.approx(expected)
    assert (box.snap(box.snap(given)) == box.snap(given)).all()


def test_evolution_finds_the_triangle_and_says_when_it_is_stable() -> None:
    seen: list[np.ndarray] = []

    def objectives(sets: np.ndarray) -> np.ndarray:
        seen.append(sets)
        return three_corners(sets)

    start = BOX.snap(np.random.default_rng(0).uniform(-2, 2, (30, 2)))
    told: list[tuple[int, int]] = []
    found = evolve(objectives, start, BOX, progress=lambda *p: told.append(p))
    assert found.stable and found.generations == len(seen) - 1 < 100
    assert told == [(g, 100) for g in range(1, len(seen))]
    assert (seen[0] == start).all()
    assert (np.diff(found.hypervolumes) >= -1e-12).all()
    assert found.hypervolumes[-1] - found.hypervolumes[-11] <= 1e-3 * found.hypervolumes[-1]
    assert found.hypervolumes[-2] - found.hypervolumes[-12] > 1e-3 * found.hypervolumes[-2]
    every = np.concatenate(seen)
    front = every[non_dominated(three_corners(every))]
    assert len(front) > 100
    outside = np.maximum(-front.min(axis=1), front.sum(axis=1) - 1)
    assert outside.max() < 0.2 and np.quantile(outside, 0.95) < 0.03
    # Whatever was asked for lies on the lattice.
    assert (BOX.snap(every) == every).all()


def test_evolution_follows_from_its_seed() -> None:
    start = BOX.snap(np.random.default_rng(1).uniform(-2, 2, (30, 2)))

    def run(seed: int) -> tuple[list[np.ndarray], object]:
        seen: list[np.ndarray] = []
        found = evolve(
            lambda sets: (seen.append(sets), three_corners(sets))[1],
            start,
            BOX,
            ParetoSettings(population=12, generations=5, seed=seed),
        )
        return seen, found

    (first, a), (again, b), (other, _) = run(3), run(3), run(4)
    assert a == b
    assert all((x == y).all() for x, y in zip(first, again, strict=True))
    assert not all(x.shape == y.shape and (x == y).all() for x, y in zip(first, other, strict=True))


def test_evolution_ends_with_its_generations() -> None:
    start = BOX.snap(np.random.default_rng(1).uniform(-2, 2, (30, 2)))
    found = evolve(three_corners, start, BOX, ParetoSettings(generations=3))
    assert (found.generations, found.stable) == (3, False)
    assert len(found.hypervolumes) == 4


def test_evolution_of_what_never_changes() -> None:
    """A database of one sequence plays one path whatever the weights."""
    start = BOX.snap(np.random.default_rng(1).uniform(-2, 2, (30, 2)))
    found = evolve(lambda sets: np.ones((len(sets), 3)), start, BOX)
    assert found.stable and found.generations == 10


@pytest.mark.parametrize(
    "values",
    [{"population": 3}, {"generations": 0}, {"stable": 0}, {"seed": -1}, {"tolerance": np.nan}],
)
def test_pareto_settings_that_cannot_be_used(values: dict[str, float]) -> None:
    with pytest.raises(SelectionError, match=next(iter(values))):
        ParetoSettings(**values)


# The grid of the weights

SPACE = WeightSpace(SelectionSettings(), 25.0)
WIDE = WeightSpace(SelectionSettings(), 25.0, features=True)


def test_grid_is_ten_settings_of_four_weights_without_equivalents() -> None:
    settings = 10 ** ((np.arange(10) - 4.5) * 0.15)
    combinations = itertools.product(settings, settings, settings * 10**-1.25, settings * 10**-1.25)
    ratios = {
        (round(np.log10(wcc * wccf / wtc), 6), round(np.log10(wcc * wccg / wtc), 6))
        for wtc, wcc, wccf, wccg in combinations
    }
    grid = SPACE.grid()
    assert len(ratios) == len(grid) == 442
    expected = np.array(sorted(ratios))
    assert np.sort(grid.view("f8,f8").ravel()).view("f8").reshape(-1, 2) == pytest.approx(expected)


def test_numbers_stand_for_ratios() -> None:
    settings = SPACE.settings((-1.0, -2.0))
    assert settings == SelectionSettings(Weights(1, 1, 0.1, 0.01))
    # A common factor, and a factor between wcc and its two children, change nothing.
    same = SelectionSettings(Weights(3, 6, 0.05, 0.005))
    assert SPACE.numbers(same) == SPACE.numbers(settings) == (-1.0, -2.0)


def test_the_default_weights_are_a_set() -> None:
    for space in (SPACE, WIDE):
        assert space.settings(space.numbers(SelectionSettings())) == SelectionSettings()


def test_what_is_not_free_is_the_bases() -> None:
    base = SelectionSettings(
        Weights(), CostSettings(beta1=-0.7, p=6), TargetSettings("guided", 0.5)
    )
    settings = replace(SPACE, base=base).settings((-1.0, -2.0))
    assert (settings.costs, settings.target) == (base.costs, base.target)
    wide = replace(WIDE, base=base).settings((-1.0, -2.0, 1.0, 0.0, -2.0, -0.45, 3.0))
    assert wide.costs == CostSettings(
        beta1=-0.45, p=6, context=0.12, features=FeatureWeights(1, 2, 1, 0.25)
    )


def test_start_with_features_spreads_over_the_box() -> None:
    start = WIDE.start(0)
    assert start.shape[1] == len(WIDE.names) == 7
    assert len(start) > 600 and len(np.unique(start, axis=0)) == len(start)
    assert (WIDE.box.snap(start) == start).all()
    # The grid is in it, with the base's features.
    rows = {tuple(row) for row in start}
    assert all(tuple(row) in rows for row in WIDE.grid())
    assert (start == WIDE.start(0)).all()
    assert len(start) != len(WIDE.start(1)) or (start != WIDE.start(1)).any()
    others = start[start[:, 6] != 5]
    spread = (others.max(axis=0) - others.min(axis=0)) / (WIDE.box.upper - WIDE.box.lower)
    assert (spread > 0.85).all()
    for row in start[::50]:
        assert WIDE.numbers(WIDE.settings(row)) == pytest.approx(row, abs=1e-3)


@pytest.mark.parametrize("weights", [Weights(target=0), Weights(visual=0), Weights(skip=0)])
def test_weights_without_a_logarithm(weights: Weights) -> None:
    with pytest.raises(SelectionError, match="no ratio"):
        SPACE.numbers(SelectionSettings(weights))
