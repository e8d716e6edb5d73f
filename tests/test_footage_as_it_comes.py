"""Footage as cameras write it: turned, interlaced, of variable rate."""

from fractions import Fraction

import av
import cv2
import numpy as np
import pytest

from analysis.face import FaceFinder
from database.media import probe, read_video
from database.orientation import Orientation
from database.planes import Colour, Planes, planes_to_rgb, rgb_to_planes


def write(path, pictures, *, rate=25, codec="libx264", turn=None, stamps=None, options=None):
    """RGB pictures as a video file, through PyAV alone; of each the planes that went in."""
    height, width = pictures[0].shape[:2]
    with av.open(str(path), "w") as container:
        stream = container.add_stream(codec, rate=rate, options=options or {"crf": "8"})
        stream.width, stream.height, stream.pix_fmt = width, height, "yuv420p"
        stream.codec_context.time_base = stream.time_base = Fraction(1, 1000)
        if turn is not None:
            stream.set_display_rotation(turn)
        for i, picture in enumerate(pictures):
            planes = rgb_to_planes(picture, Colour())
            frame = av.VideoFrame.from_ndarray(planes.packed(), format="yuv420p")
            frame.pts = round(1000 * i / rate) if stamps is None else stamps[i]
            frame.time_base = Fraction(1, 1000)
            container.mux(stream.encode(frame))
        container.mux(stream.encode(None))
    return path


@pytest.fixture(scope="module")
def scene(portrait):
    """Give a picture that no turn or mirror leaves as it is."""
    picture = np.full((96, 128, 3), 60, np.uint8)
    picture[8:88, 10:80] = cv2.resize(portrait, (70, 80), interpolation=cv2.INTER_AREA)
    picture[:20, 100:] = (200, 30, 30)
    return picture


@pytest.mark.parametrize(("turn", "quarters"), [(0, 0), (90, 1), (180, 2), (-90, 3), (270, 3)])
def test_the_display_matrix_is_honoured(tmp_path, scene, turn, quarters):
    path = write(tmp_path / "a.mp4", [scene] * 5, turn=turn)
    wanted = np.rot90(scene, quarters)
    info = probe(path)
    assert (info.height, info.width) == wanted.shape[:2]
    frames = list(read_video(path))
    assert len(frames) == 5
    for frame in frames:
        assert frame.rgb.shape == wanted.shape
        assert np.abs(frame.rgb.astype(int) - wanted).mean() < 4


def test_turning_moves_samples_and_changes_none():
    rng = np.random.default_rng(2)
    planes = Planes(
        rng.integers(0, 256, (4, 6), np.uint8),
        rng.integers(0, 256, (2, 3), np.uint8),
        rng.integers(0, 256, (2, 3), np.uint8),
    )
    for turn, expected in (
        (Orientation(), planes.y),
        (Orientation(False, True, False), planes.y[:, ::-1]),
        (Orientation(False, True, True), np.rot90(planes.y, 2)),
        (Orientation(True, False, True), np.rot90(planes.y)),
        (Orientation(True, False, False), planes.y.T),
    ):
        turned = turn.turned(planes)
        np.testing.assert_array_equal(turned.y, expected)
        assert turned.u.shape == turned.v.shape == (expected.shape[0] // 2, expected.shape[1] // 2)
        assert turn.size(6, 4) == expected.shape[::-1]


def test_a_face_filmed_upright_by_a_telephone_is_found(tmp_path, face_models, portrait):
    sensor = np.ascontiguousarray(np.rot90(portrait, 3))
    path = write(tmp_path / "a.mp4", [sensor] * 2, turn=90)
    face = FaceFinder(face_models).find(next(read_video(path)).rgb)
    assert np.linalg.norm(face.points[1, :2] - (268, 242)) < 6
    assert abs(face.points[263, 1] - face.points[33, 1]) < 15


def moving(portrait, n, height=480, width=640):
    """A head that moves sideways, 50 pictures a second."""
    canvas = np.full((height, width + 400, 3), 90, np.uint8)
    canvas[:, 200:710] = cv2.resize(portrait, (510, height), interpolation=cv2.INTER_AREA)
    return [np.ascontiguousarray(canvas[:, 5 * i : 5 * i + width]) for i in range(n)]


def woven(pictures, top_first=True):
    """Fields of neighbouring pictures woven together, luma and chroma each."""
    out = []
    for first, second in zip(pictures[::2], pictures[1::2], strict=True):
        top, bottom = (first, second) if top_first else (second, first)
        a, b = (rgb_to_planes(p, Colour()) for p in (top, bottom))
        planes = []
        for x, y in ((a.y, b.y), (a.u, b.u), (a.v, b.v)):
            both = x.copy()
            both[1::2] = y[1::2]
            planes.append(both)
        out.append(planes_to_rgb(Planes(*planes), Colour()))
    return out


def combing(picture):
    """How much lines differ from the mean of their neighbours, against the next but one."""
    y = picture.astype(np.float64).mean(axis=2)[:, 60:-60]
    return np.abs(y[1:-1] - (y[:-2] + y[2:]) / 2).mean() / np.abs(y[2:] - y[:-2]).mean()


@pytest.mark.parametrize("top_first", [True, False])
def test_woven_fields_are_told_and_taken_apart(tmp_path, portrait, top_first):
    truth = moving(portrait, 28)
    path = write(tmp_path / "a.mp4", woven(truth, top_first))
    assert probe(path).interlaced
    frames = list(read_video(path))
    assert len(frames) == 14
    assert [f.index for f in frames] == list(range(14))
    # The first and the last have no neighbour to learn from.
    for frame, first, comb in zip(
        frames[2:-2], truth[4:-4:2], woven(truth, top_first)[2:-2], strict=True
    ):
        assert combing(comb) > 1.5 * combing(first)
        assert combing(frame.rgb) < 1.1 * combing(first)
        wrong = np.abs(frame.rgb.astype(int) - first)[:, 60:-60].mean()
        assert wrong < 3 < 1.5 * np.abs(comb.astype(int) - first)[:, 60:-60].mean()


def test_progressive_pictures_are_left_alone(tmp_path, portrait):
    """Whatever their flag says: cameras sell progressive pictures as interlaced."""
    truth = moving(portrait, 14)
    plain = write(tmp_path / "a.mp4", truth)
    flagged = write(tmp_path / "b.mp4", truth, options={"crf": "8", "x264-params": "tff=1"})
    with av.open(str(flagged)) as container:
        assert next(container.decode(video=0)).interlaced_frame
    for path in (plain, flagged):
        assert not probe(path).interlaced
        with av.open(str(path)) as container:
            coded = next(container.decode(video=0)).to_ndarray()[:480]
        np.testing.assert_array_equal(next(read_video(path)).planes.y, coded)


def test_stillness_is_believed_by_its_flag(tmp_path, portrait):
    still = moving(portrait, 1) * 12
    path = write(tmp_path / "a.mp4", still, options={"crf": "8", "x264-params": "tff=1"})
    assert probe(path).interlaced
    picture = list(read_video(path))[5].rgb
    assert np.abs(picture.astype(int) - still[0]).mean() < 3, "deinterlacing keeps what is still"


def test_a_telephones_rate_wanders_and_time_does_not(tmp_path):
    """Stamps as telephones write them: 30 a second, jittering, with drops in bad light."""
    rng = np.random.default_rng(5)
    times = np.cumsum(rng.choice([33, 33, 34, 30, 37, 66], 90))
    times -= times[0]
    shades = np.round(40 + 160 * times / times[-1]).astype(int)
    pictures = [np.full((48, 64, 3), shade, np.uint8) for shade in shades]
    path = write(tmp_path / "a.mp4", pictures, rate=30, stamps=times.tolist())
    frames = list(read_video(path, 25))
    assert len(frames) == pytest.approx((times[-1] + 33) / 40, abs=1)
    for frame in frames:
        nearest = shades[np.argmin(np.abs(times - 1000 * frame.time))]
        assert frame.rgb.mean() == pytest.approx(nearest, abs=3)
