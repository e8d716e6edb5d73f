"""Faces found and followed, on a real portrait and on what is no face."""

import sys

import cv2
import numpy as np
import pytest

from analysis.face import FaceFinder, FaceSettings
from analysis.models import FaceModels
from analysis.motion import RIGID
from database.errors import ModelError

MARKS = {33: (199, 193), 263: (325, 187), 1: (268, 242), 61: (231, 277), 291: (305, 272)}
"""Mesh points that can be told by eye in the portrait: eye corners, nose tip, mouth corners."""

TOLERANCE = 5.0


def assert_marks(points, to_picture=((1, 0, 0), (0, 1, 0)), tolerance=TOLERANCE):
    places = np.array([(*xy, 1) for xy in MARKS.values()]) @ np.array(to_picture, float).T
    wrong = np.linalg.norm(points[list(MARKS), :2] - places, axis=1)
    assert wrong.max() < tolerance, dict(zip(MARKS, wrong.round(1), strict=True))


def test_the_face_of_a_portrait(finder, portrait):
    found = finder.find(portrait)
    assert found.score > 0.95
    assert found.points.shape == (468, 3)
    assert_marks(found.points)
    # Smaller z is nearer: the nose before the cheeks' edges.
    assert found.points[1, 2] < found.points[[234, 454], 2].min() - 50


@pytest.mark.parametrize("angle", [-25, 15])
@pytest.mark.parametrize("scale", [0.5, 1.5])
def test_turned_and_scaled(finder, portrait, angle, scale):
    middle = (268.0, 240.0)
    there = cv2.getRotationMatrix2D(middle, angle, scale)
    there[:, 2] += np.array([400.0, 300.0]) - middle
    picture = cv2.warpAffine(portrait, there, (800, 600), flags=cv2.INTER_AREA)
    assert_marks(finder.find(picture).points, there, TOLERANCE * max(scale, 0.6))


def test_a_wide_picture_with_the_face_at_its_side(finder, portrait):
    picture = np.full((600, 1400, 3), 90, np.uint8)
    picture[:, 880:1392] = portrait
    assert_marks(finder.find(picture).points, ((1, 0, 880), (0, 1, 0)))


def test_of_two_faces_the_larger(finder, portrait):
    picture = np.full((600, 1024, 3), 90, np.uint8)
    picture[150:450, 100:356] = cv2.resize(portrait, (256, 300), interpolation=cv2.INTER_AREA)
    picture[:, 512:] = portrait
    assert_marks(finder.find(picture).points, ((1, 0, 512), (0, 1, 0)))


def no_faces():
    rng = np.random.default_rng(3)
    yield "blank", np.full((288, 360, 3), 128, np.uint8)
    yield "black", np.zeros((240, 320, 3), np.uint8)
    yield "noise", rng.integers(0, 256, (288, 360, 3), np.uint8)
    soft = cv2.GaussianBlur(rng.integers(0, 256, (288, 360, 3), np.uint8), None, 9)
    yield "clouds", np.asarray(cv2.normalize(soft, None, 0, 255, cv2.NORM_MINMAX))
    squares = np.kron(np.indices((9, 9)).sum(0) % 2, np.ones((32, 32))) * 255
    yield "chessboard", np.repeat(squares[..., None], 3, axis=2).astype(np.uint8)


@pytest.mark.parametrize(("name", "picture"), list(no_faces()))
def test_no_face_is_found_where_there_is_none(finder, name, picture):
    assert finder.find(picture) is None, name


def test_a_coat_is_no_face(finder, portrait):
    assert finder.find(np.ascontiguousarray(portrait[360:])) is None


def test_too_small_a_face_does_not_count(face_models, portrait):
    small = cv2.resize(portrait, (128, 150), interpolation=cv2.INTER_AREA)
    assert FaceFinder(face_models).find(small) is not None
    assert FaceFinder(face_models, FaceSettings(smallest=40)).find(small) is None


def test_a_moving_head_is_followed(finder, portrait, puppet):
    turns = puppet.head_motion(30, seed=4)
    still = []
    for turn in turns:
        picture = cv2.warpAffine(
            portrait, turn, (puppet.WIDTH, puppet.HEIGHT), flags=cv2.INTER_CUBIC
        )
        found = finder.find(picture)
        assert found is not None
        back = cv2.invertAffineTransform(turn)
        still.append(found.points[:, :2] @ back[:, :2].T + back[:, 2])
    moved = np.ptp(turns[:, :, 2], axis=0).max()
    wander = np.linalg.norm(np.std(still, axis=0), axis=-1)[list(RIGID)]
    assert moved > 5
    assert np.median(wander) < 0.6, "landmarks must move with the head, in pixels"


def test_a_lost_face_is_found_again(finder, portrait):
    nothing = np.full_like(portrait, 128)
    elsewhere = np.ascontiguousarray(np.roll(portrait, 150, axis=1))
    assert finder.find(portrait) is not None
    assert finder.find(nothing) is None
    assert_marks(finder.find(elsewhere).points, ((1, 0, 150), (0, 1, 0)))


def test_a_face_that_leaps_is_not_mistaken(finder, portrait):
    """The last frame's region shows nothing any more: the detector must be asked."""
    picture = np.full((600, 1400, 3), 90, np.uint8)
    for left in (0, 880, 0):
        shown = picture.copy()
        shown[:, left : left + 512] = portrait
        assert_marks(finder.find(shown).points, ((1, 0, left), (0, 1, 0)))


def test_following_starts_anew_after_reset(finder, face_models, portrait):
    shifted = np.ascontiguousarray(np.roll(portrait, 6, axis=1))
    alone = FaceFinder(face_models).find(portrait)
    finder.find(shifted)
    finder.reset()
    np.testing.assert_array_equal(finder.find(portrait).points, alone.points)


@pytest.fixture(params=["with LiteRT", "without"])
def engine(request, monkeypatch):
    """Each of the two libraries that run the networks."""
    if request.param == "without":
        monkeypatch.setitem(sys.modules, "ai_edge_litert.interpreter", None)
        return "OpenCV"
    pytest.importorskip("ai_edge_litert", reason="the extra `fast` is not installed")
    return "LiteRT"


def test_both_libraries_see_the_same(engine, face_models, finder, portrait):
    found = FaceFinder(face_models).find(portrait)
    finder.reset()
    np.testing.assert_allclose(found.points, finder.find(portrait).points, atol=0.01)


def test_a_file_that_is_no_network(engine, tmp_path, face_models, capfd):
    wrong = tmp_path / "face.tflite"
    wrong.write_bytes(b"no network at all" * 100)
    with pytest.raises(ModelError, match=rf"face\.tflite: {engine} cannot load it") as caught:
        FaceFinder(FaceModels(face_models.detector, wrong))
    assert "\n" not in str(caught.value)
    other = FaceModels(face_models.detector, face_models.detector)
    if engine == "LiteRT":
        with pytest.raises(ModelError, match="is another model"):
            FaceFinder(other)
        assert capfd.readouterr().err == ""
