"""No damage to a database is read silently, and each is one `DatabaseError`."""

import json
import subprocess
import sys
from collections import Counter
from pathlib import Path

import h5py
import numpy as np
import pytest

from database.errors import DatabaseError
from database.fingerprint import content_hash
from database.reader import open_database
from database.schema import FIELDS, SCHEMA_VERSION

PROBE = Path(__file__).with_name("damage_probe.py")


@pytest.fixture(scope="module")
def path(makedb, tmp_path_factory):
    size = {"sequences": 2, "frames": 12, "crop": (16, 18), "missing_in": None, "weights": 3}
    path = tmp_path_factory.mktemp("damage") / "x.h5"
    return makedb.make_database(path, guided=True, **size)


@pytest.fixture
def copy(path, tmp_path):
    """Copy the file to change it, open for writing."""
    (tmp_path / "x.h5").write_bytes(path.read_bytes())
    with h5py.File(tmp_path / "x.h5", "r+") as file:
        yield file


def probe(path: Path, plan: list[dict]) -> list[str]:
    """Say what became of each damage (see damage_probe.py); fails if the interpreter crashed."""
    orders, results = path.with_name("plan.json"), path.with_name("results.txt")
    orders.write_text(json.dumps(plan))
    run = subprocess.run(
        [sys.executable, PROBE, path, orders, results], capture_output=True, text=True, timeout=300
    )
    verdicts = results.read_text().splitlines() if results.exists() else []
    assert run.returncode == 0, f"after {len(verdicts)} of {plan}: {run.stderr}"
    assert len(verdicts) == len(plan)
    return verdicts


def chunk_bytes(path: Path) -> np.ndarray:
    """Which bytes of the file belong to data, (size,) bool; the others are metadata."""
    data = np.zeros(path.stat().st_size, dtype=bool)
    with h5py.File(path) as file:
        for field in FIELDS:
            dataset = file[field.path].id
            for i in range(dataset.get_num_chunks()):
                chunk = dataset.get_chunk_info(i)
                data[chunk.byte_offset : chunk.byte_offset + chunk.size] = True
    return data


@pytest.mark.parametrize("where", ["data", "metadata"])
def test_a_flipped_bit_is_never_read_silently(path, where):
    data = chunk_bytes(path)
    places = np.flatnonzero(data if where == "data" else ~data)
    assert len(places) > 5000
    rng = np.random.default_rng(2009)
    flips = [{"flip": [int(rng.choice(places)), int(rng.integers(8))]} for _ in range(75)]
    verdicts = probe(path, flips)
    count = Counter(verdicts)
    odd = [(f, v) for f, v in zip(flips, verdicts, strict=True) if v not in ("refused", "right")]
    assert odd == []
    # Some bytes matter to nobody (gaps, and what is kept for growth), none of the data does not.
    assert count["refused"] >= (75 if where == "data" else 20), count


def test_flips_in_the_first_kilobyte_are_never_read_silently(path):
    """Superblock and root, through which everything is found."""
    flips = [{"flip": [byte, byte % 8]} for byte in range(0, 1024, 16)]
    assert set(probe(path, flips)) <= {"refused", "right"}


def test_a_file_cut_short_is_refused(path):
    size = path.stat().st_size
    cuts = [*range(0, 60, 7), *np.linspace(60, size - 1, 40).astype(int).tolist(), size // 2]
    assert set(probe(path, [{"cut": cut} for cut in cuts])) == {"refused"}


def refused(path: Path) -> str:
    """The one line with which a file is refused on opening, and by the hash."""
    with pytest.raises(DatabaseError) as caught:
        open_database(path)
    with pytest.raises(DatabaseError) as again:
        content_hash(path)
    message = str(caught.value)
    assert message == str(again.value) and "\n" not in message and message.startswith(str(path))
    return message


def test_what_is_no_database_is_named(tmp_path):
    assert "there is no such file" in refused(tmp_path / "none.h5")
    assert "is a folder" in refused(tmp_path)
    (tmp_path / "empty.h5").touch()
    assert "is empty" in refused(tmp_path / "empty.h5")
    (tmp_path / "text.h5").write_text("units: 3\n")
    assert "is no HDF5 file" in refused(tmp_path / "text.h5")
    assert "cannot be read" in refused(tmp_path / ("x" * 300))
    assert "cannot be read" in refused(tmp_path / "text.h5" / "x.h5")
    with h5py.File(tmp_path / "other.h5", "w") as file:
        file["units"] = np.arange(3)
    assert "HDF5 file of something else" in refused(tmp_path / "other.h5")
    with h5py.File(tmp_path / "other2.h5", "w") as file:
        file.attrs["schema"] = np.bytes_(b"something-else")
    assert "HDF5 file of something else" in refused(tmp_path / "other2.h5")
    (tmp_path / "half.h5").write_bytes((tmp_path / "other.h5").read_bytes()[:700])
    assert "damaged or cut short" in refused(tmp_path / "half.h5")


def replace(file: h5py.File, name: str, value) -> None:
    """Put other data in a dataset's place."""
    del file[name]
    file[name] = value


@pytest.mark.parametrize(
    ("version", "message"),
    [
        (SCHEMA_VERSION + 1, "newer than this unitsel reads .*; install a newer unitsel"),
        (SCHEMA_VERSION - 1, "older than this unitsel reads .*; build it again"),
        ("one", "schema_version is no whole number"),
        (None, "damaged or cut short"),
    ],
)
def test_other_schema_versions_are_refused_with_the_remedy(copy, version, message):
    del copy.attrs["schema_version"]
    if version is not None:
        copy.attrs["schema_version"] = version
    path = Path(copy.filename)
    copy.close()
    with pytest.raises(DatabaseError, match=message):
        open_database(path)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda f: f.__delitem__("units/pca"), "units/pca is missing"),
        (lambda f: f.__delitem__("mask"), "mask/vertices is missing"),
        (lambda f: replace(f, "camera", "text"), "camera is object, not float64"),
        (lambda f: (f.__delitem__("camera"), f.create_group("camera")), "camera is no dataset"),
        (lambda f: replace(f, "units/teeth", np.zeros(24)), "units/teeth is float64, not float32"),
        (
            lambda f: replace(f, "units/teeth", np.zeros(23, "f4")),
            "units/teeth is 23, not N with N = 24",
        ),
        (lambda f: replace(f, "units/pca", np.zeros(24, "f4")), "units/pca is 24, not N x K"),
        (lambda f: replace(f, "mask/vertices", np.zeros((9, 3), "f4")), "9 x 3, not 468 x 3"),
        (lambda f: replace(f, "sequences/name", np.array([1, 2])), "sequences/name is int64"),
        (
            lambda f: replace(f, "sequences/name", np.array(["a", "b"], dtype=object)),
            "not text of fixed length",
        ),
        (lambda f: f.attrs.modify("fps", -25.0), "fps must be positive, is -25.0"),
        (lambda f: f.attrs.__setitem__("fps", "fast"), "could not convert"),
        (lambda f: f.attrs.__delitem__("fps"), "attribute: 'fps'"),
        (lambda f: f.attrs.__setitem__("codec", np.bytes_(b"bmp")), "its codec is 'bmp'"),
        (lambda f: f.attrs.__setitem__("codec", 3), "attribute codec is no text"),
        (lambda f: f.attrs.__setitem__("codec", np.bytes_(b"\xff")), "codec can't decode"),
    ],
)
def test_other_fields_than_the_schemas_are_refused_on_opening(copy, change, message):
    change(copy)
    path = Path(copy.filename)
    copy.close()
    with pytest.raises(DatabaseError, match=f"x.h5: damaged or cut short .*{message}"):
        open_database(path)


def put(name: str, at, value):
    """A change of some entries of a dataset."""
    return lambda file: file[name].__setitem__(at, value)


@pytest.mark.parametrize(
    ("change", "read", "message"),
    [
        (put("units/sequence", 3, 2), "units", "units/sequence.3. is 2, outside 0..1"),
        (put("units/frame", 3, 99), "units", "units/frame.3. is 99, outside"),
        (put("units/viseme", 3, 21), "units", "units/viseme.3. is 21"),
        (put("units/pca", (3, 1), np.nan), "units", "units/pca holds .* not finite, at .3, 1."),
        (put("sequences/first_unit", 1, 11), "units", "sequences/first_unit.1. is 11"),
        (put("sequences/units", 1, 13), "sequences", "more than its 12 frames|adds up to 25"),
        (put("sequences/name", 1, b"\xff"), "sequences", "can't decode"),
        (put("phones/end", 0, np.inf), "phones", "phones/end holds a value that is not finite"),
        (put("phones/phoneme", 0, 43), "phones", "phones/phoneme.0. is 43"),
        (put("mask/vertices", 0, np.nan), "mask", "mask/vertices holds a value"),
        (put("mask/crop_size", 0, 0), "mask", "mask/crop_size must be positive"),
        (put("camera", 0, -1), "mask", "camera must be finite, with a positive focal"),
        (put("camera", 3, np.nan), "camera", "NaN"),
        (put("texture/mean", 0, np.inf), "texture", "texture/mean holds a value"),
        (put("costs/phoneme_distance", (1, 2), -1), "costs", "holds a negative distance"),
        (put("costs/visual_scale", 0, 0), "costs", "must be positive"),
        (put("build/settings", 0, b"{"), "settings", "Expecting property name"),
        (put("build/report", 0, b"[]"), "report", "build/report is no JSON object"),
    ],
)
def test_values_that_do_not_hold_together_are_refused_when_read(copy, change, read, message):
    change(copy)
    path = Path(copy.filename)
    copy.close()
    with open_database(path) as database:
        for _ in range(2):
            with pytest.raises(DatabaseError, match=f"x.h5: damaged or cut short .*({message})"):
                getattr(database, read)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (put("pictures/length", 5, 0), "pictures/length.5. is 0, outside 1.."),
        (put("pictures/length", 5, 10**6), "pictures/length.5. is 1000000, outside 1.."),
        (put("pictures/length", 5, 40), "picture of unit 5: 40 bytes are not a whole png"),
        (put("pictures/data", (5, slice(0, 8)), 0), "picture of unit 5: .* do not begin as"),
        (put("mask/crop_size", 0, 17), "picture of unit 5 is not of the size"),
    ],
)
def test_a_picture_that_is_none_is_refused_by_its_unit(copy, change, message):
    change(copy)
    path = Path(copy.filename)
    copy.close()
    with (
        open_database(path) as database,
        pytest.raises(DatabaseError, match=f"x.h5: damaged or cut short .*{message}"),
    ):
        database.picture(5)


def test_landmarks_must_be_finite(copy):
    copy["units/landmarks"][7, 3, 1] = np.nan
    path = Path(copy.filename)
    copy.close()
    with open_database(path) as database:
        with pytest.raises(DatabaseError, match="units/landmarks holds a value"):
            database.landmarks([7])
        assert np.isfinite(database.landmarks([6, 8])).all()
