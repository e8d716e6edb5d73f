"""Several faces, one of them meant; faces too small for the whole picture's detection."""

import cv2
import numpy as np
import pytest

from analysis.build import BuildSettings, build_database
from analysis.detector import FaceBox
from analysis.face import FaceFinder, FaceSettings
from analysis.faces import Company, choose
from database.errors import FaceError

NOSE = (268, 242)
"""Of the portrait, pixels."""

CROP = (slice(0, 420), slice(90, 450))
"""The portrait without its shoulders."""


def boxes(*faces):
    return [FaceBox(x, y, size, 0.0, 0.9) for x, y, size in faces]


@pytest.mark.parametrize(
    ("choice", "expected"),
    [("main", 1), ("largest", 3), ("left", 2), ("right", 3), ("1", 2), ("2", 0), ("4", 3)],
)
def test_the_choice(choice, expected):
    faces = boxes((300, 60, 40), (320, 200, 90), (40, 100, 30), (600, 440, 100))
    assert choose(faces, choice, 640, 480) == expected


def test_too_few_faces():
    assert choose(boxes((1, 1, 9)), "2", 640, 480) is None
    assert choose([], "main", 640, 480) is None


@pytest.mark.parametrize("choice", ["0", "-1", "front", "", "1.5", "²"])
def test_choices_that_are_none(choice):
    with pytest.raises(FaceError, match="chooses no face; choose main, left, right, largest"):
        Company(choice)


def test_the_other_one_does_not_take_over():
    company = Company("left")
    both = boxes((100, 100, 50), (300, 100, 50))
    company.settle(company.pick(both, 400, 200), both)
    # The left one is hidden; the right one leans over, and is still the right one.
    assert company.pick(boxes((240, 100, 50)), 400, 200) is None
    assert company.pick(boxes((140, 100, 50), (290, 100, 50)), 400, 200).x == 140


def test_alone_one_may_go_anywhere():
    company = Company("main")
    only = boxes((100, 100, 50))
    company.settle(company.pick(only, 800, 200), only)
    assert company.pick(boxes((700, 90, 50)), 800, 200).x == 700


def placed(picture, portrait, scale, left, top):
    """Put the head into a picture; give the place of its nose."""
    head = cv2.resize(portrait[CROP], None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA)
    h, w = head.shape[:2]
    picture[top : top + h, left : left + w] = head
    return np.array([left + scale * (NOSE[0] - 90), top + scale * NOSE[1]])


def nose(found):
    return found.points[1, :2]


@pytest.fixture
def pair(portrait):
    """Two people, the right one larger, and a third, smallest, between them."""
    picture = np.full((480, 960, 3), 90, np.uint8)
    noses = [
        placed(picture, portrait, 0.7, 20, 120),
        placed(picture, portrait, 0.65, 350, 20),
        placed(picture, portrait, 0.9, 630, 60),
    ]
    return picture, noses


@pytest.mark.parametrize(
    ("choice", "expected"),
    [("left", 0), ("right", 2), ("largest", 2), ("1", 0), ("2", 1), ("3", 2)],
)
def test_the_wanted_face_is_meshed(face_models, pair, choice, expected):
    picture, noses = pair
    found = FaceFinder(face_models, FaceSettings(face=choice)).find(picture)
    assert np.linalg.norm(nose(found) - noses[expected]) < 6


def test_a_small_wanted_face_keeps_its_company(face_models, portrait):
    """Lost and found among the picture's parts, it still is not the other one."""
    finder = FaceFinder(face_models, FaceSettings(face="left"))
    for i in range(40):
        picture = np.full((720, 1280, 3), 90, np.uint8)
        small = placed(picture, portrait, 0.45, 200, 300)
        placed(picture, portrait, 0.9, 800, 100)
        if i in (15, 16) or i >= 30:
            picture[:, :600] = 90
        found = finder.find(picture)
        assert (found is None) == (i in (15, 16) or i >= 30), i
        if found is not None:
            assert np.linalg.norm(nose(found) - small) < 6


def test_nobody_is_the_fourth(face_models, pair):
    assert FaceFinder(face_models, FaceSettings(face="4")).find(pair[0]) is None


def test_no_jumping_while_the_wanted_one_is_hidden(face_models, portrait):
    finder = FaceFinder(face_models, FaceSettings(face="left"))
    seen = []
    for i in range(30):
        picture = np.full((480, 960, 3), 90, np.uint8)
        wanted = placed(picture, portrait, 0.7, 60 + 2 * i, 100)
        placed(picture, portrait, 0.9, 560, 60)
        if 10 <= i < 16:
            picture[:, :500] = 90
        found = finder.find(picture)
        seen.append(None if found is None else np.linalg.norm(nose(found) - wanted))
    assert all(s is None for s in seen[10:16])
    assert max(seen[:10] + seen[16:]) < 8


def test_who_comes_later_does_not_take_over(face_models, portrait):
    """The second person comes while the first is followed by the mesh alone."""
    finder = FaceFinder(face_models)
    for i in range(40):
        picture = np.full((480, 960, 3), 90, np.uint8)
        if i < 30:
            placed(picture, portrait, 0.7, 60, 100)
        if i >= 5:
            placed(picture, portrait, 0.7, 600, 100)
        found = finder.find(picture)
        assert (found is not None) == (i < 30), i


@pytest.mark.parametrize(
    ("width", "height", "face"), [(1920, 1080, 100), (1280, 720, 60), (640, 480, 45)]
)
def test_small_faces(face_models, portrait, width, height, face):
    """Faces of 5 to 7 % of the picture's width, over clutter."""
    clutter = np.random.default_rng(1).integers(0, 256, (height, width, 3), np.uint8)
    picture = cv2.GaussianBlur(clutter, None, 5)
    where = placed(picture, portrait, face / 180, round(0.6 * width), round(0.3 * height))
    found = FaceFinder(face_models).find(picture)
    assert np.linalg.norm(nose(found) - where) < 0.04 * face


def test_a_small_face_is_followed_and_found_again(face_models, portrait):
    finder = FaceFinder(face_models)
    for i in range(12):
        picture = np.full((720, 1280, 3), 90, np.uint8)
        where = placed(picture, portrait, 0.35, 700 + 3 * i, 300)
        if i == 6:
            picture[:] = 90
        found = finder.find(picture)
        assert (found is None) == (i == 6)
        if found is not None:
            assert np.linalg.norm(nose(found) - where) < 4


def test_a_build_of_a_face_that_is_not_there(puppet_corpus, face_models, tmp_path):
    settings = BuildSettings(face=FaceSettings(face="2"))
    with pytest.raises(FaceError, match="shows no face"):
        build_database(puppet_corpus, tmp_path / "a.h5", settings=settings, limit=1, jobs=1)
    assert list(tmp_path.iterdir()) == []
