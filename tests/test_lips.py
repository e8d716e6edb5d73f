"""Lips measured on contours made by hand, teeth and tongue on painted mouths."""

import cv2
import numpy as np
import pytest

from analysis.lips import LIP_SMOOTHING, lip_geometry, mesh_mouth_height, teeth_and_tongue
from database.mask import INNER_LIPS, OUTER_LIPS, Camera, Mask, MouthPatch, Poses, project

CAMERA = Camera.assumed(360, 288)
MOUTH = np.array([0.0, 45.0, 0.0])


def contour(half_width, half_height):
    """Twenty points around an ellipse, clockwise from the left corner."""
    angle = np.pi - np.arange(20) * 2 * np.pi / 20
    flat = [half_width * np.cos(angle), -half_height * np.sin(angle), np.zeros(20)]
    return np.stack(flat, axis=1) + MOUTH


def vertices(width=50.0, height=20.0, opening=8.0):
    """A mesh of nothing but lips and eye corners, mm."""
    points = np.zeros((468, 3))
    points[list(OUTER_LIPS)] = contour(width / 2, height / 2)
    points[list(INNER_LIPS)] = contour(0.4 * width, opening / 2)
    points[33], points[263] = (-44.45, -30, 0), (44.45, -30, 0)
    return points


def patch(width_mm=100.0, crop_width=160):
    height_mm = width_mm * 304 / 288
    x = np.linspace(-width_mm / 2, width_mm / 2, 25)
    y = np.linspace(-height_mm / 2, height_mm / 2, 27) + MOUTH[1]
    plane = np.stack([*np.meshgrid(x, y), np.zeros((27, 25))], axis=-1)
    return MouthPatch(plane.astype(np.float32), crop_width, round(crop_width * 304 / 288))


MASK = Mask(vertices(40, 14, 0).astype(np.float32), patch())


def pose(rotation=(0, 0, 0), translation=(0, 0, 700)):
    return Poses(np.array([rotation], np.float32), np.array([translation], np.float32))


def measured(points, where):
    return lip_geometry(project(points, where.matrix(0), CAMERA)[None], where, MASK, CAMERA, [0])


def test_an_ellipse_has_its_axes():
    lips = measured(vertices(50, 20, 8), pose())
    assert lips.contours.shape == (1, 40, 2)
    assert lips.width[0] == pytest.approx(50, rel=1e-4)
    assert lips.height[0] == pytest.approx(20, rel=1e-4)
    assert lips.opening[0] == pytest.approx(8, rel=1e-3)
    np.testing.assert_allclose(lips.contours[0, 0], [-25, 45], atol=1e-2)
    np.testing.assert_allclose(lips.contours[0, 15], [0, 55], atol=1e-2)


@pytest.mark.parametrize(
    ("rotation", "translation", "tolerance"),
    [
        ((0, 0, 0.5), (0, 0, 700), 1e-3),
        ((0, 0, 0), (60, -40, 700), 1e-3),
        ((0, 0, 0), (0, 0, 350), 1e-3),
        ((0, 0, 0), (0, 0, 1400), 1e-3),
        # Turned out of the picture's plane, the depth of what moved is a guess.
        ((0.2, 0, 0), (0, 0, 700), 0.03),
        ((0, 0.2, 0), (0, 0, 700), 0.03),
    ],
)
def test_head_motion_does_not_count(rotation, translation, tolerance):
    lips = measured(vertices(50, 20, 8), pose(rotation, translation))
    assert lips.width[0] == pytest.approx(50, rel=tolerance)
    assert lips.height[0] == pytest.approx(20, rel=tolerance)
    assert lips.opening[0] == pytest.approx(8, rel=max(2 * tolerance, 1e-2))


def test_lips_that_cross_are_closed():
    points = vertices(50, 14, -2.0)
    assert measured(points, pose()).opening[0] == 0


def sequence(heights, numbers, smoothing=LIP_SMOOTHING):
    where = Poses(
        np.zeros((len(heights), 3), np.float32),
        np.tile(np.array([0, 0, 700], np.float32), (len(heights), 1)),
    )
    points = np.stack([project(vertices(50, h, h / 2), where.matrix(0), CAMERA) for h in heights])
    return lip_geometry(points, where, MASK, CAMERA, numbers, smoothing).height


def test_contours_are_smoothed_in_time_but_not_across_gaps():
    numbers = np.arange(40)
    jitter = np.random.default_rng(0).normal(0, 1, 40)
    raw, smooth = (sequence(20 + jitter, numbers, n) for n in (1, LIP_SMOOTHING))
    np.testing.assert_allclose(raw, 20 + jitter, rtol=1e-4)
    assert smooth.std() < 0.85 * raw.std()
    step = np.repeat([14.0, 26.0], 20)
    gap = np.r_[0:20, 60:80]
    np.testing.assert_allclose(sequence(step, gap), step, rtol=1e-4)
    assert np.abs(sequence(step, numbers) - step).max() > 0.5


def test_a_closure_of_three_frames_survives_smoothing():
    heights = np.full(21, 24.0)
    heights[9:12] = 14.0
    assert sequence(heights, np.arange(21))[10] < 15.5


def test_the_ruler_does_not_need_a_pose():
    first = project(vertices(50, 20), pose().matrix(0), CAMERA)
    moved = project(vertices(50, 20), pose((0, 0, 0.4), (50, 10, 500)).matrix(0), CAMERA)
    heights = mesh_mouth_height(np.stack([first, moved]))
    np.testing.assert_allclose(heights, 20 / 88.9, rtol=1e-4)
    closed = project(vertices(50, 12), pose().matrix(0), CAMERA)
    assert mesh_mouth_height(closed[None])[0] == pytest.approx(12 / 88.9, rel=1e-4)


SKIN, LIPS = (205, 165, 145), (170, 95, 92)
DARK, WHITE, TONGUE = (38, 20, 18), (222, 212, 196), (150, 78, 80)


def painted(inside, opening=14.0, above=1.0, gain=1.0, rest=DARK, where=None):
    """A mouth's crop and contours: `inside` fills the opening down to the part `above`."""
    where = where or patch()
    points = vertices(50, 20 + opening, opening)
    contours = points[[*OUTER_LIPS, *INNER_LIPS], :2].astype(np.float32)
    crop = np.full((where.crop_height, where.crop_width, 3), SKIN, np.uint8)
    at = np.round(where.to_crop(contours)).astype(np.int32)
    cv2.fillPoly(crop, [at[:20]], LIPS)
    cv2.fillPoly(crop, [at[20:]], rest)
    hole = cv2.fillPoly(np.zeros(crop.shape[:2], np.uint8), [at[20:]], 1) > 0
    top = where.to_crop(np.array([0, MOUTH[1] - opening / 2]))[1]
    rows = np.arange(where.crop_height)[:, None] < top + above * opening * where.pixels_per_mm
    crop[hole & rows] = inside
    crop = np.clip(crop * gain, 0, 255).astype(np.uint8)
    return teeth_and_tongue(crop, contours, opening, where)


def test_a_dark_hole_shows_nothing():
    teeth, tongue = painted(DARK)
    assert teeth < 0.01 and tongue < 0.01


def test_closed_lips_show_nothing():
    assert painted(WHITE, opening=0.3) == (0.0, 0.0)


def test_teeth():
    teeth, tongue = painted(WHITE, opening=7.0, above=0.5)
    assert teeth > 0.2
    assert tongue < 0.02
    assert painted(WHITE, opening=7.0)[0] > 1.7 * teeth


def test_tongue():
    teeth, tongue = painted(TONGUE)
    assert tongue > 0.4
    assert teeth < 0.02


def test_both():
    teeth, tongue = painted(WHITE, above=0.35, rest=TONGUE)
    assert teeth > 0.1 and tongue > 0.2


def test_visibility_is_an_area():
    """The part of an ellipse inside its rim, in tenths of the resting mouth's width squared."""
    for opening in (6.0, 10.0, 14.0):
        a, b = 20 - 0.7, opening / 2 - 0.7
        full = 0.1 * 50**2
        expected = min(1.0, np.pi * a * b / full)
        assert painted(WHITE, opening=opening)[0] == pytest.approx(expected, rel=0.12)


def test_visibility_ends_at_one():
    assert painted(WHITE, opening=30)[0] == 1.0


@pytest.mark.parametrize("gain", [0.5, 0.75, 1.1])
def test_lighting_does_not_count(gain):
    assert painted(WHITE, above=0.5, gain=gain)[0] == pytest.approx(
        painted(WHITE, above=0.5)[0], abs=0.03
    )
    assert painted(TONGUE, gain=gain)[1] == pytest.approx(painted(TONGUE)[1], abs=0.08)


def test_the_size_of_the_crop_does_not_count():
    small, large = patch(crop_width=88), patch(crop_width=288)
    assert painted(WHITE, above=0.5, where=small)[0] == pytest.approx(
        painted(WHITE, above=0.5, where=large)[0], abs=0.06
    )
