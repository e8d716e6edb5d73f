"""Head motion from gradients: true where it is known, honest where the face is hidden."""

import importlib.util
import sys
from dataclasses import fields, replace
from pathlib import Path

import cv2
import numpy as np
import pytest

import analysis.clip
import analysis.head_motion
from analysis.clip import KeptFrames, track_face
from analysis.gradient_motion import GradientTracker
from analysis.head_motion import HeadFollower
from analysis.motion import GradientSettings, MotionSettings, estimate_poses, make_mask
from analysis.person import study_person
from analysis.photometric import REGIONS, rigid_surface
from analysis.reference import from_stored, to_stored
from analysis.rigid import from_six, inverse, joined, to_six, usual_step
from analysis.surface_texture import face_picture
from database.checks import check_rigid
from database.errors import CorpusError
from database.mask import INNER_LIPS, OUTER_LIPS, Camera, project
from database.media import read_video
from database.schema import RIGID_REGIONS

N = 14


def _benchmark(name):
    if name not in sys.modules:
        path = Path(__file__).parent.parent / "benchmarks" / f"{name}.py"
        spec = importlib.util.spec_from_file_location(name, path)
        module = importlib.util.module_from_spec(spec)
        sys.modules[name] = module
        spec.loader.exec_module(module)
    return sys.modules[name]


class Scene:
    """The portrait at half its size: a mask, a camera, and films of known motion."""

    def __init__(self, finder, puppet):
        faces = [puppet.draw(o, r, t) for o, r, t in ((0, 0, 0), (0.8, 0, 0.5), (0.4, 0.9, 0))]
        self.frames = [
            cv2.resize(f[:440, 60:480], None, fx=0.6, fy=0.6, interpolation=cv2.INTER_AREA)
            for f in faces
        ]
        height, width = self.frames[0].shape[:2]
        self.camera = Camera.assumed(width, height)
        points = finder.find(self.frames[0]).points
        self.mask = make_mask(points, self.camera)
        pose, _ = estimate_poses(points[None, :, :2], self.mask, self.camera)
        self.base = pose.matrix(0)
        self.drawing = _benchmark("moving_face")

    def truth(self, n=N, seed=0):
        return self.drawing.prescribed_poses(self.base, n, seed, fps=10)

    def film(self, truth, **disturbance):
        chosen = self.drawing.Disturbance(**{"noise": 2, "blur": 0.5, "light": 100, **disturbance})
        poses = np.repeat(self.base[None], len(self.frames), axis=0)
        return self.drawing.moving_face(
            self.frames, poses, truth, self.mask, self.camera, chosen, seed=1
        )

    def landmarks(self, truth, noise=0.7, shift=(0, 0), seed=2):
        rng = np.random.default_rng(seed)
        points = np.stack([project(self.mask.vertices, pose, self.camera) for pose in truth])
        return (points + rng.normal(0, noise, points.shape) + shift).astype(np.float32)

    def starts(self, landmarks, smoothing=1):
        settings = MotionSettings(smoothing=smoothing)
        found, good = estimate_poses(landmarks, self.mask, self.camera, settings)
        return np.stack([found.matrix(i) for i in range(len(found))]), good

    def pictures(self, film, landmarks):
        return [face_picture(p, q, self.camera) for p, q in zip(film, landmarks, strict=True)]

    def tracker(self, **more):
        return GradientTracker(self.mask, **more)

    def errors(self, found, truth):
        """Degrees; % of the face's width across; % of the distance."""
        return _benchmark("motion").errors(found, truth, self.mask)


@pytest.fixture(scope="module")
def scene(face_models, puppet):
    from analysis.face import FaceFinder

    return Scene(FaceFinder(face_models), puppet)


@pytest.fixture(scope="module")
def filmed(scene):
    truth = scene.truth()
    film = scene.film(truth)
    landmarks = scene.landmarks(truth)
    return truth, film, landmarks


def test_motions_are_joined_and_undone():
    rng = np.random.default_rng(0)
    a, b = from_six(rng.normal(0, 0.3, 6)), from_six(rng.normal(0, 0.3, 6))
    point = rng.normal(0, 50, 3)
    moved = joined(a, b)[:, :3] @ point + joined(a, b)[:, 3]
    np.testing.assert_allclose(moved, a[:, :3] @ (b[:, :3] @ point + b[:, 3]) + a[:, 3])
    np.testing.assert_allclose(joined(inverse(a), a), np.eye(3, 4), atol=1e-12)
    np.testing.assert_allclose(from_six(to_six(a)), a, atol=1e-12)
    starts = np.stack([from_six(rng.normal(0, 0.3, 6)) for _ in range(9)])
    ends = np.stack([joined(s, b) for s in starts])
    ends[0] = a  # One that is wrong does not count.
    np.testing.assert_allclose(usual_step(starts, ends), b, atol=1e-9)


def test_the_surface_keeps_off_what_moves(scene):
    surface = rigid_surface(scene.mask, 2.0)
    assert len(surface) > 500
    np.testing.assert_allclose(np.linalg.norm(surface.normals, axis=1), 1, atol=1e-5)
    assert (surface.normals[:, 2] < 0).all(), "out of the face is towards the camera"
    assert set(surface.region) == set(range(len(REGIONS)))
    vertices = scene.mask.vertices
    lips = vertices[list(OUTER_LIPS + INNER_LIPS)]
    assert surface.points[:, 1].max() < lips[:, 1].min(), "nothing as low as the lips"
    for lid in (159, 145, 386, 374):
        assert np.linalg.norm(surface.points[:, :2] - vertices[lid, :2], axis=1).min() > 2
    left, right = (surface.points[surface.region == k, 0].mean() for k in (1, 2))
    assert left < 0 < right
    white = surface.squares(5.0)
    assert 0.4 < white.mean() < 0.6
    assert len(surface.part(white)) == white.sum()


def test_known_motion_is_found(scene, filmed):
    truth, film, landmarks = filmed
    starts, good = scene.starts(landmarks, smoothing=7)
    followed = scene.tracker().follow(scene.pictures(film, landmarks), starts, good, {0: truth[0]})
    assert not followed.lost.any() and followed.likeness.min() > 0.95
    turned, across, deep = np.median(scene.errors(followed.poses, truth), axis=0)
    assert turned < 0.3 and across < 0.3 and deep < 0.3
    by_points = np.median(scene.errors(starts, truth), axis=0)
    assert turned < by_points[0]


def test_the_mean_of_the_points_says_where_the_mask_sits(scene, filmed):
    truth, film, landmarks = filmed
    starts, good = scene.starts(landmarks)
    followed = scene.tracker().follow(scene.pictures(film, landmarks), starts, good)
    turned, across, deep = np.median(scene.errors(followed.poses, truth), axis=0)
    assert turned < 1.0 and across < 0.5 and deep < 0.6


def test_a_face_that_moves_for_one_frame_is_followed_there(scene):
    """Stillness does not come from smoothing: a jump of two pixels is all there, and only there."""
    truth = np.repeat(scene.base[None], 9, axis=0)
    jump = 2 * scene.base[2, 3] / scene.camera.focal
    truth[4, 0, 3] += jump
    landmarks = scene.landmarks(truth, noise=0.3)
    starts, good = scene.starts(landmarks)
    film = scene.film(truth, light=0, blur=0)
    followed = scene.tracker().follow(scene.pictures(film, landmarks), starts, good)
    x = followed.poses[:, 0, 3]
    others = np.delete(x, 4)
    assert x[4] - np.median(others) == pytest.approx(jump, abs=0.1 * jump)
    assert others.std() < 0.05 * jump


@pytest.mark.parametrize("blur", [0.8, 1.2])
def test_a_blurred_frame_is_not_taken_for_a_turned_head(scene, blur):
    """Without a blur in the equations it turns by 0.36 and 0.81 degrees."""
    truth = np.repeat(scene.base[None], 9, axis=0)
    landmarks = scene.landmarks(truth, noise=0.3)
    starts, good = scene.starts(landmarks)
    film = scene.film(truth, light=0, blur=0, noise=0.5)
    film[4] = cv2.GaussianBlur(film[4], (0, 0), blur)
    followed = scene.tracker().follow(scene.pictures(film, landmarks), starts, good)
    turned = to_six(joined(inverse(followed.poses[0]), followed.poses[4]))[:3]
    assert np.degrees(np.linalg.norm(turned)) < 0.15
    assert not followed.lost.any()


def test_a_hidden_face_is_said_to_be_lost_and_found_again(scene, filmed):
    truth, film, landmarks = filmed
    hidden = [p.copy() for p in film]
    rng = np.random.default_rng(5)
    for i in (6, 7):
        x, y = landmarks[i][9].astype(int)
        shape = hidden[i][y - 40 : y + 50, x - 60 : x + 60].shape
        hidden[i][y - 40 : y + 50, x - 60 : x + 60] = rng.integers(60, 200, shape)
    starts, good = scene.starts(landmarks)
    pictures = scene.pictures(hidden, landmarks)
    followed = scene.tracker().follow(pictures, starts, good, {0: truth[0]})
    np.testing.assert_array_equal(np.flatnonzero(followed.lost), [6, 7])
    seen = ~followed.lost
    # The points' pose, put on the face as the rest is.
    step = usual_step(starts[seen], followed.poses[seen])
    for i in (6, 7):
        np.testing.assert_allclose(followed.poses[i], joined(starts[i], step))
    assert np.median(scene.errors(followed.poses, truth)[seen, 0]) < 0.4


def test_a_texture_that_agrees_elsewhere_is_not_believed(scene, filmed):
    """Feature points far from where gradients find the face: the two cannot both be right."""
    _, film, landmarks = filmed
    starts, good = scene.starts(landmarks)
    eyes = np.linalg.norm(landmarks[0, 33] - landmarks[0, 263])
    away = starts.copy()
    away[5, 0, 3] += 0.2 * eyes * away[5, 2, 3] / scene.camera.focal
    followed = scene.tracker().follow(scene.pictures(film, landmarks), away, good)
    assert followed.lost[5] and followed.lost.sum() == 1
    step = usual_step(np.delete(away, 5, 0), np.delete(followed.poses, 5, 0))
    np.testing.assert_allclose(followed.poses[5], joined(away[5], step))


def test_without_points_the_frame_beside_is_the_start(scene, filmed):
    truth, film, landmarks = filmed
    starts, good = scene.starts(landmarks)
    bad = starts.copy()
    bad[5:8] = 0
    trusted = good.copy()
    trusted[5:8] = False
    pictures = scene.pictures(film, landmarks)
    whole = scene.tracker().follow(pictures, starts, good)
    followed = scene.tracker().follow(pictures, bad, trusted)
    assert not followed.lost.any()
    apart = np.abs(scene.errors(followed.poses, truth) - scene.errors(whole.poses, truth))
    assert apart[:, 0].max() < 0.5


def test_the_reference_puts_two_clips_on_the_same_place(scene):
    """Feature points that err by a pixel this way and that: the reference takes no part in it."""
    truth = scene.truth(10, seed=3)
    points = scene.landmarks(truth, 0.3)
    starts, good = scene.starts(points)
    first = scene.tracker()
    first.follow(scene.pictures(scene.film(truth), points), starts, good)
    places = {}
    for shift in ((1.5, -1.0), (-1.5, 1.0)):
        moved = scene.landmarks(truth, 0.3, shift)
        film = scene.film(truth, noise=3)
        starts, good = scene.starts(moved)
        for name, reference in (("points", None), ("reference", first.reference)):
            tracker = scene.tracker(reference=reference)
            poses = tracker.follow(scene.pictures(film, moved), starts, good).poses
            places.setdefault(name, []).append(poses[:, :2, 3].mean(axis=0))
    apart = {name: np.linalg.norm(a - b) for name, (a, b) in places.items()}
    pixel = scene.base[2, 3] / scene.camera.focal
    assert apart["points"] > 2.5 * pixel
    assert apart["reference"] < 0.2 * pixel


def test_a_reference_comes_back_from_the_database(scene, filmed):
    _, film, landmarks = filmed
    starts, good = scene.starts(landmarks)
    tracker = scene.tracker()
    tracker.follow(scene.pictures(film, landmarks), starts, good)
    stored = to_stored(tracker.reference)
    check_rigid(stored)
    assert len(REGIONS) == RIGID_REGIONS
    again = from_stored(stored)
    for was, now in zip(tracker.reference.views, again.views, strict=True):
        np.testing.assert_array_equal(was.direction, now.direction)
        for one, other in zip(was.levels, now.levels, strict=True):
            for field in fields(one):
                value = getattr(one, field.name)
                np.testing.assert_array_equal(value, getattr(other, field.name))
                assert value.dtype == getattr(other, field.name).dtype
    assert to_stored(None) is None and from_stored(None) is None
    with pytest.raises(ValueError, match="regions"):
        check_rigid(replace(stored, region=stored.region + 4))
    with pytest.raises(ValueError, match="5th point"):
        check_rigid(replace(stored, points=stored.points[:-6]))


def test_a_head_that_turns_far_gets_more_views(scene):
    t = np.linspace(-1, 1, 15)
    truth = np.stack(
        [joined(scene.base, from_six(np.array([0, np.radians(26) * a, 0, 0, 0, 0]))) for a in t]
    )
    landmarks = scene.landmarks(truth, 0.5)
    starts, good = scene.starts(landmarks)
    film = scene.film(truth, light=0)
    tracker = scene.tracker()
    followed = tracker.follow(scene.pictures(film, landmarks), starts, good, {7: truth[7]})
    assert len(tracker.reference.views) > 1
    assert followed.lost.sum() <= 2
    seen = ~followed.lost
    assert np.median(scene.errors(followed.poses, truth)[seen, 0]) < 0.6


def test_blocks_and_runs_keep_the_frame_numbers(scene, filmed, monkeypatch):
    truth, film, landmarks = filmed
    numbers = [*range(3, 10), *range(20, 26), 40]

    def motion(block):
        monkeypatch.setattr(analysis.head_motion, "BLOCK", block)
        follower = HeadFollower(scene.mask, scene.camera)
        for k, number in enumerate(numbers):
            follower.add(number, film[k], landmarks[k])
        return follower.finish()

    whole, parts = motion(100), motion(4)
    for found in (whole, parts):
        # One frame alone is a false alarm.
        np.testing.assert_array_equal(found.numbers, numbers[:-1])
        np.testing.assert_array_equal(found.landmarks, landmarks[:-1])
        assert not found.lost.any()
        poses = np.stack([found.poses.matrix(i) for i in range(len(found.numbers))])
        assert np.median(scene.errors(poses, truth[:-1])[:, 1]) < 0.8
    np.testing.assert_allclose(parts.poses.translations, whole.poses.translations, atol=12)


def test_nothing_followed():
    follower = HeadFollower.__new__(HeadFollower)
    HeadFollower.__init__(follower, None, Camera.assumed(10, 10), MotionSettings(method="points"))
    found = follower.finish()
    assert len(found.numbers) == len(found.poses) == len(found.lost) == 0


def test_large_pictures_are_reduced(scene):
    points = project(scene.mask.vertices, scene.base, scene.camera)
    small, camera = face_picture(scene.frames[0], points, scene.camera)
    big = cv2.resize(scene.frames[0], None, fx=3, fy=3)
    wide = scene.camera.scaled_to(big.shape[1], big.shape[0])
    reduced, reduced_camera = face_picture(big, (points + 0.5) * 3 - 0.5, wide)
    assert small.ndim == reduced.ndim == 2
    eyes = np.linalg.norm(points[33] - points[263])
    assert reduced.shape[0] == pytest.approx(small.shape[0] * 110 / eyes, rel=0.03)
    # The mask is seen at the same place of the face in both.
    for index in (1, 33, 263):
        seen = [
            project(scene.mask.vertices[index], scene.base, Camera(*c, 1, 1))
            for c in (camera, reduced_camera)
        ]
        ratio = reduced_camera[0] / camera[0]
        assert np.abs((seen[0] + 0.5) * ratio - 0.5 - seen[1]).max() < 2 * ratio


def test_settings_name_a_known_method():
    with pytest.raises(CorpusError, match="use gradients or points"):
        MotionSettings(method="optical flow")
    assert MotionSettings().method == "gradients"
    assert MotionSettings().gradients == GradientSettings()


def test_the_mask_is_made_of_several_frames(puppet_corpus, finder):
    videos = sorted(puppet_corpus.glob("*.mp4"))[:2]
    person = study_person(videos, finder)
    assert person.frames >= 4
    assert person.reference is not None and person.reference.views
    other = study_person(videos[1:], finder)
    assert other.camera == person.camera
    apart = np.linalg.norm(other.mask.vertices - person.mask.vertices, axis=1)
    assert 0 < np.median(apart) < 1.5, "mm"


def test_a_clip_is_tracked_by_either_method(puppet_corpus, finder):
    video = puppet_corpus / "hopper1.mp4"
    person = study_person([video], finder)
    by_points = track_face(
        video, person.mask, person.camera, finder, settings=MotionSettings(method="points")
    )
    tracked = track_face(video, person.mask, person.camera, finder, reference=person.reference)
    np.testing.assert_array_equal(tracked.numbers, by_points.numbers)
    assert not tracked.lost.any() and not by_points.lost.any()
    assert not np.array_equal(tracked.poses.translations, by_points.poses.translations)
    assert by_points.by_points() == []
    some = replace(tracked, lost=np.arange(len(tracked.numbers)) < 2)
    assert some.by_points() == tracked.numbers[:2].tolist()
    known = {0: tracked.poses.matrix(0)}
    known[0][0, 3] += 2.0
    told = track_face(video, person.mask, person.camera, finder, known=known)
    assert told.poses.translations[0, 0] == pytest.approx(known[0][0, 3], abs=0.2)


def test_real_faces_stand_stiller_than_points_hold_them(corpus, finder):
    """One clip of the benchmark, fitted on one half of the chessboard and judged on the other."""
    motion = _benchmark("motion")
    video = sorted(corpus.glob("*.mpg"))[0]
    frames = [f.rgb.copy() for f in read_video(video)][:40]
    person = study_person([video], finder)
    clip = motion.look("clip", frames, finder, person.camera)
    surface = rigid_surface(person.mask, 1.5)
    white = surface.squares(motion.SQUARE)
    found = motion.follow(clip, person, surface.part(white))
    judged = surface.part(~white)
    by_points, by_gradients = (
        motion.unsteadiness(clip, poses, judged) for poses in (found.points, found.gradients)
    )
    assert found.lost == 0
    assert by_gradients < 0.75 * by_points


def test_broken_frames_are_left_out(corpus, finder):
    """The clip begins with twelve frames of grey rubble; the mesh takes four of them for faces."""
    others = [p for p in sorted(corpus.glob("*.mpg")) if p.stem != "bwwuzn"][:2]
    person = study_person(others, finder)
    tracked = track_face(
        corpus / "bwwuzn.mpg", person.mask, person.camera, finder, reference=person.reference
    )
    assert tracked.missing() == list(range(12))
    assert tracked.by_points() == []


def test_frames_of_a_short_video_are_read_once_and_of_a_long_one_twice(puppet_corpus, monkeypatch):
    video = puppet_corpus / "hopper1.mp4"
    frames = KeptFrames(video)
    first, second = list(frames), list(frames)
    assert [n for n, _ in first] == [n for n, _ in second] == list(range(len(first)))
    assert all(a is b for (_, a), (_, b) in zip(first, second, strict=True))
    monkeypatch.setattr(analysis.clip, "MOST_KEPT", 5 * first[0][1].nbytes)
    frames = KeptFrames(video)
    for again in (list(frames), list(frames)):
        assert len(again) == len(first)
        assert all(np.array_equal(a, b) for (_, a), (_, b) in zip(first, again, strict=True))
