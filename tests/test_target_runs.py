"""Target costs by runs are those of equation 1."""

from __future__ import annotations

import numpy as np
import pytest

from database.cost_definition import context_weights
from database.phonemes import N_PHONEMES
from database.track import context_windows
from unitsel.costs import target_costs
from unitsel.target_runs import KEPT, ContextRuns, RunTargets


def speech(rng: np.random.Generator, frames: int, mean: float) -> np.ndarray:
    """Phonemes of some frames, each lasting a few."""
    phonemes = rng.integers(0, N_PHONEMES, frames)
    lengths = 1 + rng.poisson(mean, frames)
    return np.repeat(phonemes, lengths)[:frames].astype(np.uint8)


@pytest.mark.parametrize("beta1", [-0.3, 0.0, 0.2])
@pytest.mark.parametrize(("n", "fps", "mean"), [(5, 25.0, 2.0), (10, 50.0, 4.0), (1, 25.0, 0.0)])
def test_equal_to_frame_by_frame(n: int, fps: float, mean: float, beta1: float) -> None:
    rng = np.random.default_rng(n)
    contexts = context_windows(speech(rng, 400, mean), n)
    distance = rng.random((N_PHONEMES, N_PHONEMES)).astype(np.float32)
    weights = context_weights(n, fps, beta1)
    lists = [np.sort(rng.choice(400, size, replace=False)).astype(np.int32) for size in (1, 7, 90)]
    wanted = speech(rng, 60, mean)
    candidates = [lists[p % 3] for p in wanted]
    found = RunTargets(contexts, distance, weights).costs(wanted, candidates, 2.5)
    for window, units, costs in zip(context_windows(wanted, n), candidates, found, strict=True):
        slow = target_costs(window, contexts, distance, weights, units) / 2.5
        assert np.allclose(costs, slow, rtol=1e-12, atol=1e-12)


def test_runs_of_a_context() -> None:
    contexts = np.array([[3, 3, 7, 7, 7], [1, 1, 1, 1, 1], [2, 4, 4, 4, 2]], dtype=np.uint8)
    runs = ContextRuns.of(contexts)
    assert runs.row.tolist() == [1, 0, 2]
    assert runs.changes.tolist() == [0, 1, 2] and runs.units.tolist() == [1, 1, 1]
    place = [divmod(int(c), N_PHONEMES) for c in runs.codes]
    assert place == [(5, 1), (2, 3), (2, 7), (5, 7), (1, 2), (1, 4), (4, 4), (4, 2), (5, 2)]


def test_frames_that_want_the_same_share_their_costs() -> None:
    contexts = context_windows(np.zeros(30, np.uint8), 2)
    distance = np.ones((N_PHONEMES, N_PHONEMES), np.float32)
    units = np.arange(30, dtype=np.int32)
    found = RunTargets(contexts, distance, context_weights(2, 25.0, -0.3)).costs(
        np.zeros(9, np.uint8), [units] * 9
    )
    assert all(costs is found[0] for costs in found)


def test_many_lists_do_not_pile_up() -> None:
    """Nor is one taken for another that lay at the same place in memory."""
    rng = np.random.default_rng(1)
    contexts = context_windows(speech(rng, 100, 2), 2)
    distance = rng.random((N_PHONEMES, N_PHONEMES)).astype(np.float32)
    weights = context_weights(2, 25.0, -0.3)
    runs = RunTargets(contexts, distance, weights)
    for i in range(3 * KEPT):
        units = np.array([i % 100], dtype=np.int32)
        (cost,) = runs.costs(np.array([5], np.uint8), [units])
        slow = target_costs(np.array([0, 0, 5, 0, 0], np.uint8), contexts, distance, weights, units)
        assert cost == pytest.approx(slow)
    assert len(runs._runs) == KEPT
