"""How true the mask is: on made-up lips, and on people who were marked by hand."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest

from analysis.face import FaceFinder, FaceSettings
from analysis.models import FaceModels
from analysis.portrait import portrait_of
from analysis.portrait_fit import fit_mask
from analysis.portrait_lips import curves_of, find_lips
from database.mask import INNER_LIPS, OUTER_LIPS
from database.portrait_mesh import INNER_LIPS as MASK_INNER
from database.portrait_mesh import LOWER_INNER, UPPER_INNER
from database.portrait_mesh import OUTER_LIPS as MASK_OUTER

FIRST, LAST = 87, 108
OUTER, INNER = (*range(7), *range(17, 22)), tuple(range(7, 17))


def from_contour(points: np.ndarray, contour: np.ndarray) -> np.ndarray:
    edges = np.roll(contour, -1, axis=0) - contour
    away = points[:, None] - contour
    along = np.clip((away * edges).sum(2) / np.maximum((edges**2).sum(1), 1e-9), 0, 1)
    return np.linalg.norm(away - along[..., None] * edges, axis=2).min(axis=1)


def drawn_lips(bend: float) -> tuple[np.ndarray, np.ndarray]:
    """Lips of two ellipse halves on skin, and 40 contour points of theirs."""
    picture = np.full((300, 400, 3), (205, 160, 140), np.uint8)
    angle = np.linspace(np.pi, 0, 11)
    x = 200 + 90 * np.cos(angle)
    middle = 150 + bend * ((x - 200) / 90) ** 2
    above, below = middle - 24 * np.sin(angle), middle + 34 * np.sin(angle)
    outline = np.concatenate([np.stack([x, above], 1), np.stack([x, below], 1)[::-1]])
    cv2.fillPoly(picture, [np.rint(outline).astype(np.int32)], (170, 85, 90))
    line = np.rint(np.stack([x, middle], 1)).astype(np.int32)
    cv2.polylines(picture, [line], False, (70, 30, 35), 3)
    picture = cv2.GaussianBlur(picture, (0, 0), 1.5)
    outer = np.concatenate([np.stack([x, above], 1), np.stack([x, below], 1)[-2:0:-1]])
    inside = 0.85 * (x - 200) + 200
    seam = np.stack([inside, np.interp(inside, x, middle)], 1)
    return picture, np.concatenate([outer, seam, seam[-2:0:-1]])


@pytest.mark.parametrize("shift", [(0, -7), (0, 6), (4, 0)])
@pytest.mark.parametrize("bend", [-6.0, 8.0])
def test_lips_that_are_off_are_found(shift: tuple[int, int], bend: float) -> None:
    picture, truth = drawn_lips(bend)
    known = curves_of(truth)
    found = find_lips(picture, truth + shift)
    inner = slice(6, -6)
    for name in ("upper", "seam", "lower"):
        a, b = getattr(found, name)[inner], getattr(known, name)
        assert np.median(from_contour(a, np.concatenate([b, b[::-1]]))) < 2.0, name


def test_the_mask_of_a_closed_mouth_is_closed(
    face_models: FaceModels, portrait_photo: Path
) -> None:
    mask = portrait_of(portrait_photo).mask
    assert mask.opening == 0
    np.testing.assert_array_equal(mask.vertices[UPPER_INNER], mask.vertices[LOWER_INNER])


def test_a_face_at_the_photos_edge_keeps_its_mask(finder: FaceFinder, portrait: np.ndarray) -> None:
    cut = np.ascontiguousarray(portrait[90:400, 150:400])
    mesh = finder.find(cut)
    assert mesh is not None
    assert fit_mask(cut, mesh.points).folded() == 0


def test_marked_people(face_models: FaceModels) -> None:
    folder = Path(__file__).parent.parent.parent / "shared" / "portraits" / "london" / "neutral"
    photos = [p for p in sorted(folder.glob("*.jpg")) if p.with_suffix(".tem").is_file()][::4]
    if len(photos) < 10:
        pytest.skip(f"needs marked portraits: no ten in {folder}")
    raw = FaceFinder(face_models, FaceSettings(looks=()))
    errors: list[list[np.ndarray]] = [[], []]
    for photo in photos:
        lines = photo.with_suffix(".tem").read_text().split("\n")[1 + FIRST : 2 + LAST]
        marks = np.array([[float(v) for v in line.split()] for line in lines])
        picture = np.asarray(cv2.imread(str(photo), cv2.IMREAD_COLOR_RGB), dtype=np.uint8)
        raw.reset()
        mesh = raw.find(picture)
        assert mesh is not None
        content = portrait_of(photo)
        scale = picture.shape[1] / content.mask.width
        fitted = (content.mask.vertices + 0.5) * scale - 0.5
        width = np.linalg.norm(marks[6] - marks[0]) / 100
        for kind, (outer, inner) in enumerate(
            (
                (mesh.points[list(OUTER_LIPS), :2], mesh.points[list(INNER_LIPS), :2]),
                (fitted[MASK_OUTER], fitted[MASK_INNER]),
            )
        ):
            errors[kind].append(from_contour(marks[list(OUTER)], outer) / width)
            errors[kind].append(from_contour(marks[list(INNER)], inner) / width)
    before, after = (float(np.median(np.concatenate(e))) for e in errors)
    assert after < 0.6 * before
    assert after < 1.5, "percent of the mouth's width; the bar is 4"
