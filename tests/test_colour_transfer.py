"""Gains that bring a unit into a frame's light, and sharpness that resampling took."""

import cv2
import numpy as np
import pytest

from database.mask import Camera, MouthPatch, cut_crop
from database.planes import Colour
from render.colour_transfer import ColourTransfer
from render.scene import Scene
from render.sharpening import LARGEST_AMOUNT, sharpen, sharpening_amount


def skin(width=96, height=100, seed=0):
    """A face-coloured crop with texture and a dark mouth."""
    rng = np.random.default_rng(seed)
    texture = cv2.GaussianBlur(rng.normal(0, 60, (height, width)).astype(np.float32), None, 3)
    rgb = np.array([190.0, 140.0, 115.0]) + texture[..., None]
    return np.clip(cv2.ellipse(rgb, (48, 50), (20, 9), 0, 0, 360, (90, 40, 40), -1), 0, 255).astype(
        np.uint8
    )


def fading(width=96, height=100):
    x = np.abs(np.linspace(-1, 1, width))[None, :]
    y = np.abs(np.linspace(-1, 1, height))[:, None]
    t = np.clip((0.95 - np.hypot(x, y)) / 0.4, 0, 1)
    return (t * t * (3 - 2 * t)).astype(np.float32)


def gained(crop, gain):
    return np.clip(np.rint(crop * gain), 0, 255).astype(np.uint8)


def band_error(a, b, weights):
    """Mean difference of what light is: the pictures' local means."""
    a, b = (cv2.blur(image.astype(np.float32), (5, 5)) for image in (a, b))
    return (np.abs(a - b) * weights[..., None]).sum(axis=(0, 1)) / weights.sum()


ALPHA = fading()
BAND = 4 * ALPHA * (1 - ALPHA)
TRANSFER = ColourTransfer(ALPHA)


def matched(frame, unit):
    return TRANSFER.apply(unit, TRANSFER.field(frame, unit))


def test_equal_crops_are_left_as_they_are():
    crop = skin()
    field = TRANSFER.field(crop, crop)
    assert not field.any()
    assert np.array_equal(TRANSFER.apply(crop, field), crop)


def test_a_constant_and_a_slope_are_undone():
    frame = skin()
    x = np.linspace(-1, 1, 96)[None, :, None]
    y = np.linspace(-1, 1, 100)[:, None, None]
    unit = gained(frame, np.exp(-0.12 + 0.1 * x - 0.08 * y) * np.array([1.0, 0.95, 1.08]))
    assert band_error(unit, frame, BAND).max() > 10
    assert band_error(matched(frame, unit), frame, BAND).max() < 1
    # Over the mouth too, where the two are not compared.
    assert band_error(matched(frame, unit), frame, ALPHA).max() < 1.5


def test_light_from_one_side_is_followed_where_no_plane_would():
    """What the membrane is for: a cheek that is lit otherwise than the rest."""
    frame = skin()
    x = np.linspace(-1, 1, 96)[None, :, None]
    unit = gained(frame, np.exp(-0.16 * np.clip(x - 0.2, 0, 1) ** 2 / 0.64))
    cheek = BAND * (np.arange(96) > 60)
    before, after = (band_error(c, frame, cheek).max() for c in (unit, matched(frame, unit)))
    assert before > 8
    assert after < before / 2


@pytest.mark.parametrize("where", [(30, 18, 66, 30), (38, 76, 60, 92), (4, 30, 16, 70)])
def test_a_dark_patch_does_not_spoil_the_match(where):
    frame = skin()
    unit = gained(frame, 0.85)
    x0, y0, x1, y1 = where
    unit[y0:y1, x0:x1] = unit[y0:y1, x0:x1] // 3
    rest = BAND.copy()
    rest[max(0, y0 - 16) : y1 + 16, max(0, x0 - 16) : x1 + 16] = 0
    assert band_error(unit, frame, rest).min() > 10
    assert band_error(matched(frame, unit), frame, rest).max() < 3
    # The patch stays dark: it is no light.
    inside = np.zeros_like(BAND)
    inside[y0 + 3 : y1 - 3, x0 + 3 : x1 - 3] = 1
    assert band_error(matched(frame, unit), frame, inside).min() > 30


def test_gains_are_limited_and_without_a_band_there_are_none():
    dark, light = np.full((100, 96, 3), 10, np.uint8), np.full((100, 96, 3), 240, np.uint8)
    assert matched(light, dark).max() <= 2 * (10 + 4)
    nowhere = ColourTransfer(np.ones_like(ALPHA))
    assert not nowhere.field(light, dark).any()


@pytest.mark.parametrize("size", [(12, 13), (40, 42), (288, 304)])
def test_crops_of_any_size(size):
    width, height = size
    transfer = ColourTransfer(fading(width, height))
    frame = np.full((height, width, 3), (180, 130, 110), np.uint8)
    unit = gained(frame, 0.8)
    made = transfer.apply(unit, transfer.field(frame, unit))
    assert np.abs(made.astype(int) - frame).max() <= 2


CAMERA = Camera.assumed(360, 288)


def patch(width=56, height=60):
    x, y = np.meshgrid(np.linspace(-30, 30, 9), np.linspace(-20, 44, 9))
    return MouthPatch(np.stack([x, y, 0 * x - 20], axis=-1).astype(np.float32), width, height)


def face_picture():
    noise = np.random.default_rng(4).normal(0, 150, (288, 360)).astype(np.float32)
    rough = 128 + cv2.GaussianBlur(noise, None, 1.0)
    return np.repeat(np.clip(rough, 0, 255).astype(np.uint8)[..., None], 3, axis=2)


def variance(luma, alpha):
    return cv2.Laplacian(np.asarray(luma, np.float32), cv2.CV_32F)[alpha >= 0.999].var()


def test_a_mouth_cut_out_and_drawn_back_is_as_sharp_as_before():
    picture, colour = face_picture(), Colour()
    pose = np.hstack([np.eye(3), np.array([[2.3], [1.6], [905.0]])])
    where = patch()
    alpha = cv2.copyMakeBorder(np.ones((48, 44), np.float32), 6, 6, 6, 6, cv2.BORDER_CONSTANT)
    with Scene(360, 288, where, CAMERA, alpha) as scene:
        amount = sharpening_amount(scene, picture, pose, colour)
        crop = cut_crop(picture, where, pose, CAMERA)
        ratios = []
        for strength in (0.0, amount):
            layer = scene.draw(sharpen(crop, strength), pose)
            h, w = layer.alpha.shape
            under = picture[layer.y0 : layer.y0 + h, layer.x0 : layer.x0 + w, 0]
            laid = layer.premultiplied[..., 0] + (1 - layer.alpha) * under
            made = variance(laid, layer.alpha)
            ratios.append(made / variance(under, layer.alpha))
        # Out of sight, and drawn much smaller than it was cut, there is nothing to gain.
        far = np.hstack([np.eye(3), np.array([[9000.0], [0], [905.0]])])
        assert sharpening_amount(scene, picture, far, colour) == 0
    assert ratios[0] < 0.95
    assert ratios[1] == pytest.approx(1, abs=0.03)
    assert 0 < amount < LARGEST_AMOUNT
    fine = patch(280, 300)
    with Scene(360, 288, fine, CAMERA, np.ones((300, 280), np.float32)) as scene:
        assert sharpening_amount(scene, picture, pose, colour) == 0


def test_a_mouth_recorded_too_small_is_sharpened_only_so_far():
    pose = np.hstack([np.eye(3), np.array([[0.0], [0], [905.0]])])
    tiny = patch(14, 15)
    with Scene(360, 288, tiny, CAMERA, np.ones((15, 14), np.float32)) as scene:
        assert sharpening_amount(scene, face_picture(), pose, Colour()) == LARGEST_AMOUNT


def test_sharpening_leaves_flat_skin_and_raises_edges():
    flat = np.full((20, 20, 3), 120, np.uint8)
    assert np.array_equal(sharpen(flat, 0.5), flat)
    edge = flat.copy()
    edge[:, 10:] = 160
    made = sharpen(edge, 0.5)
    assert made[10, 9, 0] == 115 and made[10, 10, 0] == 165
    assert sharpen(edge, 0.0) is edge
