"""Blending in planes, and the blend region."""

from dataclasses import replace

import numpy as np
import pytest

from database.errors import RenderError
from database.mask import Mask, MouthPatch
from database.planes import Colour, Planes, planes_to_rgb, rgb_to_planes
from render.blend import CHIN, NOSE_BASE, BlendShape, blend_alpha, ring_weights
from render.compose import composite
from render.scene import MouthLayer


def noise_planes(width=64, height=48):
    rng = np.random.default_rng(3)
    half = (height // 2, width // 2)
    return Planes(
        rng.integers(0, 256, (height, width), dtype=np.uint8),
        rng.integers(0, 256, half, dtype=np.uint8),
        rng.integers(0, 256, half, dtype=np.uint8),
    )


def layer_of(rgb, alpha, x0=10, y0=8):
    rgb = np.broadcast_to(np.asarray(rgb, np.float32), (*alpha.shape, 3))
    return MouthLayer(x0, y0, (rgb * alpha[..., None]).astype(np.float32), alpha)


def disc(size=24, radius=9.3):
    x, y = np.meshgrid(np.arange(size) - 11.5, np.arange(size) - 11.5)
    return np.clip((radius - np.hypot(x, y)) / 4, 0, 1).astype(np.float32)


def test_samples_without_alpha_are_the_backgrounds():
    planes, alpha = noise_planes(), disc()
    before = [plane.copy() for plane in (planes.y, planes.u, planes.v)]
    out = composite(planes, layer_of((200, 90, 80), alpha), Colour())
    outside = np.ones((48, 64), bool)
    outside[8:32, 10:34] = alpha == 0
    assert np.array_equal(out.y[outside], planes.y[outside])
    chroma_outside = outside.reshape(24, 2, 32, 2).all(axis=(1, 3))
    assert np.array_equal(out.u[chroma_outside], planes.u[chroma_outside])
    assert np.array_equal(out.v[chroma_outside], planes.v[chroma_outside])
    assert (out.y != planes.y).any()
    assert (out.u != planes.u).any()
    for old, new in zip(before, (planes.y, planes.u, planes.v), strict=True):
        assert np.array_equal(old, new)


@pytest.mark.parametrize("matrix", ["bt601", "bt709"])
@pytest.mark.parametrize("full", [False, True])
def test_where_alpha_is_one_the_layer_shows_in_the_streams_colour(matrix, full):
    colour = Colour(matrix, full)
    out = composite(noise_planes(), layer_of((200, 120, 90), np.ones((24, 24), np.float32)), colour)
    expected = rgb_to_planes(np.full((24, 24, 3), (200, 120, 90), np.uint8), colour)
    assert np.array_equal(out.y[8:32, 10:34], expected.y)
    assert np.array_equal(out.u[4:16, 5:17], expected.u)
    assert np.array_equal(out.v[4:16, 5:17], expected.v)
    rgb = planes_to_rgb(out, colour)[8:32, 10:34]
    assert np.abs(rgb.astype(int) - (200, 120, 90)).max() <= 2


def test_blending_a_colour_over_itself_changes_nothing():
    colour = Colour()
    planes = rgb_to_planes(np.full((48, 64, 3), (180, 130, 100), np.uint8), colour)
    out = composite(planes, layer_of((180, 130, 100), disc()), colour)
    for a, b in ((out.y, planes.y), (out.u, planes.u), (out.v, planes.v)):
        assert np.abs(a.astype(int) - b).max() <= 1


def test_half_alpha_is_the_mean_and_chroma_weighs_by_alpha():
    colour = Colour(full_range=True)
    planes = rgb_to_planes(np.zeros((48, 64, 3), np.uint8), colour)
    alpha = np.zeros((2, 2), np.float32)
    alpha[0, 0] = 1.0
    out = composite(planes, layer_of((255, 0, 0), alpha, 4, 4), colour)
    assert out.y[4, 4] == round(0.299 * 255)
    assert out.y[4, 5] == 0
    assert out.v[2, 2] == round(128 + 0.25 * 127.5)
    half = composite(planes, layer_of((200, 200, 200), alpha * 0.5, 4, 4), colour)
    assert half.y[4, 4] == 100
    assert half.u[2, 2] == 128


def test_a_layer_outside_the_picture_changes_nothing():
    planes = noise_planes()
    empty = MouthLayer(0, 0, np.zeros((0, 0, 3), np.float32), np.zeros((0, 0), np.float32))
    out = composite(planes, empty, Colour())
    assert np.array_equal(out.packed(), planes.packed())


def face_mask(pixels=2.0):
    """A mask whose crop is 100 x 106 mm around a mouth 50 mm wide."""
    vertices = np.zeros((468, 3), np.float32)
    vertices[61, :2] = (-25, 60)
    vertices[291, :2] = (25, 60)
    vertices[NOSE_BASE, :2] = (0, 38)
    vertices[CHIN, :2] = (0, 108)
    x, y = np.meshgrid(np.linspace(-50, 50, 25), np.linspace(15, 121, 27))
    grid = np.stack([x, y, np.zeros_like(x)], axis=-1).astype(np.float32)
    return Mask(vertices, MouthPatch(grid, int(100 * pixels), int(106 * pixels)))


def at(alpha, mask, x, y):
    i, j = np.rint(mask.patch.to_crop(np.array([x, y]))).astype(int)
    return float(alpha[j, i])


@pytest.mark.parametrize("pixels", [0.88, 2.0, 2.88])
def test_the_blend_region_lies_around_the_mouth(pixels):
    mask = face_mask(pixels)
    shape = BlendShape()
    alpha = blend_alpha(mask, shape)
    assert alpha.dtype == np.float32
    assert alpha.shape == (mask.patch.crop_height, mask.patch.crop_width)
    # Lips and chin, also when wide open, are the unit's; nostrils and neck the background's.
    for x, y in [(0, 60), (-25, 60), (25, 60), (0, 52), (0, 108), (-18, 75), (12, 52)]:
        assert at(alpha, mask, x, y) == 1
    for x, y in [(-8, 36), (8, 36), (0, 38), (-44, 100), (-48, 60), (48, 60), (-40, 40)]:
        assert at(alpha, mask, x, y) == 0
    assert alpha.max() == 1
    for edge in (alpha[0], alpha[-1], alpha[:, 0], alpha[:, -1]):
        assert not edge.any()
    # No step larger than the steepest fade explains.
    narrowest = min(shape.upper_feather, shape.side_feather, shape.lower_feather)
    steepest = 1.5 / (narrowest * pixels) * 1.3
    assert np.abs(np.diff(alpha, axis=0)).max() < steepest
    assert np.abs(np.diff(alpha, axis=1)).max() < steepest
    # Mirrored, as the mask is.
    assert np.allclose(alpha, alpha[:, ::-1], atol=1e-4)


def test_the_blend_region_follows_its_settings():
    mask = face_mask()
    narrow = blend_alpha(mask, replace(BlendShape(), side=10.0, side_feather=6.0))
    usual = blend_alpha(mask)
    assert narrow.sum() < usual.sum()
    huge = blend_alpha(mask, replace(BlendShape(), side=500.0, chin_gap=-500.0))
    assert huge.sum() > usual.sum()
    for edge in (huge[0], huge[-1], huge[:, 0], huge[:, -1]):
        assert not edge.any()
    with pytest.raises(RenderError, match="no room at its top"):
        blend_alpha(mask, replace(BlendShape(), upper_feather=40.0))


def test_the_ring_is_the_fading_band():
    alpha = blend_alpha(face_mask())
    ring = ring_weights(alpha)
    assert not ring[(alpha == 0) | (alpha == 1)].any()
    assert ring.max() == pytest.approx(1, abs=0.01)
