"""The mask, poses, and crops with the head's motion taken out."""

import cv2
import numpy as np
import pytest

from analysis.motion import (
    CROP_HEIGHT,
    CROP_WIDTH,
    EYE_CORNER_DISTANCE,
    RIGID,
    CropSettings,
    MotionSettings,
    average_mask,
    estimate_poses,
    make_mask,
)
from database.errors import FaceError
from database.mask import OUTER_LIPS, Camera, Poses, cut_crop, project

CAMERA = Camera.assumed(512, 600)


@pytest.fixture
def mesh(finder, portrait):
    return finder.find(portrait).points


@pytest.fixture
def mask(mesh):
    return make_mask(mesh, CAMERA)


def known_poses(n=40, seed=0):
    """A head that turns by up to 12 degrees and wanders by centimetres, smoothly."""
    rng = np.random.default_rng(seed)
    t = np.arange(n) / 25
    waves = np.sin(
        2 * np.pi * rng.uniform(0.2, 0.5, 6)[:, None] * t + rng.uniform(0, 6, 6)[:, None]
    )
    rotations = np.radians([12, 12, 8])[:, None] * waves[:3]
    translations = np.array([30, 20, 60])[:, None] * waves[3:] + [[0], [0], [900]]
    return Poses(rotations.T.astype(np.float32), translations.T.astype(np.float32))


def landmarks_of(mask, poses, camera=CAMERA, noise=0.0):
    points = np.stack([project(mask.vertices, poses.matrix(i), camera) for i in range(len(poses))])
    return (points + np.random.default_rng(1).normal(0, noise, points.shape)).astype(np.float32)


def angle_between(a, b):
    turn = a[:, :3] @ b[:, :3].T
    return np.degrees(np.arccos(np.clip((np.trace(turn) - 1) / 2, -1, 1)))


def test_the_mask_is_metric(mask):
    assert np.linalg.norm(mask.vertices[33] - mask.vertices[263]) == pytest.approx(
        EYE_CORNER_DISTANCE, rel=0.02
    )
    # An adult's face: the rest follows from the one length.
    assert 100 < mask.vertices[152, 1] - mask.vertices[10, 1] < 180
    assert 40 < np.linalg.norm(mask.vertices[61] - mask.vertices[291]) < 65


def test_the_mask_is_upright(mask):
    eyes = mask.vertices[263] - mask.vertices[33]
    assert abs(np.degrees(np.arctan2(eyes[1], eyes[0]))) < 2
    assert abs(np.degrees(np.arctan2(eyes[2], eyes[0]))) < 6
    assert mask.vertices[[1, 4]].mean(0)[2] < mask.vertices[:, 2].mean(), "the nose is nearest"
    np.testing.assert_allclose(mask.vertices[list(RIGID)].mean(axis=0), 0, atol=1e-3)


def test_a_tilted_picture_gives_the_same_mask(finder, portrait, mask):
    turn = cv2.getRotationMatrix2D((268, 240), 12, 1.0)
    picture = cv2.warpAffine(portrait, turn, (512, 600), flags=cv2.INTER_CUBIC)
    tilted = make_mask(finder.find(picture).points, CAMERA)
    apart = np.linalg.norm(tilted.vertices - mask.vertices, axis=1)
    assert np.median(apart) < 2.0


def test_one_bad_mesh_does_not_spoil_the_mask(mesh, mask):
    """Frames near and far, turned in the plane and noisy, one of them grimacing."""
    rng = np.random.default_rng(0)
    meshes = []
    for angle, scale in ((0, 1.0), (6, 0.8), (-5, 1.1), (3, 0.9), (0, 1.0)):
        turn = cv2.getRotationMatrix2D((268, 240), angle, scale)
        flat = mesh[:, :2] @ turn[:, :2].T + turn[:, 2]
        meshes.append(np.column_stack([flat, mesh[:, 2] * scale]) + rng.normal(0, 0.5, mesh.shape))
    meshes[4][:, :2] += rng.normal(0, 12, (468, 2))
    found = average_mask(meshes, [CAMERA] * 5)
    apart = np.linalg.norm(found.vertices - mask.vertices, axis=1)
    assert np.median(apart) < 1.2, "mm, of which 0.6 a single frame's noise"
    alone = np.linalg.norm(make_mask(meshes[4], CAMERA).vertices - mask.vertices, axis=1)
    assert np.median(apart) < 0.2 * np.median(alone)
    eyes = found.vertices[33] - found.vertices[263]
    assert np.linalg.norm(eyes) == pytest.approx(EYE_CORNER_DISTANCE, rel=1e-5)
    np.testing.assert_allclose(found.vertices[list(RIGID)].mean(axis=0), 0, atol=1e-3)


@pytest.mark.parametrize("size", [0.3, 0.6, 1.0, 3.0, 8.0])
def test_crops_are_as_large_as_the_footage_carries(mesh, size):
    camera = CAMERA.scaled_to(round(512 * size), round(600 * size))
    patch = make_mask(mesh * np.float32(size), camera).patch
    recorded = size * 126 / EYE_CORNER_DISTANCE * patch.width_mm
    assert patch.crop_width <= CROP_WIDTH and patch.crop_height <= CROP_HEIGHT
    assert patch.crop_width % 4 == 0
    assert patch.crop_height / patch.crop_width == pytest.approx(CROP_HEIGHT / CROP_WIDTH, abs=0.02)
    assert patch.height_mm / patch.width_mm == pytest.approx(patch.crop_height / patch.crop_width)
    if size >= 3:
        assert (patch.crop_width, patch.crop_height) == (CROP_WIDTH, CROP_HEIGHT)
    else:
        assert recorded < patch.crop_width < 1.25 * recorded + 4


def test_the_patch_holds_the_mouth(mask):
    patch = mask.patch
    lips = patch.to_crop(mask.vertices[list(OUTER_LIPS)])
    width = np.ptp(lips[:, 0])
    assert width == pytest.approx(patch.crop_width / 2, rel=0.02), "2.0 times the mouth's width"
    assert lips.min() > 0.15 * patch.crop_width
    assert (lips.max(axis=0) < [0.85 * patch.crop_width, 0.7 * patch.crop_height]).all()
    assert lips[:, 0].mean() == pytest.approx((patch.crop_width - 1) / 2, abs=0.03 * width)
    # The chin lies inside, and the surface is the face's.
    assert patch.to_crop(mask.vertices[152])[1] < 1.1 * patch.crop_height
    grid = patch.grid.reshape(-1, 3)
    nearest = np.linalg.norm(grid[:, None, :2] - mask.vertices[None, [0, 17], :2], axis=2).argmin(0)
    assert np.abs(grid[nearest, 2] - mask.vertices[[0, 17], 2]).max() < 6


def test_crop_settings_count(mesh):
    wide = make_mask(mesh, CAMERA, CropSettings(width_in_mouths=3.0)).patch
    plain = make_mask(mesh, CAMERA).patch
    small = make_mask(mesh, CAMERA, CropSettings(largest=64)).patch
    assert wide.width_mm == pytest.approx(1.5 * plain.width_mm, rel=0.01)
    assert (small.crop_width, small.crop_height) == (64, 68)
    assert small.width_mm == pytest.approx(plain.width_mm)


@pytest.mark.parametrize("noise", [0.0, 0.5])
def test_known_poses_are_recovered(mask, noise):
    truth = known_poses()
    found, good = estimate_poses(landmarks_of(mask, truth, noise=noise), mask, CAMERA)
    assert good.all()
    angles = [angle_between(found.matrix(i), truth.matrix(i)) for i in range(len(truth))]
    apart = np.abs(found.translations - truth.translations)
    # Half a pixel of noise is a third of a millimetre; depth is seen least.
    assert np.mean(angles) < 0.5 and max(angles) < 1.5
    assert apart[:, :2].mean() < 1.0
    assert apart[:, 2].mean() < 0.01 * 900


def test_speech_does_not_move_the_pose(mask):
    truth = known_poses(12)
    points = landmarks_of(mask, truth)
    still, _ = estimate_poses(points, mask, CAMERA)
    mouth = [i for i in range(468) if mask.vertices[i, 1] > 35 and i not in RIGID]
    points[:, mouth] += np.random.default_rng(2).uniform(-9, 9, (12, len(mouth), 2))
    talking, good = estimate_poses(points, mask, CAMERA)
    assert good.all()
    np.testing.assert_array_equal(talking.rotations, still.rotations)
    np.testing.assert_array_equal(talking.translations, still.translations)


def test_smoothing_steadies_the_pose(mask):
    truth = known_poses(40)
    points = landmarks_of(mask, truth, noise=1.0)

    def jitter(settings):
        found, _ = estimate_poses(points, mask, CAMERA, settings)
        return np.std(np.diff(found.rotations - truth.rotations, axis=0))

    assert jitter(MotionSettings()) < 0.5 * jitter(MotionSettings(smoothing=1))


def test_landmarks_that_are_no_face_are_flagged(mask):
    points = landmarks_of(mask, known_poses(20))
    rng = np.random.default_rng(4)
    points[8] = rng.uniform(0, 512, (468, 2))
    _, good = estimate_poses(points, mask, CAMERA, MotionSettings(smoothing=1))
    assert not good[8]
    assert good[:8].all() and good[9:].all()


def test_no_face_in_any_frame(mask):
    points = np.random.default_rng(5).uniform(0, 512, (6, 468, 2))
    with pytest.raises(FaceError, match="no frame"):
        estimate_poses(points, mask, CAMERA, MotionSettings(smoothing=1))


@pytest.mark.parametrize("n", [1, 2, 3, 4])
def test_short_runs(mask, n):
    truth = known_poses(n)
    found, good = estimate_poses(landmarks_of(mask, truth), mask, CAMERA)
    assert good.all() and len(found) == n
    assert angle_between(found.matrix(n - 1), truth.matrix(n - 1)) < 1


def test_other_people_far_and_near_start_well(mask):
    """The first guess of the distance is right within the eyes' foreshortening."""
    for distance in (300, 900, 3000):
        truth = Poses(np.zeros((1, 3), np.float32), np.array([[50, -40, distance]], np.float32))
        found, good = estimate_poses(landmarks_of(mask, truth), mask, CAMERA)
        assert good.all()
        np.testing.assert_allclose(found.translations, truth.translations, atol=0.002 * distance)


def test_the_crop_does_not_move_with_the_head(finder, portrait, mask):
    """Pictures of one still face moved in the plane all give the still picture's crop."""
    finder.reset()
    still_points = finder.find(portrait).points[None, :, :2]
    pose, _ = estimate_poses(still_points, mask, CAMERA)
    still = cut_crop(portrait, mask.patch, pose.matrix(0), CAMERA).astype(float)
    for angle, scale, shift in ((5, 1.0, (20, -15)), (-8, 1.08, (-10, 8)), (0, 0.93, (3, 4))):
        move = cv2.getRotationMatrix2D((268, 240), angle, scale)
        move[:, 2] += shift
        picture = cv2.warpAffine(
            portrait, move, (512, 600), flags=cv2.INTER_CUBIC, borderMode=cv2.BORDER_REPLICATE
        )
        points = (still_points[0] @ move[:, :2].T + move[:, 2])[None]
        moved, good = estimate_poses(points, mask, CAMERA)
        assert good.all()
        crop = cut_crop(picture, mask.patch, moved.matrix(0), CAMERA).astype(float)
        uncompensated = cut_crop(picture, mask.patch, pose.matrix(0), CAMERA).astype(float)
        # Twice resampled, and a perspective camera sees a shift as a slight turn.
        assert np.abs(crop - still).mean() < 4.0
        assert np.abs(crop - still).mean() < 0.35 * np.abs(uncompensated - still).mean()


def test_the_crop_stays_on_the_tracked_mouth(finder, portrait, puppet):
    """The same with found landmarks: the mouth of a swaying head stands still in its crops."""
    turns = puppet.head_motion(25, seed=2, amount=2.0)
    size = (puppet.WIDTH, puppet.HEIGHT)
    pictures = [cv2.warpAffine(portrait, t, size, flags=cv2.INTER_CUBIC) for t in turns]
    points = np.stack([finder.find(p).points for p in pictures])
    camera = Camera.assumed(*size)
    mask = make_mask(points[0], camera)
    poses, good = estimate_poses(points[:, :, :2], mask, camera)
    assert good.all()
    crops = np.stack(
        [cut_crop(p, mask.patch, poses.matrix(i), camera) for i, p in enumerate(pictures)]
    ).astype(np.float32)
    first = cv2.cvtColor(crops[0], cv2.COLOR_RGB2GRAY)
    wander = [
        cv2.phaseCorrelate(first, cv2.cvtColor(c, cv2.COLOR_RGB2GRAY), None)[0] for c in crops
    ]
    moved = np.ptp([t @ [268, 275, 1] for t in turns], axis=0).max()
    assert moved > 6
    assert np.abs(wander).max() < 1.5, "pixels of the crop"
