"""What selections are compared with."""

from __future__ import annotations

import numpy as np

from unitsel.likeness.references import nearest_units, phoneme_means, random_units, smoothed_means


def test_random_units_are_candidates_and_always_the_same() -> None:
    candidates = [np.array([4, 9]), np.array([7]), np.array([1, 2, 3])] * 20
    found = random_units(candidates)
    assert all(u in c for u, c in zip(found, candidates, strict=True))
    assert len(set(found[::3].tolist())) == 2
    assert np.array_equal(found, random_units(candidates))


def test_means_of_phonemes_and_of_all_where_there_is_none() -> None:
    values = np.array([[1.0, 10], [3, 30], [8, 80]])
    means = phoneme_means(values, np.array([5, 5, 0], dtype=np.uint8))
    assert means[5].tolist() == [2, 20] and means[0].tolist() == [8, 80]
    assert means[6].tolist() == [4, 40]


def test_means_are_smoothed_over_three_frames() -> None:
    means = np.zeros((43, 1))
    means[7] = 9
    spoken = np.array([0, 0, 7, 0, 0], dtype=np.uint8)
    assert smoothed_means(means, spoken, 25)[:, 0].tolist() == [0, 3, 3, 3, 0]


def test_nearest_units_are_those_of_a_plain_search() -> None:
    rng = np.random.default_rng(4)
    pca = rng.normal(300, 80, (700, 9)).astype(np.float32)
    wanted = rng.normal(300, 80, (600, 9)).astype(np.float32)
    allowed = np.flatnonzero(rng.random(700) < 0.6)
    found = nearest_units(pca, wanted, allowed)
    apart = np.linalg.norm(wanted[:, None].astype(float) - pca[None, allowed], axis=2)
    assert np.array_equal(found, allowed[apart.argmin(axis=1)])
