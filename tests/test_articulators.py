"""Teeth and tongue on painted mouths, and beside what a person sees in real ones."""

import importlib.util
import sys
from pathlib import Path

import cv2
import numpy as np
import pytest

from analysis.articulators import CORNERS, teeth_and_tongue
from database.mask import MouthPatch

BENCHMARK = Path(__file__).parent.parent / "benchmarks" / "articulators.py"


def contour(half_width, half_height):
    """Twenty points around an ellipse about the origin, clockwise from the left corner."""
    angle = np.pi - np.arange(20) * 2 * np.pi / 20
    return np.stack([half_width * np.cos(angle), -half_height * np.sin(angle)], axis=1)


def patch(crop_width=160):
    x, y = np.linspace(-50, 50, 25), np.linspace(-50, 50, 27) * 304 / 288
    plane = np.stack([*np.meshgrid(x, y), np.zeros((27, 25))], axis=-1)
    return MouthPatch(plane.astype(np.float32), crop_width, round(crop_width * 304 / 288))


SKIN, LIPS = (205, 165, 145), (170, 95, 92)
DARK, WHITE, TONGUE = (38, 20, 18), (222, 212, 196), (150, 78, 80)


def painted(inside, opening=14.0, above=1.0, gain=1.0, rest=DARK, where=None):
    """A mouth's crop and contours: `inside` fills the opening down to the part `above`."""
    where = where or patch()
    shapes = contour(25, 10 + opening / 2), contour(20, opening / 2)
    contours = np.concatenate(shapes).astype(np.float32)
    fine = MouthPatch(where.grid, where.crop_width * 8, where.crop_height * 8)
    crop = np.full((fine.crop_height, fine.crop_width, 3), SKIN, np.uint8)
    at = np.round(fine.to_crop(contours)).astype(np.int32)
    cv2.fillPoly(crop, [at[:20]], LIPS)
    cv2.fillPoly(crop, [at[20:]], rest)
    hole = cv2.fillPoly(np.zeros(crop.shape[:2], np.uint8), [at[20:]], 1) > 0
    edge = fine.to_crop(np.array([0, opening * (above - 0.5)]))[1]
    crop[hole & (np.arange(fine.crop_height)[:, None] < edge)] = inside
    crop = cv2.resize(crop, (where.crop_width, where.crop_height), interpolation=cv2.INTER_AREA)
    crop = np.clip(crop * np.asarray(gain), 0, 255).astype(np.uint8)
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
    assert tongue > 0.3
    assert teeth < 0.02


def test_both():
    teeth, tongue = painted(WHITE, above=0.35, rest=TONGUE)
    assert teeth > 0.1 and tongue > 0.2


def test_visibility_is_an_area():
    """Of an ellipse without its corners, in tenths of the resting mouth's width squared."""
    k = 1 - CORNERS
    whole = 2 * (np.arcsin(k) + k * np.sqrt(1 - k * k))
    for opening in (3.0, 5.0, 8.0):
        expected = whole * 20 * opening / 2 / (0.1 * 50**2)
        assert painted(WHITE, opening=opening)[0] == pytest.approx(expected, rel=0.12)


def test_visibility_ends_at_one():
    assert painted(WHITE, opening=30)[0] == 1.0


@pytest.mark.parametrize("gain", [0.5, 0.75, 1.1, (1.1, 0.95, 0.7), (0.8, 0.9, 1.1)])
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


def test_a_picture_without_colours_or_without_a_mouth_shows_no_teeth():
    contours = np.concatenate([contour(25, 17), contour(20, 7)]).astype(np.float32)
    for level in (0, 128, 255):
        crop = np.full((patch().crop_height, patch().crop_width, 3), level, np.uint8)
        assert teeth_and_tongue(crop, contours, 14.0, patch())[0] == 0
    outside = contours + np.float32(500)
    crop = np.full((patch().crop_height, patch().crop_width, 3), SKIN, np.uint8)
    assert teeth_and_tongue(crop, outside, 14.0, patch()) == (0.0, 0.0)


def test_red_lips_in_place_of_the_opening_are_no_teeth():
    """The mesh may call shut lips open by some mm."""
    teeth, tongue = painted(LIPS, opening=3.0)
    assert teeth == 0
    assert tongue < 0.01


@pytest.fixture(scope="module")
def benchmark():
    spec = importlib.util.spec_from_file_location("articulators_benchmark", BENCHMARK)
    module = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = module
    spec.loader.exec_module(module)
    return module


def test_the_labels_are_of_many_mouths(benchmark):
    clip, teeth, tongue = zip(
        *(
            (row["clip"], float(row["teeth"]), float(row["tongue"]))
            for row in benchmark.labelled_frames()
        ),
        strict=True,
    )
    assert len(clip) >= 80
    assert len(set(clip)) >= 12
    assert min(teeth.count(k) for k in (0, 1, 2, 3)) >= 12
    assert sum(t > 0 for t in tongue) >= 10


def test_teeth_and_tongue_agree_with_the_eye(benchmark, corpus, finder):
    """On clips that nothing was tuned on; all of them, in benchmarks/articulators.py."""
    seen = benchmark.look(corpus, finder, only_kept_back=True)
    assert len(seen.labels) >= 30
    assert seen.correlation(0) >= 0.8
    assert seen.tongue_told() >= 0.65
