"""A database is written whole or not at all, and only if its content holds together."""

import os
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import h5py
import numpy as np
import pytest

from database.errors import DatabaseError
from database.fingerprint import content_hash, identity
from database.mask import Camera
from database.pictures import encode
from database.reader import open_database
from database.schema import DatabaseContent
from database.writer import store_selection, write_database

SIZE = {"sequences": 2, "frames": 12, "crop": (16, 18), "missing_in": None}
HERE = Path(__file__).parent


@pytest.fixture(scope="module")
def made(makedb):
    content, pictures, landmarks = makedb.make_content(**SIZE)
    return content, [encode(p) for p in pictures], landmarks


def changed(content: DatabaseContent, part: str, name: str, at, value) -> DatabaseContent:
    """Take the content with some entries of one field changed."""
    array = np.array(getattr(getattr(content, part), name))
    array[at] = value
    return replace(content, **{part: replace(getattr(content, part), **{name: array})})


def put(content: DatabaseContent, part: str, name: str, value) -> DatabaseContent:
    """Take the content with one field replaced."""
    return replace(content, **{part: replace(getattr(content, part), **{name: value})})


FAULTS = {
    "units/pca is 23 x 12, not N x K with N = 24": lambda c: put(
        c, "units", "pca", c.units.pca[:-1]
    ),
    "units/pca is 24, not N x K": lambda c: put(c, "units", "pca", c.units.pca[:, 0]),
    "units/frame is of type float32, not int32": lambda c: put(
        c, "units", "frame", c.units.frame.astype(np.float32)
    ),
    "units/frame holds values that int32 cannot": lambda c: put(
        c, "units", "frame", c.units.frame.astype(np.int64) + (1 << 40)
    ),
    "units/teeth is of type bool": lambda c: put(c, "units", "teeth", c.units.teeth > 0),
    "units/teeth must lie in 0..1": lambda c: changed(c, "units", "teeth", 3, 1.5),
    "units/tongue holds a value that is not finite, at \\[3\\]": lambda c: changed(
        c, "units", "tongue", 3, np.nan
    ),
    "units/translation holds a value that is not finite, at \\[1, 2\\]": lambda c: changed(
        c, "units", "translation", (1, 2), np.inf
    ),
    "units/mouth_width holds a value that is not finite": lambda c: put(
        c, "units", "mouth_width", np.full(24, 1e300)
    ),
    "units/sequence\\[4\\] is 2, outside 0..1": lambda c: changed(c, "units", "sequence", 4, 2),
    "units/sequence\\[4\\] is 1, but by": lambda c: changed(c, "units", "sequence", 4, 1),
    "units/phoneme\\[0\\] is 43, outside 0..42": lambda c: changed(c, "units", "phoneme", 0, 43),
    "units/viseme\\[0\\] is 3, not that": lambda c: changed(c, "units", "viseme", 0, 3),
    "units/frame\\[11\\] is 12, outside": lambda c: changed(c, "units", "frame", 11, 12),
    "units/frame\\[5\\] is 4, not after": lambda c: changed(c, "units", "frame", 5, 4),
    "sequences/first_unit\\[1\\] is 3, but 12 units": lambda c: changed(
        c, "sequences", "first_unit", 1, 3
    ),
    "sequences/units adds up to 23": lambda c: changed(c, "sequences", "units", 1, 11),
    "sequences/units\\[0\\] is 12, more than its 11": lambda c: changed(
        c, "sequences", "frames", 0, 11
    ),
    "sequences/fps holds a rate": lambda c: changed(c, "sequences", "fps", 0, 0),
    "sequences/words is 1, not S with S = 2": lambda c: put(c, "sequences", "words", ("a",)),
    "sequences/words holds 7, which is no text": lambda c: put(c, "sequences", "words", (7, "a")),
    "sequences/name holds 'a.x00', which is no text": lambda c: put(
        c, "sequences", "name", ("a\0", "b")
    ),
    "sequences/name holds .*, which is no Unicode": lambda c: put(
        c, "sequences", "name", ("\udcff", "b")
    ),
    "sequences/name is empty": lambda c: put(c, "sequences", "name", ()),
    "phones/sequence: none for sequence 1": lambda c: changed(
        c, "phones", "sequence", slice(None), 0
    ),
    "phones/sequence: sequences out of order": lambda c: put(
        c, "phones", "sequence", c.phones.sequence[::-1]
    ),
    "phones/end\\[0\\] is 0 s after 0 s": lambda c: changed(c, "phones", "end", 0, 0),
    "phones/start\\[1\\] is .*, but the phone before": lambda c: changed(
        c, "phones", "start", 1, c.phones.start[1] + 0.01
    ),
    "costs/phoneme_distance is 42 x 43": lambda c: put(
        c, "costs", "phoneme_distance", c.costs.phoneme_distance[1:]
    ),
    "costs/target_scale and costs/visual_scale must be": lambda c: put(
        c, "costs", "target_scale", 0.0
    ),
    "costs/visual_scale holds a value": lambda c: put(c, "costs", "visual_scale", np.nan),
    "texture/eigenvalues holds a negative": lambda c: changed(c, "texture", "eigenvalues", 0, -1),
    "mask/vertices is 467 x 3": lambda c: put(c, "mask", "vertices", c.mask.vertices[1:]),
    "camera must be finite": lambda c: replace(c, camera=replace(c.camera, focal=-1.0)),
    "camera must have": lambda c: replace(c, camera=Camera(1.0, 0, 0, 0, 0)),
    "fps must be positive": lambda c: replace(c, fps=float("nan")),
    "build/settings cannot be written as JSON": lambda c: replace(c, settings={"a": {1, 2}}),
    "build/report cannot be written as JSON": lambda c: replace(c, report={"a": float("nan")}),
}


@pytest.mark.parametrize("message", FAULTS)
def test_content_that_does_not_hold_together_is_refused_by_name(made, tmp_path, message):
    content, pictures, landmarks = made
    with pytest.raises(DatabaseError, match=f"x.h5: not written: {message}") as caught:
        write_database(tmp_path / "x.h5", FAULTS[message](content), pictures, landmarks)
    assert "\n" not in str(caught.value)
    assert list(tmp_path.iterdir()) == []


def test_landmarks_must_fit_too(made, tmp_path):
    content, pictures, landmarks = made
    for wrong in (landmarks[1:], landmarks[:, :467], landmarks[..., :1]):
        with pytest.raises(DatabaseError, match="units/landmarks is"):
            write_database(tmp_path / "x.h5", content, pictures, wrong)
    assert list(tmp_path.iterdir()) == []


def test_pictures_must_be_as_many_as_units_of_the_codec_and_size(made, tmp_path):
    content, pictures, landmarks = made
    other = encode(np.zeros((18, 17, 3), np.uint8))
    for wrong, message in [
        (pictures[1:], "23 pictures for 24 units"),
        ([], "0 pictures for 24 units"),
        ([*pictures, other], "more pictures than 24 units"),
        ([other, *pictures[1:]], "pictures are 17 x 18 pixels, mask/crop_size says 16 x 18"),
        ([*pictures[:-1], b"junk"], "picture 23 is not encoded as png"),
    ]:
        with pytest.raises(DatabaseError, match=message):
            write_database(tmp_path / "x.h5", content, iter(wrong), landmarks)
    with pytest.raises(DatabaseError, match="begin as a webp picture"):
        write_database(tmp_path / "x.h5", content, pictures, landmarks, codec="webp")
    with pytest.raises(DatabaseError, match="choose one of: avif, jpeg, png, webp"):
        write_database(tmp_path / "x.h5", content, pictures, landmarks, codec="gif")
    assert list(tmp_path.iterdir()) == []


def test_wider_types_are_stored_in_the_schemas(made, tmp_path):
    content, pictures, landmarks = made
    wide = put(content, "units", "frame", content.units.frame.astype(np.int64))
    wide = put(wide, "units", "pca", content.units.pca.astype(np.float64))
    write_database(tmp_path / "x.h5", wide, pictures, landmarks.astype(np.float64))
    with open_database(tmp_path / "x.h5") as db:
        assert db.units.frame.dtype == np.int32
        np.testing.assert_array_equal(db.units.pca, content.units.pca)


def test_places_that_cannot_be_written_are_named(made, tmp_path):
    (tmp_path / "file").write_text("")
    for place, message in [
        (tmp_path / "none" / "x.h5", f"no folder {tmp_path / 'none'}; create it first"),
        (tmp_path / "file" / "x.h5", "no folder"),
        (tmp_path, "is a folder"),
        (tmp_path / ("x" * 300), "cannot be written: .*too long"),
    ]:
        with pytest.raises(DatabaseError, match=message):
            write_database(place, *made)
    assert [p.name for p in tmp_path.iterdir()] == ["file"]


def test_a_faulty_source_of_pictures_leaves_the_old_file_and_nothing_else(made, tmp_path):
    content, pictures, landmarks = made
    path = tmp_path / "x.h5"
    write_database(path, *made)
    before = path.read_bytes()

    def source():
        yield from pictures[:5]
        raise OSError("the clip went away")

    with pytest.raises(OSError, match="the clip went away"):
        write_database(path, content, source(), landmarks)

    def interrupted(done, total):
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        write_database(path, content, pictures, landmarks, progress=interrupted)
    assert path.read_bytes() == before
    assert [p.name for p in tmp_path.iterdir()] == ["x.h5"]


def test_progress_ends_with_all_units(made, tmp_path):
    seen = []
    write_database(tmp_path / "x.h5", *made, progress=lambda *step: seen.append(step))
    assert seen[-1] == (24, 24)
    assert seen == sorted(seen)


WRITE = """
import importlib.util, resource, signal, sys, time
spec = importlib.util.spec_from_file_location("makedb", sys.argv[1])
makedb = importlib.util.module_from_spec(spec)
spec.loader.exec_module(makedb)
from database.errors import DatabaseError
from database.pictures import encode
from database.writer import store_selection, write_database

content, pictures, landmarks = makedb.make_content(
    sequences=2, frames=12, crop=(16, 18), missing_in=None
)
encoded = [encode(p) for p in pictures]
"""


def python(code: str, path: Path, **options) -> subprocess.Popen:
    return subprocess.Popen(
        [sys.executable, "-c", WRITE + code, HERE / "makedb.py", path],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        **options,
    )


def test_a_killed_writer_leaves_no_database_and_its_remains_go_with_the_next(made, tmp_path):
    """Killed after the last picture, with the file open and all but complete."""
    path = tmp_path / "x.h5"
    code = """
def wait(done, total):
    print("writing", flush=True)
    time.sleep(60)
write_database(sys.argv[2], content, encoded, landmarks, progress=wait)
"""
    process = python(code, path)
    assert process.stdout.readline() == "writing\n"
    process.kill()
    process.communicate()
    assert not path.exists()
    (left,) = tmp_path.iterdir()
    assert left.name.endswith(".partial")
    running = tmp_path / f".x.h5.{os.getpid()}-abcdef.partial"
    running.write_text("of a writer that runs")
    write_database(path, *made)
    assert sorted(p.name for p in tmp_path.iterdir()) == [running.name, "x.h5"]


@pytest.mark.parametrize("limit", [0, 1_000, 20_000, 60_000, 97_000, 104_000])
def test_a_full_disk_is_one_error_and_leaves_nothing(tmp_path, limit):
    """The system's limit on a file's size stands in for the disk; both fail the write."""
    code = f"""
signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
resource.setrlimit(resource.RLIMIT_FSIZE, ({limit}, {limit}))
try:
    write_database(sys.argv[2], content, encoded, landmarks)
except DatabaseError as error:
    print(error)
"""
    process = python(code, tmp_path / "x.h5")
    out, err = process.communicate(timeout=60)
    assert process.returncode == 0, err
    assert "x.h5: cannot be written: " in out and out.count("\n") == 1, out + err
    assert "Traceback" not in err
    assert list(tmp_path.iterdir()) == []


# The settings of the selection


def test_settings_of_the_selection_are_stored_replaced_and_taken_out(makedb, tmp_path):
    path = makedb.make_database(tmp_path / "a.h5", sequences=2, frames=12, crop=(16, 16))
    before = content_hash(path)
    with open_database(path) as database:
        assert database.selection == {}
        same = identity(database)
    store_selection(path, {"weights": {"skip": 0.5}})
    store_selection(path, {"weights": {"skip": 0.25}, "words": "né"})
    with open_database(path) as database:
        assert database.selection == {"weights": {"skip": 0.25}, "words": "né"}
        assert identity(database) == same
        assert database.picture(3).shape == (16, 16, 3)
    assert content_hash(path) != before
    store_selection(path, {})
    assert content_hash(path) == before
    assert [p.name for p in tmp_path.iterdir()] == ["a.h5"]


def test_settings_that_cannot_be_stored_leave_the_database_as_it_was(makedb, tmp_path):
    path = makedb.make_database(tmp_path / "a.h5", sequences=2, frames=12, crop=(16, 16))
    before = path.read_bytes()
    with pytest.raises(DatabaseError, match="cannot be written as JSON"):
        store_selection(path, {"skip": float("nan")})
    with pytest.raises(DatabaseError, match="no such file"):
        store_selection(tmp_path / "none.h5", {})
    assert path.read_bytes() == before
    assert [p.name for p in tmp_path.iterdir()] == ["a.h5"]


def test_databases_with_other_units_or_scales_have_other_identities(makedb, tmp_path):
    size = {"sequences": 2, "frames": 12, "crop": (16, 16)}
    found = set()
    for i, change in enumerate(
        [
            lambda f: None,
            lambda f: f["units/teeth"].__setitem__(3, 0.51),
            lambda f: f["costs/visual_scale"].__setitem__(0, 7.0),
        ]
    ):
        path = makedb.make_database(tmp_path / f"{i}.h5", **size)
        with h5py.File(path, "r+") as file:
            change(file)
        with open_database(path) as database:
            found.add(identity(database))
    assert len(found) == 3
