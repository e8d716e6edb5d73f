"""The lip model on drawn mouths, whose lips are known."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from analysis.aam import spline_weights, to_points, to_vector
from analysis.aam_fit import LipFitter, fit_clip
from analysis.aam_points import (
    INNER_POINTS,
    LEFT,
    OUTER_POINTS,
    PLACES,
    RIGHT,
    contours_of_points,
    marks_in_crop,
    points_of_contours,
    read_marks,
)
from analysis.aam_training import FEWEST, LipTrainingSettings, choose_frames, train_lip_model
from analysis.build import BuildSettings, ShardSettings, build_database
from analysis.corpus_lips import LipSettings, find_lips, read_lip_marks
from database.errors import CorpusError, FaceError
from database.lip_model import LipModel
from database.mask import INNER_LIPS, OUTER_LIPS, Camera, Mask, MouthPatch, Poses, project
from database.reader import open_database

WIDTH, HEIGHT = 72, 64
SETTINGS = LipTrainingSettings(rounds=2, modes=8)


def lips(opening: float, spread: float, shift: tuple[float, float] = (0.0, 0.0)) -> np.ndarray:
    """The 20 points of a mouth, 36 pixels wide at rest."""
    half = 18.0 + spread
    outer = np.concatenate([np.linspace(-1, 1, 7), np.linspace(1, -1, 7)[1:-1]])
    inner = np.concatenate([np.linspace(-1, 1, 5), np.linspace(1, -1, 5)[1:-1]])
    up, down = -5.0 - 0.3 * opening, 6.0 + 0.7 * opening
    y = np.where(np.arange(12) <= 6, up, down) * np.sqrt(np.maximum(1 - outer**2, 0))
    gap = np.where(np.arange(8) <= 4, -0.3, 0.7) * opening * (1 - inner**2)
    points = np.concatenate(
        [np.stack([half * outer, y], axis=1), np.stack([0.85 * half * inner, gap], axis=1)]
    )
    return points + [WIDTH / 2 + shift[0], HEIGHT / 2 + shift[1]]


def draw(points: np.ndarray, rng: np.random.Generator, noise: float = 1.5) -> np.ndarray:
    """Red lips, a dark mouth, skin with a beard's spots that move along; noise on top."""
    big = 8
    contours = contours_of_points(points[None])[0]
    picture = np.empty((HEIGHT * big, WIDTH * big, 3), np.float32)
    picture[:] = (200, 150, 120)
    y, x = np.mgrid[: HEIGHT * big, : WIDTH * big] / big
    spots = np.sin(0.9 * x) * np.sin(0.8 * (y - 0.5 * (contours[5, 1] + contours[15, 1])))
    picture += 6 * spots[..., None]
    for part, colour in ((contours[:20], (170, 85, 85)), (contours[20:], (50, 25, 25))):
        corners = np.round(((part + 0.5) * big - 0.5) * 16).astype(np.int32)
        cv2.fillPoly(picture, [corners], colour, shift=4)
    small = cv2.resize(cv2.GaussianBlur(picture, (0, 0), big), (WIDTH, HEIGHT), None, 0, 0, 3)
    return np.clip(np.round(small + rng.normal(0, noise, small.shape)), 0, 255).astype(np.uint8)


def mouths(rng: np.random.Generator, n: int) -> np.ndarray:
    return np.stack(
        [
            lips(rng.uniform(0, 8), rng.normal(0, 1.0), tuple(rng.normal(0, 0.5, 2)))
            for _ in range(n)
        ]
    )


@pytest.fixture(scope="module")
def trained():
    """Train on rough points of 16 drawn mouths: the truth, and the training."""
    rng = np.random.default_rng(0)
    truth = mouths(rng, 16)
    crops = [draw(points, rng) for points in truth]
    rough = truth + rng.normal(0, 0.7, truth.shape)
    return truth, rough, train_lip_model(crops, rough, settings=SETTINGS)


def error(points: np.ndarray, truth: np.ndarray) -> float:
    return float(np.linalg.norm(points - truth, axis=-1).mean())


def test_training_points_are_refined(trained):
    truth, rough, result = trained
    assert error(result.points, truth) < 0.6 * error(rough, truth)
    assert result.moved[-1] < result.moved[0]


def test_lips_are_found_in_other_pictures(trained):
    rng = np.random.default_rng(1)
    fitter = LipFitter(trained[2].model)
    truth = mouths(rng, 10)
    starts = truth + rng.normal(0, 0.7, truth.shape)
    found = np.stack([fitter.fit(draw(t, rng), s)[0] for t, s in zip(truth, starts, strict=True)])
    assert error(found, truth) < 0.45
    height = np.ptp(found[:, :12, 1], axis=1), np.ptp(truth[:, :12, 1], axis=1)
    assert np.corrcoef(*height)[0, 1] > 0.99


def test_the_better_start_is_taken_and_nothing_followed_over_a_gap(trained):
    rng = np.random.default_rng(2)
    fitter = LipFitter(trained[2].model)
    truth = np.stack([lips(4.0, 0.0)] * 3)
    crops = [draw(t, rng) for t in truth]
    astray = truth + [[[0, 0]], [[14.0, 10.0]], [[0, 0]]]
    one = fit_clip(fitter, crops, astray, [4, 5, 6])
    assert one.followed[1] and error(one.points, truth) < 0.6
    apart = fit_clip(fitter, crops, astray, [4, 9, 12])
    assert not apart.followed.any() and error(apart.points[1], truth[1]) > 2


def test_what_is_no_mouth_is_not_found(trained):
    fitter = LipFitter(trained[2].model)
    noise = np.random.default_rng(3).integers(0, 255, (HEIGHT, WIDTH, 3)).astype(np.uint8)
    start = lips(3.0, 0.0)
    fit = fit_clip(fitter, [noise], start[None], [0])
    assert not fit.found[0]
    np.testing.assert_allclose(fit.points[0], fitter.expected(start), atol=1e-4)


def test_the_same_training_gives_the_same_model(trained):
    rng = np.random.default_rng(0)
    truth = mouths(rng, 16)
    crops = [draw(points, rng) for points in truth]
    rough = truth + rng.normal(0, 0.7, truth.shape)
    again = train_lip_model(crops, rough, settings=SETTINGS).model.as_arrays()
    for name, values in trained[2].model.as_arrays().items():
        np.testing.assert_array_equal(again[name], values)


def test_a_model_survives_being_taken_apart(trained):
    model = trained[2].model
    again = LipModel.from_arrays(model.as_arrays())
    crop, start = draw(lips(2.0, 1.0), np.random.default_rng(4)), lips(3.0, 0.0)
    np.testing.assert_array_equal(
        LipFitter(again).fit(crop, start)[0], LipFitter(model).fit(crop, start)[0]
    )


def test_too_few_frames_are_refused():
    with pytest.raises(FaceError, match=f"needs {FEWEST} frames"):
        train_lip_model([np.zeros((9, 9, 3), np.uint8)] * 2, np.zeros((2, 20, 2)))


def test_the_warp_carries_points_to_points():
    base = lips(3.0, 0.0)
    phi, slopes = spline_weights(base, base)
    np.testing.assert_allclose(phi, np.eye(20), atol=1e-9)
    there = np.random.default_rng(5).uniform(5, 60, (7, 2))
    plane, _ = spline_weights(base, there)
    np.testing.assert_allclose(plane.T @ base, there, atol=1e-8)
    step = 1e-5
    for d in range(2):
        ahead, _ = spline_weights(base, there + step * np.eye(2)[d])
        _, at = spline_weights(base, there)
        np.testing.assert_allclose((ahead - plane).T / step, at[d], atol=1e-3)
    assert slopes.shape == (2, 20, 20)
    np.testing.assert_array_equal(to_points(to_vector(base)), base)


def test_contours_pass_through_the_points():
    points = np.stack([lips(5.0, 1.0), lips(0.0, -2.0)])
    contours = contours_of_points(points)
    assert contours.shape == (2, 40, 2)
    np.testing.assert_allclose(points_of_contours(contours), points, atol=1e-9)
    assert len(set(PLACES)) == 20 and (LEFT, RIGHT) == (0, 6)


def test_frames_are_chosen_to_span_the_pictures():
    rng = np.random.default_rng(6)
    common = rng.normal(0, 0.1, (500, 3))
    rare = rng.normal(0, 0.1, (4, 3)) + [9, 0, 0]
    chosen = choose_frames(np.concatenate([common, rare]), 6)
    assert chosen == sorted(set(chosen)) and any(i >= 500 for i in chosen)
    assert choose_frames(common[:5], 40) == [0, 1, 2, 3, 4]


def face() -> tuple[Mask, Camera, Poses]:
    """A flat face whose mouth fills the crop, and three poses of it."""
    size = np.array([WIDTH, HEIGHT]) / 1.0
    vertices = np.zeros((468, 3), np.float32)
    at = contours_of_points(lips(3.0, 0.0)[None])[0] + 0.5
    vertices[[*OUTER_LIPS, *INNER_LIPS], :2] = at
    x, y = np.meshgrid([0.0, size[0]], [0.0, size[1]])
    grid = np.stack([x, y, np.zeros_like(x)], axis=-1).astype(np.float32)
    mask = Mask(vertices, MouthPatch(grid, WIDTH, HEIGHT))
    turns = np.array([[0, 0, 0], [0, 0.1, 0], [0, 0, 0.2]], np.float32)
    places = np.array([[-30, -30, 900], [-20, -35, 950], [-40, -20, 850]], np.float32)
    return mask, Camera.assumed(360, 288), Poses(turns, places)


def test_marks_go_into_the_crop():
    mask, camera, poses = face()
    ids = [*OUTER_POINTS, *INNER_POINTS]
    marks = {
        7: project(mask.vertices[ids], poses.matrix(1), camera),
        9: project(mask.vertices[ids], poses.matrix(2), camera),
        100: np.zeros((20, 2)),
    }
    found = marks_in_crop(marks, poses, [3, 7, 9], mask, camera)
    assert set(found) == {1, 2}
    for points in found.values():
        np.testing.assert_allclose(points, lips(3.0, 0.0), atol=1e-3)


def test_crop_and_mask_frame_are_one_place_each():
    patch = face()[0].patch
    points = np.random.default_rng(7).uniform(0, 50, (4, 3, 2))
    np.testing.assert_allclose(patch.from_crop(patch.to_crop(points)), points, atol=1e-9)


def test_lost_frames_take_the_face_mesh_and_say_so(trained):
    mask, camera, poses = face()
    rng = np.random.default_rng(8)
    meshes = np.stack([project(mask.vertices, poses.matrix(i), camera) for i in range(3)])
    crops = [draw(lips(3.0, 0.0), rng) for _ in range(3)]
    crops[1] = rng.integers(0, 255, crops[1].shape).astype(np.uint8)
    fitter = LipFitter(trained[2].model)
    lips_found = find_lips(fitter, crops, meshes, poses, mask, camera, np.arange(3))
    assert lips_found.found.tolist() == [1, 0, 1]
    in_crop = mask.patch.to_crop(lips_found.points)
    assert error(in_crop[[0, 2]], lips(3.0, 0.0)) < 0.5
    np.testing.assert_allclose(in_crop[1], fitter.expected(lips(3.0, 0.0)), atol=0.05)
    np.testing.assert_allclose(
        lips_found.geometry.height,
        np.ptp(contours_of_points(in_crop)[:, :20, 1], axis=1),
        atol=1e-3,
    )
    never = find_lips(fitter, crops, meshes, poses, mask, camera, np.arange(3), farthest=1e-4)
    assert not never.found.any()


def test_marks_are_read(tmp_path):
    file = tmp_path / "lips.csv"
    rows = [f"one,3,{k},{10 + k},{20.5}" for k in range(20)]
    file.write_text("\n".join(["clip,frame,point,x,y", *rows]) + "\n")
    marks = read_marks(file)
    assert list(marks) == [("one", 3)]
    np.testing.assert_array_equal(marks["one", 3][:, 0], 10 + np.arange(20))


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("", "line 1 must name the columns"),
        ("clip,frame,point,x,y\n", "holds no marked points"),
        ("clip,frame,point,x,y\na,0,0,1,one\n", "line 2 is not clip"),
        ("clip,frame,point,x,y\na,0,20,1,1\n", "line 2: points are 0 to 19"),
        ("clip,frame,point,x,y\na,0,0,1,nan\n", "line 2: points are 0 to 19"),
        ("clip,frame,point,x,y\na,0,0,1,1\n", "frame 0 of a lacks point 1"),
        ("clip,frame,point,x,y\na,0\n", "line 2 is not clip"),
        ("clip,frame\xff", "no csv file|must name the columns"),
    ],
)
def test_bad_marks_are_refused_in_one_line(tmp_path, text, said):
    file = tmp_path / "lips.csv"
    file.write_bytes(text.encode("latin-1"))
    with pytest.raises(CorpusError, match=said) as caught:
        read_marks(file)
    assert str(caught.value).startswith(f"{file}: ") and "\n" not in str(caught.value)
    with pytest.raises(CorpusError, match="cannot be read"):
        read_marks(tmp_path / "none.csv")


def test_settings_of_lips_are_checked_before_the_work(tmp_path):
    with pytest.raises(CorpusError, match="measured by one of mesh, aam, mesh-only"):
        read_lip_marks(LipSettings(source="eyes"), ["one"])
    assert read_lip_marks(LipSettings(), ["one"]) is None
    file = tmp_path / "lips.csv"
    file.write_text("\n".join(["clip,frame,point,x,y", *(f"two,3,{k},1,1" for k in range(20))]))
    assert read_lip_marks(LipSettings(marks=str(file)), ["one", "two"]) is not None
    with pytest.raises(CorpusError, match="marks no clip of this corpus; its first is 'two'"):
        read_lip_marks(LipSettings(marks=str(file)), ["one"])


def test_databases_without_a_lip_model_open(small_db):
    with open_database(small_db) as database:
        assert database.lips is None and database.lip_model is None


def test_builds_keep_their_lip_model(puppet_db):
    with open_database(puppet_db) as database:
        assert database.lips is not None
        assert len(database.lips.points) == len(database)
        said = database.report["lips"]
        assert said["fallen_back"] == int((database.lips.found == 0).sum())
        assert said["marked"] == 0 and FEWEST <= said["trained_on"] <= 40
        outer = database.lips.points[:, :12]
        assert np.corrcoef(np.ptp(outer[..., 1], axis=1), database.units.mouth_height)[0, 1] > 0.95


def build_again(puppet_corpus, puppet_db, output, lips):
    """Build from the clips that were analysed for the puppet's database."""
    kept = ShardSettings(puppet_db.with_name(f"{puppet_db.name}.shards"))
    return build_database(
        puppet_corpus, output, settings=BuildSettings(lips=lips), jobs=1, shards=kept
    )


def test_marks_rule_where_the_lips_are(puppet_corpus, puppet_db, tmp_path):
    """Two frames marked a tenth of the mouth's width lower move the lips of all."""
    with open_database(puppet_db) as database:
        name, ids = database.sequences.name[0], [*OUTER_POINTS, *INNER_POINTS]
        frames, meshes = database.units.frame[[2, 9]], database.landmarks([2, 9])[:, ids]
        before = database.lips.points
    down = 0.1 * np.linalg.norm(meshes[0, RIGHT] - meshes[0, LEFT])
    rows = [
        f"{name},{frame},{k},{x:.3f},{y + down:.3f}"
        for frame, mesh in zip(frames, meshes, strict=True)
        for k, (x, y) in enumerate(mesh)
    ]
    file = tmp_path / "lips.csv"
    file.write_text("\n".join(["clip,frame,point,x,y", *rows]))
    output = tmp_path / "marked.h5"
    report = build_again(puppet_corpus, puppet_db, output, LipSettings(marks=str(file)))
    assert report.reused == report.sequences
    with open_database(output) as database:
        assert database.report["lips"]["marked"] == 2
        lower = database.lips.points - before
        width = np.linalg.norm(before[:, RIGHT] - before[:, LEFT], axis=1)
    np.testing.assert_allclose(np.median(lower[..., 1].mean(axis=1) / width), 0.1, atol=0.02)
    assert abs(np.median(lower[..., 0])) < 0.02 * np.median(width)


def test_the_model_may_rule_or_be_left_out(puppet_corpus, puppet_db, tmp_path):
    build_again(puppet_corpus, puppet_db, tmp_path / "aam.h5", LipSettings(source="aam"))
    with open_database(tmp_path / "aam.h5") as aam, open_database(puppet_db) as ours:
        outer = aam.lips.points[:, :12]
        heights = aam.units.mouth_height, ours.units.mouth_height
        assert np.corrcoef(np.ptp(outer[..., 1], axis=1), heights[0])[0, 1] > 0.99
        assert np.corrcoef(*heights)[0, 1] > 0.95 and not np.array_equal(*heights)
        np.testing.assert_array_equal(aam.lips.points, ours.lips.points)
        np.testing.assert_array_equal(aam.units.pca, ours.units.pca)
    build_again(puppet_corpus, puppet_db, tmp_path / "mesh.h5", LipSettings(source="mesh-only"))
    with open_database(tmp_path / "mesh.h5") as mesh, open_database(puppet_db) as ours:
        assert mesh.lips is None and "lips" not in mesh.report
        np.testing.assert_array_equal(mesh.units.mouth_height, ours.units.mouth_height)
