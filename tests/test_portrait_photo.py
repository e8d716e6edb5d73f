"""Photos as they come: turned, grey, transparent, huge, tiny, and no photos at all."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest
from PIL import Image

from analysis.face import FaceFinder
from analysis.models import FaceModels
from analysis.photo import read_photo
from analysis.portrait import PortraitSettings, portrait_of
from database.errors import FaceError, MediaError


def save(path: Path, picture: np.ndarray | Image.Image, **options: object) -> Path:
    image = picture if isinstance(picture, Image.Image) else Image.fromarray(picture)
    image.save(path, **options)
    return path


def test_exif_turns_it_upright(tmp_path: Path, portrait: np.ndarray) -> None:
    exif = Image.Exif()
    exif[0x0112] = 6
    sideways = np.ascontiguousarray(np.rot90(portrait))
    photo = read_photo(save(tmp_path / "x.png", sideways, exif=exif))
    np.testing.assert_array_equal(photo.rgb, portrait)
    assert "upright" in photo.notes[0]


@pytest.mark.parametrize("mode", ["L", "1", "P", "LA", "I;16", "CMYK"])
def test_every_kind_of_pixel(tmp_path: Path, portrait: np.ndarray, mode: str) -> None:
    image = Image.fromarray(portrait)
    if mode == "I;16":
        grey = np.asarray(image.convert("L"), dtype=np.uint16) * 257
        path = save(tmp_path / "x.png", Image.fromarray(grey))
    else:
        path = save(tmp_path / f"x.{'tif' if mode == 'CMYK' else 'png'}", image.convert(mode))
    rgb = read_photo(path).rgb
    assert rgb.shape == portrait.shape and rgb.dtype == np.uint8
    if mode not in ("1", "P"):
        assert np.abs(rgb.mean(axis=2) - portrait.mean(axis=2)).mean() < 12


def test_what_is_transparent_is_laid_on_white(tmp_path: Path) -> None:
    clear = np.zeros((80, 90, 4), np.uint8)
    clear[20:40, 20:40] = (10, 20, 30, 255)
    photo = read_photo(save(tmp_path / "x.png", clear))
    assert (photo.rgb[0, 0] == 255).all() and (photo.rgb[30, 30] == (10, 20, 30)).all()
    assert "white" in photo.notes[0]


def test_huge_ones_are_scaled_and_odd_ones_made_even(tmp_path: Path, portrait: np.ndarray) -> None:
    path = save(tmp_path / "x.jpg", cv2.resize(portrait[:301, :201], (2010, 3010)))
    photo = read_photo(path)
    assert max(photo.rgb.shape) <= 1280 and not np.any(np.array(photo.rgb.shape[:2]) % 2)
    assert "2010 x 3010" in photo.notes[-1]
    assert read_photo(save(tmp_path / "y.png", portrait[:301, :201])).rgb.shape == (300, 200, 3)


def test_what_cannot_be_read_is_told_in_one_line(tmp_path: Path, portrait: np.ndarray) -> None:
    whole = save(tmp_path / "x.png", portrait).read_bytes()
    (tmp_path / "text.png").write_text("hello")
    (tmp_path / "cut.png").write_bytes(whole[: len(whole) // 2])
    (tmp_path / "empty.jpg").write_bytes(b"")
    save(tmp_path / "tiny.png", portrait[:50, :50])
    for name in ("none.png", "text.png", "cut.png", "empty.jpg", "tiny.png", "."):
        with pytest.raises(MediaError) as error:
            read_photo(tmp_path / name)
        assert str(error.value).startswith(str(tmp_path)) and "\n" not in str(error.value)


def test_no_face(tmp_path: Path, face_models: FaceModels, portrait: np.ndarray) -> None:
    path = save(tmp_path / "coat.png", portrait[360:])
    with pytest.raises(FaceError, match="no face that looks at the camera"):
        portrait_of(path)


def test_of_two_faces_the_largest_is_taken_and_told(
    tmp_path: Path, face_models: FaceModels, portrait: np.ndarray
) -> None:
    both = np.full((600, 900, 3), 90, np.uint8)
    both[:, 388:] = portrait
    both[150:450, 60:316] = cv2.resize(portrait, (256, 300), interpolation=cv2.INTER_AREA)
    path = save(tmp_path / "both.png", both)
    content = portrait_of(path)
    assert content.mask.origin[0] > 600
    assert any("2 faces" in note and "--face" in note for note in content.report["notes"])
    assert portrait_of(path, settings=PortraitSettings(face="left")).mask.origin[0] < 300
    with pytest.raises(FaceError, match="no number 3"):
        portrait_of(path, settings=PortraitSettings(face="3"))


def test_a_small_face_is_refused(
    tmp_path: Path, face_models: FaceModels, portrait: np.ndarray
) -> None:
    path = save(tmp_path / "x.png", cv2.resize(portrait, (110, 130), interpolation=cv2.INTER_AREA))
    with pytest.raises(FaceError, match="too small"):
        portrait_of(path)


def seen_from_the_side(finder: FaceFinder, portrait: np.ndarray, degrees: float) -> np.ndarray:
    """Turn the portrait's face mesh in space, each triangle with its part of the picture."""
    mesh = finder.find(portrait).points.astype(np.float64)
    middle = mesh.mean(axis=0)
    angle = np.radians(degrees)
    turned = mesh - middle
    x = turned[:, 0] * np.cos(angle) + turned[:, 2] * np.sin(angle)
    depth = turned[:, 2] * np.cos(angle) - turned[:, 0] * np.sin(angle)
    there = np.column_stack([x + middle[0], mesh[:, 1]]).astype(np.float32)
    out = np.full_like(portrait, 80)
    division = cv2.Subdiv2D((0, 0, portrait.shape[1], portrait.shape[0]))
    for point in mesh[:, :2]:
        division.insert((float(point[0]), float(point[1])))
    corners = division.getTriangleList().reshape(-1, 3, 2)
    index = np.linalg.norm(corners[:, :, None] - mesh[None, None, :, :2], axis=3).argmin(axis=2)
    for t in index[np.argsort(-depth[index].mean(axis=1))]:
        source = mesh[t, :2].astype(np.float32)
        to = cv2.getAffineTransform(source, there[t])
        part = np.zeros(portrait.shape[:2], np.uint8)
        cv2.fillConvexPoly(part, np.rint(there[t]).astype(np.int32), 1)
        warped = cv2.warpAffine(portrait, to, portrait.shape[1::-1])
        out[part > 0] = warped[part > 0]
    return out


def test_a_profile_is_refused_and_a_turned_face_told(
    tmp_path: Path, finder: FaceFinder, portrait: np.ndarray
) -> None:
    path = save(tmp_path / "profile.png", seen_from_the_side(finder, portrait, 60))
    with pytest.raises(FaceError, match=r"turned \d+ degrees|no face that looks|does not fit"):
        portrait_of(path)
    finder.reset()
    path = save(tmp_path / "turned.png", seen_from_the_side(finder, portrait, 27))
    assert any("turned" in note for note in portrait_of(path).report["notes"])
