"""Lighting taken out, and principal components of what is left."""

import cv2
import numpy as np
import pytest

from analysis.texture import (
    REDUCED_HEIGHT,
    REDUCED_WIDTH,
    TextureSettings,
    describe_clip,
    fit_texture,
    lighting_of,
    mean_log,
    mouth_window,
    normalise,
    reduce_crop,
    texture_weights,
)

FRAMES = 40
LIGHT = np.array([[-0.65, 0.20, -0.10], [-0.60, 0.15, -0.05], [-0.45, 0.10, 0.10]])
"""Log gain of red, green and blue: constant, across, down (over half the crop)."""


def openings(seed=0):
    t = np.arange(FRAMES) / 25
    return 0.5 - 0.5 * np.cos(2 * np.pi * (1.3 + 0.2 * seed) * t)


@pytest.fixture(scope="module")
def crops(puppet):
    """A clip of the puppet's mouth, (n, 158, 150, 3), no head motion."""
    rounding = np.linspace(0, 1, FRAMES)
    faces = [puppet.draw(o, r) for o, r in zip(openings(), rounding, strict=True)]
    return np.stack([f[209:367, 193:343] for f in faces])


@pytest.fixture(scope="module")
def clip(crops):
    return np.stack([reduce_crop(c) for c in crops])


@pytest.fixture(scope="module")
def lit(crops):
    """The same clip in other light, as a camera would see it."""
    h, w = crops.shape[1:3]
    v, u = np.mgrid[-1 : 1 : h * 1j, -1 : 1 : w * 1j]
    gain = np.exp(np.stack([np.ones_like(u), u, v], axis=-1) @ LIGHT.T)
    return np.stack(
        [reduce_crop(np.clip(np.round(c * gain), 0, 255).astype(np.uint8)) for c in crops]
    )


@pytest.fixture(scope="module")
def model(clip):
    reference = mean_log(clip)
    normalised = normalise(clip, lighting_of(reference, reference))
    heights = openings().astype(np.float32)
    return fit_texture(normalised, heights, reference, TextureSettings(components=12))


def test_crops_are_reduced(crops):
    small = reduce_crop(crops[0])
    assert small.shape == (REDUCED_HEIGHT, REDUCED_WIDTH, 3) and small.dtype == np.uint8
    np.testing.assert_allclose(small.mean(axis=(0, 1)), crops[0].mean(axis=(0, 1)), atol=1.0)


def test_the_reference_has_no_lighting(clip):
    mean = mean_log(clip)
    lighting = lighting_of(mean, mean)
    assert lighting.shape == (3, 3)
    np.testing.assert_allclose(lighting, 0, atol=1e-5)
    np.testing.assert_allclose(normalise(clip, lighting), clip, atol=0.01)


def test_known_lighting_is_found(clip, lit):
    found = lighting_of(mean_log(lit), mean_log(clip))
    # Levels are lifted by a few before the logarithm, so dark channels show a little less.
    np.testing.assert_allclose(found, LIGHT, atol=0.07)


def test_gain_and_slope_are_taken_out(clip, lit, model):
    plain = describe_clip(clip, model)
    with_rule = describe_clip(lit, model)
    without = texture_weights(lit.astype(np.float32), model)
    spread = np.linalg.norm(plain - plain.mean(axis=0), axis=1).mean()
    changed = np.linalg.norm(with_rule - plain, axis=1).mean()
    unrepaired = np.linalg.norm(without - plain, axis=1).mean()
    assert unrepaired > 0.7 * spread, "this light would matter"
    assert changed < 0.2 * spread
    assert changed < 0.1 * unrepaired
    assert np.corrcoef(with_rule[:, 0], plain[:, 0])[0, 1] > 0.999


def test_speech_is_not_taken_for_lighting(clip):
    """The rule looks at skin, so an open mouth is hardly darker than a closed one."""
    closed, opened = mean_log(clip[openings() < 0.2]), mean_log(clip[openings() > 0.8])
    taken = np.abs(lighting_of(opened, closed)[:, 0])
    mouth = np.repeat(mouth_window()[..., None] ** 8, 3, axis=2)
    darker = np.average(closed - opened, axis=(0, 1), weights=mouth)
    assert (taken < 0.15).all()
    assert (taken < 0.3 * darker).all()


def test_fit_and_describe_agree(clip, model):
    weights = describe_clip(clip, model)
    assert weights.shape == (FRAMES, 12) and weights.dtype == np.float32
    np.testing.assert_allclose(weights.mean(axis=0), 0, atol=0.05 * weights[:, 0].std())
    np.testing.assert_allclose(weights.var(axis=0, ddof=1), model.eigenvalues, rtol=0.02)
    gram = model.components @ model.components.T
    np.testing.assert_allclose(gram, np.eye(12), atol=1e-4)
    assert (np.diff(model.eigenvalues) <= 0).all()
    # Mean and weights give the windowed picture back.
    values = (clip * np.sqrt(model.window)[..., None]).reshape(FRAMES, -1)
    rebuilt = model.mean + weights @ model.components
    lost = np.square(values - rebuilt).sum() / np.square(values - values.mean(axis=0)).sum()
    assert lost < 0.02


def test_weights_grow_with_the_mouth(clip, model):
    heights = openings() - openings().mean()
    weights = describe_clip(clip, model)
    assert (weights.T @ heights >= -1e-3 * np.abs(weights).sum(axis=0)).all()
    assert np.corrcoef(weights[:, 0], heights)[0, 1] > 0.9
    reference = mean_log(clip)
    turned = fit_texture(
        clip.astype(np.float32), (-heights).astype(np.float32), reference, TextureSettings(12)
    )
    assert np.corrcoef(describe_clip(clip, turned)[:, 0], heights)[0, 1] < -0.9


def test_the_same_seed_gives_the_same_model(clip, model):
    reference = mean_log(clip)
    lighting = lighting_of(reference, reference)
    heights = openings().astype(np.float32)

    def fit(seed):
        settings = TextureSettings(components=12, seed=seed)
        return fit_texture(normalise(clip, lighting), heights, reference, settings)

    np.testing.assert_array_equal(fit(0).components, model.components)
    np.testing.assert_array_equal(fit(0).eigenvalues, model.eigenvalues)
    # Another seed finds the same leading component, sign included.
    assert np.dot(fit(7).components[0], model.components[0]) > 0.999


@pytest.mark.parametrize("n", [2, 5])
def test_few_frames_give_few_components(clip, n):
    model = fit_texture(
        clip[:n].astype(np.float32), openings()[:n].astype(np.float32), mean_log(clip[:n])
    )
    assert model.components.shape == (n - 1, REDUCED_WIDTH * REDUCED_HEIGHT * 3)
    assert describe_clip(clip, model).shape == (FRAMES, n - 1)


def test_the_window_holds_mouth_and_chin_but_no_edge():
    window = mouth_window()
    middle = window[REDUCED_HEIGHT // 2, REDUCED_WIDTH // 2]
    assert middle == window.max() == pytest.approx(1, abs=0.01)
    edge = np.concatenate([window[0], window[-1], window[:, 0], window[:, -1]])
    assert edge.max() < 0.02
    np.testing.assert_allclose(window, window[:, ::-1], atol=1e-6)


def test_pictures_themselves_are_not_changed(lit):
    before = lit.copy()
    normalise(lit, np.full((3, 3), 0.2, np.float32))
    np.testing.assert_array_equal(lit, before)


def test_noise_in_the_dark_does_not_count(crops, model):
    rng = np.random.default_rng(0)
    noisy = np.clip(crops + rng.normal(0, 3, crops.shape), 0, 255).astype(np.uint8)
    clean = describe_clip(np.stack([reduce_crop(c) for c in crops]), model)
    seen = describe_clip(np.stack([reduce_crop(c) for c in noisy]), model)
    spread = np.linalg.norm(clean - clean.mean(axis=0), axis=1).mean()
    assert np.linalg.norm(seen - clean, axis=1).mean() < 0.1 * spread
    assert cv2.PSNR(crops[0], noisy[0]) < 40
