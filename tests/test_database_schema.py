"""The schema, the writer and the reader speak of the same fields."""

from dataclasses import fields, replace

import h5py
import numpy as np
import pytest

from database.errors import DatabaseError
from database.fingerprint import content_hash
from database.pictures import encode
from database.reader import open_database
from database.schema import (
    ATTRIBUTES,
    FIELDS,
    CostModel,
    GuideModel,
    Phones,
    RigidTexture,
    Sequences,
    TextureModel,
    Units,
    field_table,
)
from database.writer import write_database


def datasets(path):
    found = {}
    with h5py.File(path) as file:
        file.visititems(
            lambda name, item: (
                found.update({name: (item.dtype, item.shape, item.fletcher32, item.chunks)})
                if isinstance(item, h5py.Dataset)
                else None
            )
        )
    return found


@pytest.fixture(scope="module")
def full_db(makedb, tmp_path_factory):
    """Make up a database with all that is optional."""
    size = {"sequences": 2, "frames": 12, "crop": (16, 16)}
    return makedb.make_database(tmp_path_factory.mktemp("full") / "x.h5", guided=True, **size)


def test_a_file_holds_the_fields_and_nothing_else(full_db, small_db):
    assert sorted(datasets(full_db)) == sorted(f.path for f in FIELDS)
    assert sorted(datasets(small_db)) == sorted(f.path for f in FIELDS if not f.optional)


def test_clips_know_where_in_their_files_they_start(full_db, small_db, makedb, tmp_path):
    with open_database(full_db) as db:
        np.testing.assert_array_equal(db.starts, [0.0, 2.5])
    with open_database(small_db) as db:
        np.testing.assert_array_equal(db.starts, np.zeros(len(db.sequences)))
    content, pictures, landmarks = makedb.make_content(sequences=2, frames=12, crop=(16, 16))
    for starts in ([0.0, -1.0], [0.0, np.nan], [0.0]):
        with pytest.raises(DatabaseError, match="pieces/start"):
            wrong = replace(content, starts=np.array(starts))
            write_database(tmp_path / "x.h5", wrong, (encode(p) for p in pictures), landmarks)


def test_half_an_optional_group_is_damage(full_db, tmp_path):
    (tmp_path / "x.h5").write_bytes(full_db.read_bytes())
    with h5py.File(tmp_path / "x.h5", "r+") as file:
        del file["guide_sound/gain"]
    with pytest.raises(DatabaseError, match="guide_sound/gain is missing"):
        open_database(tmp_path / "x.h5")


def test_every_dataset_has_checksums(full_db):
    assert [name for name, (_, _, checked, _) in datasets(full_db).items() if not checked] == []


def test_every_string_has_a_fixed_length(full_db):
    """Variable lengths would lie on HDF5's global heap, which has no checksums."""
    found = datasets(full_db)
    texts = [f.path for f in FIELDS if f.dtype == "string"]
    assert texts
    for path in texts:
        assert h5py.check_string_dtype(found[path][0]).length is not None
    with h5py.File(full_db) as file:
        for name in file.attrs:
            assert file.attrs.get_id(name).dtype.kind in "Sif", name


def test_one_picture_is_one_chunk(small_db):
    _, (n, padded), _, chunk = datasets(small_db)["pictures/data"]
    assert n > 1 and chunk == (1, padded)


def test_the_root_has_the_documented_attributes_few_enough_for_its_header(small_db):
    with h5py.File(small_db) as file:
        assert sorted(file.attrs) == sorted(ATTRIBUTES)
    assert len(ATTRIBUTES) <= 8


def test_metadata_is_of_a_format_with_checksums(small_db):
    assert small_db.read_bytes()[8] == 3, "version of the superblock"


@pytest.mark.parametrize(
    ("group", "kind", "apart"),
    [
        ("units", Units, {"landmarks"}),
        ("sequences", Sequences, set()),
        ("phones", Phones, set()),
        ("texture", TextureModel, set()),
        ("costs", CostModel, set()),
        ("guide_phonemes", GuideModel, set()),
        ("guide_sound", GuideModel, set()),
        ("rigid", RigidTexture, set()),
    ],
)
def test_dataclasses_name_the_fields_of_their_group(group, kind, apart):
    described = {f.path.split("/")[1] for f in FIELDS if f.path.startswith(f"{group}/")}
    assert {f.name for f in fields(kind)} == described - apart


def test_lip_models_have_the_fields_of_their_group(full_db):
    described = {f.path for f in FIELDS if f.path.startswith("lips/")}
    with open_database(full_db) as database:
        arrays = {"points", "found", *database.lip_model.as_arrays()}
    assert {f"lips/{name}" for name in arrays} == described


def test_the_table_for_the_documentation_has_every_field_and_attribute():
    lines = field_table().splitlines()
    assert all(line.startswith("|") and line.endswith("|") for line in lines if line)
    for name in [*(f.path for f in FIELDS), *ATTRIBUTES]:
        assert sum(line.startswith(f"| `{name}` |") for line in lines) == 1


def test_databases_of_the_same_content_count_as_identical(makedb, tmp_path):
    size = {"sequences": 2, "frames": 12, "crop": (16, 16)}
    first = makedb.make_database(tmp_path / "a.h5", **size)
    with h5py.File(makedb.make_database(tmp_path / "b.h5", **size), "r+") as file:
        file.attrs["created"] = b"another day"
        file.attrs["host"] = b"another machine"
        file.attrs["jobs"] = 7
    assert content_hash(first) == content_hash(tmp_path / "b.h5")
    assert len(content_hash(first)) == 64


@pytest.mark.parametrize(
    "change",
    [
        lambda file: file.attrs.modify("fps", 25.000001),
        lambda file: file["units/teeth"].__setitem__(3, 0.51),
        lambda file: file["pictures/data"].__setitem__((5, 40), 1),
        lambda file: file["sequences/words"].__setitem__(0, b"x"),
        lambda file: file["mask"].attrs.create("note", 1),
        lambda file: file.create_dataset("extra", data=[1]),
    ],
)
def test_any_other_difference_changes_the_hash(makedb, tmp_path, change):
    path = makedb.make_database(tmp_path / "a.h5", sequences=2, frames=12, crop=(16, 16))
    before = content_hash(path)
    with h5py.File(path, "r+", libver="latest") as file:
        change(file)
    assert content_hash(path) != before
