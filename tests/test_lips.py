"""Lips measured on contours made by hand."""

import numpy as np
import pytest

from analysis.lips import LIP_SMOOTHING, lip_geometry, mesh_mouth_height
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
