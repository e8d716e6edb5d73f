"""Costs against hand-made cases, from the shared definitions to the weights."""

from __future__ import annotations

import itertools
import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from analysis.cost_model import fit_cost_model
from analysis.phoneme_distance import articulatory_distances, phoneme_distances
from database.cost_definition import (
    CostSettings,
    FeatureWeights,
    context_weights,
    feature_groups,
    skip_costs,
    visual_features,
)
from database.errors import CorpusError, SelectionError
from database.phonemes import N_PHONEMES, PHONEME_INDEX, SILENCE, VISEME_OF
from database.schema import CostModel, Units
from database.track import context_frames, context_windows
from unitsel.costs import Weights, target_costs

IY, AA, P, H, HH, NG, K, G = (
    PHONEME_INDEX[p] for p in ("iy", "aa", "p", "h", "hh", "ng", "k", "g")
)


def make_units(rng, n, phoneme=None, k=12):
    phoneme = rng.integers(0, N_PHONEMES, n) if phoneme is None else np.asarray(phoneme)
    return Units(
        sequence=np.zeros(n, np.int32),
        frame=np.arange(n, dtype=np.int32),
        phoneme=phoneme.astype(np.uint8),
        viseme=VISEME_OF[phoneme],
        pca=rng.normal(0, 20, (n, k)).astype(np.float32),
        mouth_width=rng.normal(50, 3, n).astype(np.float32),
        mouth_height=rng.normal(15, 4, n).astype(np.float32),
        inner_opening=rng.exponential(3, n).astype(np.float32),
        teeth=rng.uniform(0, 1, n).astype(np.float32),
        tongue=np.where(rng.uniform(size=n) < 0.03, rng.uniform(size=n), 0).astype(np.float32),
        rotation=np.zeros((n, 3), np.float32),
        translation=np.zeros((n, 3), np.float32),
    )


# Context and target cost


def test_context_weights_of_the_paper_at_50_fps():
    v = context_weights(10, 50, -0.3)
    assert v.sum() == pytest.approx(1)
    assert v[10] / v[9] == pytest.approx(math.exp(0.3))
    assert (v == v[::-1]).all()


def test_a_frame_at_25_fps_weighs_as_every_second_at_50():
    slow, fast = context_weights(5, 25, -0.3), context_weights(10, 50, -0.3)
    assert slow / slow[5] == pytest.approx((fast / fast[10])[::2])


def test_target_cost_by_hand():
    m = np.zeros((N_PHONEMES, N_PHONEMES))
    m[IY, AA] = m[AA, IY] = 4
    m[IY, SILENCE] = m[SILENCE, IY] = 2
    v = np.array([0.25, 0.5, 0.25])
    target = np.array([SILENCE, IY, IY], np.uint8)
    contexts = np.array(
        [[SILENCE, IY, IY], [SILENCE, AA, IY], [IY, IY, SILENCE], [AA, AA, AA]], np.uint8
    )
    # The last one: M(sil, aa) = 0, then twice M(iy, aa).
    assert target_costs(target, contexts, m, v) == pytest.approx([0, 2, 1, 3])
    chosen = target_costs(target, contexts, m, v, np.array([3, 1]))
    assert chosen == pytest.approx([3, 2])


@settings(max_examples=30, deadline=None)
@given(seed=st.integers(0, 2**32 - 1), n=st.integers(1, 10))
def test_target_cost_is_equation_1(seed, n):
    rng = np.random.default_rng(seed)
    m = rng.uniform(0, 3, (N_PHONEMES, N_PHONEMES)).astype(np.float32)
    target = rng.integers(0, N_PHONEMES, 2 * n + 1).astype(np.uint8)
    contexts = rng.integers(0, N_PHONEMES, (20, 2 * n + 1)).astype(np.uint8)
    fps = 50.0
    v = [math.exp(-0.3 * abs(i)) for i in range(-n, n + 1)]
    expected = [
        sum(v[i] * float(m[target[i], c[i]]) for i in range(2 * n + 1)) / sum(v) for c in contexts
    ]
    got = target_costs(target, contexts, m, context_weights(n, fps, -0.3))
    assert got == pytest.approx(expected)


# Skip cost and visual cost


def test_skip_costs_of_the_paper():
    expected = [math.exp(0.6), 0, math.exp(1.2), math.exp(1.8), math.exp(2.4), math.exp(3)]
    assert skip_costs(0.6, 5) == pytest.approx(expected)


def test_visual_cost_by_hand():
    units = make_units(np.random.default_rng(0), 2, k=2)
    zero = np.zeros(2, np.float32)
    units = Units(
        units.sequence, units.frame, units.phoneme, units.viseme,
        pca=np.array([[0, 0], [3, 4]], np.float32),
        mouth_width=np.array([50, 52], np.float32),
        mouth_height=np.array([10, 11], np.float32),
        inner_opening=np.array([0, 2], np.float32),
        teeth=np.array([0, 0.5], np.float32),
        tongue=zero, rotation=units.rotation, translation=units.translation,
    )  # fmt: skip
    eigenvalues = np.array([3.0, 1.0])
    distances = [np.linalg.norm(x[1] - x[0]) for x in feature_groups(units, eigenvalues)]
    pca = math.sqrt(0.75 * 9 + 0.25 * 16)
    assert distances == pytest.approx([pca, 3, 0.5, 0])
    model = CostModel(np.zeros((43, 43), np.float32), 1.0, np.array([2.0, 3.0, 0.25, 1.0]), 0.5)
    features, groups = visual_features(units, eigenvalues, model, FeatureWeights(2, 1, 0, 1))
    f = sum(
        float(np.linalg.norm(features[1, a:b] - features[0, a:b]))
        for a, b in itertools.pairwise(groups)
    )
    assert len(groups) == 4  # teeth have no weight
    assert f == pytest.approx((0.5 * pca / 2 + 0.25 * 3 / 3) / 0.5, rel=1e-6)


def test_only_ratios_of_feature_weights_count():
    units = make_units(np.random.default_rng(1), 5)
    model = CostModel(np.zeros((43, 43), np.float32), 1.0, np.ones(4), 1.0)
    a, _ = visual_features(units, np.ones(12), model, FeatureWeights(1, 2, 3, 4))
    b, _ = visual_features(units, np.ones(12), model, FeatureWeights(10, 20, 30, 40))
    assert a == pytest.approx(b)


@pytest.mark.parametrize(
    "values",
    [{"pca": -1}, {"lips": math.nan}, dict.fromkeys(("pca", "lips", "teeth", "tongue"), 0)],
)
def test_feature_weights_that_cannot_be_used(values):
    with pytest.raises(SelectionError, match="feature weights"):
        FeatureWeights(**values)


@pytest.mark.parametrize(
    "values", [{"beta1": math.inf}, {"beta3": -0.1}, {"p": 1}, {"components": 0}]
)
def test_settings_that_cannot_be_used(values):
    with pytest.raises(SelectionError, match=next(iter(values))):
        CostSettings(**values)


# M


def test_phoneme_distance_by_hand():
    # Two components, K = 2: gamma = e^0.1, e^0.
    phoneme = np.repeat([IY, AA], 6)
    pca = np.concatenate([np.tile([1.0, 2.0], (6, 1)), np.tile([4.0, 6.0], (6, 1))])
    pca[0] += 3
    pca[1] -= 3
    m = phoneme_distances(pca, phoneme, CostSettings(components=2))
    g = math.exp(0.1)
    assert m[IY, AA] == pytest.approx(math.sqrt(g**2 * 9 + 16) / (g + 1))


def test_components_beyond_k_do_not_count():
    rng = np.random.default_rng(0)
    phoneme = np.repeat(np.arange(N_PHONEMES), 6)
    pca = rng.normal(size=(len(phoneme), 14))
    other = pca.copy()
    other[:, 12:] = rng.normal(size=(len(phoneme), 2))
    assert (phoneme_distances(pca, phoneme) == phoneme_distances(other, phoneme)).all()


def regular(m):
    return (
        m.shape == (43, 43)
        and np.isfinite(m).all()
        and (m >= 0).all()
        and (m == m.T).all()
        and (np.diag(m) == 0).all()
    )


@settings(max_examples=30, deadline=None)
@given(
    seed=st.integers(0, 2**32 - 1),
    n=st.integers(0, 300),
    kinds=st.integers(1, N_PHONEMES),
    k=st.integers(1, 16),
)
def test_phoneme_distances_of_any_corpus_can_be_used(seed, n, kinds, k):
    rng = np.random.default_rng(seed)
    phoneme = rng.integers(0, kinds, n)
    assert regular(phoneme_distances(rng.normal(0, 30, (n, k)), phoneme))


def test_an_absent_phoneme_looks_as_its_twins():
    rng = np.random.default_rng(3)
    phoneme = np.repeat([p for p in range(N_PHONEMES) if p not in (H, NG)], 6)
    m = phoneme_distances(rng.normal(size=(len(phoneme), 12)), phoneme)
    assert regular(m)
    assert m[H, HH] == 0
    assert m[H, AA] == pytest.approx(m[HH, AA])
    # ng looks like the mean of k and g, so it lies no farther from either than they do.
    assert 0 < m[NG, K] == pytest.approx(m[K, G] / 2)


def test_filled_entries_have_the_scale_of_the_measured():
    # Pictures placed exactly as the articulation is, five times as large.
    d = articulatory_distances()
    w, v = np.linalg.eigh(-0.5 * (np.eye(43) - 1 / 43) @ d**2 @ (np.eye(43) - 1 / 43))
    pictures = v[:, -12:] * np.sqrt(np.maximum(w[-12:], 0)) * 5
    gamma = np.exp(0.1 * np.abs(np.arange(1, 13) - 12))
    pictures = pictures / gamma * gamma.sum()
    absent = [PHONEME_INDEX[p] for p in ("er", "oy", "uh")]
    present = np.repeat([p for p in range(43) if p not in absent], 6)
    m = phoneme_distances(pictures[present], present)
    assert m == pytest.approx(5 * d, rel=1e-4, abs=1e-5)


def test_rare_phonemes_are_not_measured():
    phoneme = np.concatenate([np.repeat([SILENCE, IY], 10), np.full(4, AA)])
    pca = np.zeros((24, 12))
    pca[10:20] = 1
    pca[20:] = 1000
    assert phoneme_distances(pca, phoneme).max() < 10
    assert phoneme_distances(pca, phoneme, min_frames=4).max() > 10


def test_articulation_puts_closures_apart_from_open_vowels():
    d = articulatory_distances()
    assert regular(d)
    assert d[P, AA] > d[P, PHONEME_INDEX["f"]] > d[P, PHONEME_INDEX["b"]] == 0
    assert d[PHONEME_INDEX["uw"], PHONEME_INDEX["w"]] < d[PHONEME_INDEX["uw"], IY]
    assert d[SILENCE, PHONEME_INDEX["m"]] < d[SILENCE, AA]


# The model of a corpus


def test_scales_make_the_medians_one():
    rng = np.random.default_rng(5)
    units = make_units(rng, 400, rng.integers(0, 8, 400))
    contexts = context_windows(units.phoneme, 5)
    eigenvalues = np.geomspace(400, 1, 12)
    model = fit_cost_model(units, contexts, eigenvalues, 25.0)
    v = context_weights(5, 25.0, -0.3)
    every = [
        target_costs(contexts[i], contexts, model.phoneme_distance, v)[np.arange(400) != i]
        for i in range(400)
    ]
    assert np.median(every) == pytest.approx(model.target_scale, rel=0.05)
    features, groups = visual_features(units, eigenvalues, model, FeatureWeights())
    total = np.zeros((400, 400))
    for a, b in itertools.pairwise(groups):
        total += np.linalg.norm(features[:, None, a:b] - features[None, :, a:b], axis=2)
    inside = (units.viseme[:, None] == units.viseme[None]) & ~np.eye(400, dtype=bool)
    assert np.median(total[inside]) == pytest.approx(1, rel=0.05)


def test_model_depends_on_the_seed_alone():
    units = make_units(np.random.default_rng(6), 200)
    contexts = context_windows(units.phoneme, 5)
    a, b = (fit_cost_model(units, contexts, np.ones(12), 25.0, seed=3) for _ in range(2))
    assert (a.phoneme_distance == b.phoneme_distance).all()
    assert (a.target_scale, a.visual_scale) == (b.target_scale, b.visual_scale)
    assert (a.feature_scales == b.feature_scales).all()


def test_a_tongue_that_rarely_shows_does_not_blow_up():
    units = make_units(np.random.default_rng(7), 500)
    model = fit_cost_model(units, context_windows(units.phoneme, 5), np.ones(12), 25.0)
    assert np.median(units.tongue) == 0
    assert model.feature_scales[3] > 0.1


@pytest.mark.parametrize("n", [1, 2, 3])
def test_tiny_and_still_corpora_have_scales_of_one(n):
    units = make_units(np.random.default_rng(8), 1, [IY])
    still = Units(**{k: np.repeat(v, n, axis=0) for k, v in vars(units).items()})
    model = fit_cost_model(still, np.full((n, 11), IY, np.uint8), np.zeros(12), 25.0)
    assert regular(model.phoneme_distance)
    assert (model.target_scale, model.visual_scale, *model.feature_scales) == (1,) * 6


def test_corpora_without_costs():
    rng = np.random.default_rng(9)
    with pytest.raises(CorpusError, match="no frame with a face"):
        fit_cost_model(make_units(rng, 0), np.zeros((0, 11), np.uint8), np.ones(12), 25.0)
    units = make_units(rng, 4)
    with pytest.raises(CorpusError, match="do not fit 4 units"):
        fit_cost_model(units, np.zeros((3, 11), np.uint8), np.ones(12), 25.0)
    units.teeth[2] = np.nan
    n = context_frames(25)
    with pytest.raises(CorpusError, match="teeth"):
        fit_cost_model(units, np.zeros((4, 2 * n + 1), np.uint8), np.ones(12), 25.0)


# Weights


@pytest.mark.parametrize(
    ("values", "word"),
    [
        ((math.nan, 1, 1, 1), "target must be finite"),
        ((1, math.inf, 1, 1), "concatenation must be finite"),
        ((1, 1, -0.1, 1), "visual must be finite and 0 or more"),
        ((1, 1, 1, "2"), "skip must be a number"),
        ((1, True, 1, 1), "concatenation must be a number"),
        ((0, 0, 0, 0), "all 0"),
        ((0, 0, 1, 1), "all 0"),
        ((0, 1, 0, 0), "all 0"),
        ((10**400, 1, 1, 1), "target must be finite"),
        ((1, 1e200, 1e200, 0), "not finite"),
    ],
)
def test_weights_that_cannot_be_used(values, word):
    with pytest.raises(SelectionError, match=word):
        Weights(*values)
