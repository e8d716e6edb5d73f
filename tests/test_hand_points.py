"""Six points marked by hand, and the mask that passes through them."""

import json
from dataclasses import replace

import numpy as np
import pytest

from analysis.face import FaceFinder
from analysis.hand_points import (
    MESH_POINTS,
    HandPoints,
    mask_through,
    pose_by_hand,
    read_hand_points,
)
from analysis.motion import make_mask
from analysis.person import study_person
from analysis.rigid import from_six, inverse, joined, to_six
from database.errors import CorpusError, FaceError
from database.mask import Camera, project
from database.media import read_video

CAMERA = Camera.assumed(360, 288)
POSE = joined(
    np.column_stack([np.eye(3), [20.0, -10.0, 900.0]]),
    from_six(np.array([0.1, -0.15, 0.05, 0, 0, 0])),
)


@pytest.fixture(scope="module")
def mask(face_models, puppet):
    points = FaceFinder(face_models).find(puppet.portrait()).points
    return make_mask(points, Camera.assumed(512, 600))


def seen(mask, pose=POSE, camera=CAMERA):
    points = project(mask.vertices, pose, camera)
    return np.stack([points[list(ids)].mean(axis=0) for ids in MESH_POINTS.values()])


def marked(points):
    return HandPoints("one", 0, tuple(map(tuple, points.tolist())))


def document(points, frame=3):
    return {
        "clip": "one",
        "frame": frame,
        "points": dict(zip(MESH_POINTS, points.tolist(), strict=True)),
    }


def test_a_file_of_points(tmp_path, mask):
    path = tmp_path / "points.json"
    path.write_text(json.dumps(document(seen(mask))))
    found = read_hand_points(path)
    assert (found.clip, found.frame, found.source) == ("one", 3, "points.json")
    np.testing.assert_allclose(found.array, seen(mask))


def test_the_pose_of_the_points(mask):
    pose = pose_by_hand(marked(seen(mask)), mask, CAMERA)
    six = to_six(joined(inverse(pose), POSE))
    assert np.degrees(np.linalg.norm(six[:3])) < 0.3
    assert np.linalg.norm(pose[:2, 3] - POSE[:2, 3]) < 0.5
    assert pose[2, 3] == pytest.approx(900, rel=0.005)


def test_the_mask_passes_through_the_points(mask):
    rng = np.random.default_rng(0)
    points = seen(mask) + rng.normal(0, 1.0, (6, 2))
    through, pose = mask_through(mask, marked(points), CAMERA)
    off = np.linalg.norm(seen(through, pose) - points, axis=1)
    before = np.linalg.norm(seen(mask, pose_by_hand(marked(points), mask, CAMERA)) - points, axis=1)
    assert off.max() < 0.15 and before.max() > 0.5, "pixels"
    moved = np.linalg.norm(through.vertices - mask.vertices, axis=1)
    assert moved[152] < 0.5, "the chin is far from all six"
    assert moved.max() < 6
    assert through.patch is mask.patch


def test_points_of_something_else(mask):
    points = seen(mask)
    for wrong in (points[::-1], points[[0, 4, 2, 3, 1, 5]], points * [1, 3], np.zeros((6, 2))):
        with pytest.raises(CorpusError, match="do not lie on a face"):
            pose_by_hand(marked(np.array(wrong)), mask, CAMERA)


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("", "no JSON"),
        ("[]", "must hold"),
        ('{"points": {}}', "clip must be"),
        ('{"points": 3}', "must hold"),
        ('{"clip": "a", "frame": -1, "points": {}}', "whole number"),
        ('{"clip": "a", "frame": true, "points": {}}', "whole number"),
        ('{"clip": "a", "points": {}}', '"left eye, outer" must be two numbers'),
    ],
)
def test_what_is_no_file_of_points(tmp_path, text, says):
    path = tmp_path / "points.json"
    path.write_text(text)
    with pytest.raises(CorpusError, match=says) as caught:
        read_hand_points(path)
    assert str(path) in str(caught.value)


def test_wrong_points_are_named(tmp_path, mask):
    path = tmp_path / "points.json"
    good = document(seen(mask))
    for name, value in (("left nostril", [1]), ("left nostril", [1, "2"]), ("right nostril", None)):
        path.write_text(json.dumps({**good, "points": {**good["points"], name: value}}))
        with pytest.raises(CorpusError, match=name):
            read_hand_points(path)
    path.write_text(json.dumps({**good, "points": {**good["points"], "chin": [1, 2]}}))
    with pytest.raises(CorpusError, match="chin"):
        read_hand_points(path)
    with pytest.raises(CorpusError, match="cannot be read"):
        read_hand_points(tmp_path / "missing.json")


def test_points_rule_the_person(puppet_corpus, finder):
    """The mask of all clips passes through points of one frame, shifted against the network's."""
    video = puppet_corpus / "hopper1.mp4"
    plain = study_person([video], finder)
    picture = next(iter(read_video(video))).rgb
    finder.reset()
    landmarks = finder.find(picture).points
    points = np.stack([landmarks[list(ids), :2].mean(axis=0) for ids in MESH_POINTS.values()])
    hand = marked(points + [2.0, -1.0])
    ruled = study_person([video], finder, hand=hand)
    _, pose = mask_through(plain.mask, hand, plain.camera)
    off = np.linalg.norm(seen(ruled.mask, pose, ruled.camera) - hand.array, axis=1)
    assert off.max() < 1.0
    assert ruled.frames == plain.frames + 1
    with pytest.raises(FaceError, match="has no frame 9999"):
        study_person([video], finder, hand=replace(hand, frame=9999))
