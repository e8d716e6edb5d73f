"""Writes a database: all of it or nothing (see `database.outfile`)."""

from __future__ import annotations

import contextlib
import json
import platform
import tempfile
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import fields
from datetime import UTC, datetime
from importlib import metadata
from pathlib import Path
from typing import IO, Any, Final

import cv2
import h5py
import numpy as np
import numpy.typing as npt

from database import checks
from database.errors import DatabaseError
from database.outfile import whole_file, writing
from database.pictures import decode, find_codec
from database.schema import (
    FIELDS,
    GUIDES,
    SCHEMA_NAME,
    SCHEMA_VERSION,
    CostModel,
    DatabaseContent,
    Field,
    GuideModel,
    PhoneMarks,
    Phones,
    RigidTexture,
    Sequences,
    TextureModel,
    Units,
)
from database.storage import open_file
from database.stored_backgrounds import GROUP as BACKGROUNDS
from database.stored_backgrounds import StoredBackgrounds, check_backgrounds

Array = npt.NDArray[Any]
Progress = Callable[[int, int], None]
"""Called with the number of units written so far, and of all units."""

FORMAT: Final = ("v110", "latest")
"""Oldest HDF5 format to write. From 1.10 on, all metadata has checksums. The newest format of
HDF5 2 has no more of them, and HDF5 1.14, which older h5py brings, cannot read it."""

SELECTION: Final = next(f for f in FIELDS if f.path == "selection/settings")
CHUNK_BYTES: Final = 8 << 20
LANDMARK_ROWS: Final = 32
PICTURE_ROWS: Final = 256
LIBRARIES: Final = (
    *("unitsel", "numpy", "scipy", "scikit-learn", "h5py", "pillow", "av", "pocketsphinx"),
)


def library_versions() -> dict[str, str]:
    """Versions of unitsel and of the libraries that shape a database's content."""
    found = {"opencv": cv2.__version__}
    for name in LIBRARIES:
        with contextlib.suppress(metadata.PackageNotFoundError):
            found[name] = metadata.version(name)
    return found


def write_database(
    path: str | Path,
    content: DatabaseContent,
    pictures: Iterable[bytes],
    landmarks: npt.NDArray[np.float32],
    codec: str = "png",
    jobs: int = 1,
    progress: Progress | None = None,
) -> None:
    """Write a database file.

    Parameters
    ----------
    path : str or Path
        The file; one that is there is replaced once the new one is complete.
    content : DatabaseContent
        Everything but the pictures and landmarks. Numbers may come in wider types than the
        schema's, if their values fit.
    pictures : iterable of bytes
        The N units' crops in order, each as `database.pictures.encode` gives it.
    landmarks : (N, 468, 2) float32
        Raw face mesh of each unit, pixels of the recorded picture.
    codec : str
        Codec of the pictures.
    jobs : int
        Parallel jobs of the build, for the record.
    progress : callable, optional
        Called with the units written so far and their number.

    Raises
    ------
    DatabaseError
        If a field does not have the shape, type or values that the schema asks for, if the
        pictures are not N of the codec and crop size, or if the file cannot be written. There
        is no new file then, and what was at `path` is still there. Errors out of `pictures`
        and `progress` come through as they are.
    """
    path = Path(path)
    find_codec(codec)
    try:
        arrays, sizes = _prepare(content, landmarks)
    except (ValueError, TypeError, OverflowError) as error:
        raise DatabaseError(f"{path}: not written: {error}") from error
    with whole_file(path) as sink, _spool_beside(path) as spool:
        lengths = _fill(spool, path, pictures, sizes["N"], content, codec)
        arrays["pictures/length"] = lengths
        with writing(path):
            file = h5py.File(sink, "w", libver=FORMAT)
        with contextlib.closing(file):
            with writing(path):
                _write_attributes(file, content.fps, codec, jobs)
                for f in FIELDS:
                    if f.path != "pictures/data" and f.path in arrays:
                        write_dataset(file, f, arrays[f.path])
                        sink.check()
            for done in _write_pictures(path, file, spool, lengths):
                with writing(path):
                    sink.check()
                if progress is not None:
                    progress(done, sizes["N"])


def store_selection(path: str | Path, document: dict[str, Any]) -> None:
    """Put the settings of the selection that a database asks for into its file.

    Parameters
    ----------
    path : str or Path
        The database; a copy with the settings replaces it once that is complete.
    document : dict
        The settings as JSON values; an empty one takes them out.

    Raises
    ------
    DatabaseError
        If the file is no database or cannot be written; it is as it was then.
    """
    path = Path(path)
    open_file(path)[0].close()
    try:
        text = _as_bytes(SELECTION.path, [as_json(SELECTION.path, document)])
    except ValueError as error:
        raise DatabaseError(f"{path}: not written: {error}") from error
    _replace_group(path, "selection", {SELECTION.path: text} if document else {})


def store_backgrounds(path: str | Path, backgrounds: StoredBackgrounds) -> None:
    """Put backgrounds into a database in the place of those that it holds.

    Parameters
    ----------
    path : str or Path
        The database; a copy with the backgrounds replaces it once that is complete.
    backgrounds : StoredBackgrounds
        All that it is to hold; may be none.

    Raises
    ------
    DatabaseError
        If the file is no database or cannot be written, or the backgrounds' numbers do not fit
        together; it is as it was then.
    """
    path = Path(path)
    open_file(path)[0].close()
    arrays: dict[str, Array] = {}
    try:
        check_backgrounds(backgrounds)
        if len(backgrounds):
            sizes: dict[str, int] = {}
            for f in (f for f in FIELDS if f.path.startswith(f"{BACKGROUNDS}/")):
                own = getattr(backgrounds, f.path.partition("/")[2])
                arrays[f.path] = as_stored(f, own)
                checks.match_shape(f, arrays[f.path].shape, sizes)
    except (ValueError, TypeError, OverflowError) as error:
        raise DatabaseError(f"{path}: not written: {error}") from error
    _replace_group(path, BACKGROUNDS, arrays)


def _replace_group(path: Path, group: str, arrays: dict[str, Array]) -> None:
    """Put a copy of a database in its place in which a group holds these fields, or is not."""
    with path.open("rb") as old, whole_file(path) as sink, writing(path):
        while block := old.read(CHUNK_BYTES):
            sink.write(block)
        sink.check()
        with contextlib.closing(h5py.File(sink, "r+", libver=FORMAT)) as file:
            if group in file:
                del file[group]
            for f in FIELDS:
                if f.path in arrays:
                    write_dataset(file, f, arrays[f.path])


@contextlib.contextmanager
def _spool_beside(path: Path) -> Iterator[IO[bytes]]:
    """Give a nameless file on the same disk, which vanishes even if this process is killed."""
    with writing(path):
        spool = tempfile.TemporaryFile(dir=path.parent)  # noqa: SIM115 - closed below
    try:
        yield spool
    finally:
        # What could not be written was told already.
        with contextlib.suppress(OSError):
            spool.close()


def _prepare(
    content: DatabaseContent, landmarks: npt.NDArray[np.float32]
) -> tuple[dict[str, Array], dict[str, int]]:
    """All datasets but the pictures, in the types of the schema, checked, and their sizes."""
    values: dict[str, Any] = {"units/landmarks": landmarks}
    for group in ("units", "sequences", "phones", "texture", "costs"):
        part = getattr(content, group)
        values |= {f"{group}/{f.name}": getattr(part, f.name) for f in fields(part)}
    for name in ("costs/target_scale", "costs/visual_scale"):
        values[name] = [values[name]]
    patch, camera = content.mask.patch, content.camera
    if len(content.marks):
        values |= {f"marks/{f.name}": getattr(content.marks, f.name) for f in fields(PhoneMarks)}
    if any(len(s) for s in content.sound):
        values["sound/features"] = np.concatenate(content.sound)
        values["sound/steps"] = [len(s) for s in content.sound]
    if content.starts is not None:
        values["pieces/start"] = content.starts
    for kind, guide in content.guides.items():
        values |= {f"guide_{kind}/{f.name}": getattr(guide, f.name) for f in fields(guide)}
    if content.rigid is not None:
        values |= {f"rigid/{f.name}": getattr(content.rigid, f.name) for f in fields(RigidTexture)}
    if content.lips is not None:
        found = {"points": content.lips.points, "found": content.lips.found}
        values |= {f"lips/{k}": v for k, v in (found | content.lips.model.as_arrays()).items()}
    values["mask/vertices"] = content.mask.vertices
    values["mask/grid"] = patch.grid
    values["mask/crop_size"] = [patch.crop_width, patch.crop_height]
    values["camera"] = [camera.focal, camera.cx, camera.cy, camera.width, camera.height]
    values["build/settings"] = [as_json("build/settings", content.settings)]
    values["build/report"] = [as_json("build/report", content.report)]
    if content.consent:
        checks.check_consent(content.consent)
        values["consent/note"] = [content.consent]
    values["build/versions"] = [as_json("build/versions", library_versions())]
    sizes: dict[str, int] = {}
    arrays = {}
    for f in FIELDS:
        if f.path not in ("pictures/data", "pictures/length") and (
            not f.optional or f.path in values
        ):
            arrays[f.path] = as_stored(f, values[f.path])
            checks.match_shape(f, arrays[f.path].shape, sizes)

    def stored(group: str, kind: type[Any]) -> Any:
        return kind(**{f.name: arrays[f"{group}/{f.name}"] for f in fields(kind)})

    sequences = stored("sequences", Sequences)
    checks.check_fps(content.fps)
    checks.check_sequences(sequences, sizes["N"])
    checks.check_units(stored("units", Units), sequences)
    phones = stored("phones", Phones)
    checks.check_phones(phones, sizes["S"])
    if "marks/phone" in arrays:
        checks.check_marks(stored("marks", PhoneMarks), phones)
    checks.check_mask(content.mask, camera)
    checks.check_texture(stored("texture", TextureModel))
    checks.check_costs(stored("costs", CostModel))
    if "pieces/start" in arrays:
        checks.check_starts(arrays["pieces/start"])
    if "sound/steps" in arrays:
        checks.check_sound(arrays["sound/steps"], sizes["F"])
    if "rigid/points" in arrays:
        checks.check_rigid(stored("rigid", RigidTexture))
    for kind in content.guides:
        if kind not in GUIDES:
            raise ValueError(f"there is no guide {kind!r}, only {', '.join(GUIDES)}")
        checks.check_guide(kind, stored(f"guide_{kind}", GuideModel))
    if content.lips is not None:
        checks.check_lips(content.lips)
    return arrays, sizes


def as_json(name: str, document: dict[str, Any]) -> str:
    """A document as text, or a ValueError that names its field."""
    try:
        return json.dumps(document, sort_keys=True, ensure_ascii=False, allow_nan=False)
    except (TypeError, ValueError) as error:
        raise ValueError(f"{name} cannot be written as JSON: {error}") from error


def as_stored(field: Field, value: Any) -> Array:
    """Bring a field's value into the type of the schema, if nothing but precision is lost by it."""
    if field.dtype == "string":
        return _as_bytes(field.path, value)
    wanted = np.dtype(field.dtype)
    given = np.asarray(value)
    if given.dtype.kind not in ("iu" if wanted.kind in "iu" else "iuf"):
        raise ValueError(f"{field.path} is of type {given.dtype}, not {wanted}")
    with np.errstate(over="ignore"):
        stored = np.ascontiguousarray(given, dtype=wanted).reshape(given.shape)
    if wanted.kind in "iu":
        if not np.array_equal(stored, given):
            raise ValueError(f"{field.path} holds values that {wanted} cannot")
    else:
        checks.check_finite(field.path, stored)
    return stored


def _as_bytes(path: str, texts: Sequence[str]) -> Array:
    encoded = []
    for text in texts:
        if not isinstance(text, str) or "\0" in text:
            raise ValueError(f"{path} holds {text!r}, which is no text")
        try:
            encoded.append(text.encode())
        except UnicodeEncodeError as error:
            raise ValueError(f"{path} holds {text!r}, which is no Unicode text") from error
    longest = max(map(len, encoded), default=0)
    return np.array(encoded, dtype=f"S{max(1, longest)}")


def _fill(
    spool: IO[bytes],
    path: Path,
    pictures: Iterable[bytes],
    n_units: int,
    content: DatabaseContent,
    codec: str,
) -> npt.NDArray[np.int32]:
    """Put the pictures aside one after another: the longest must be known to store the first.

    Returns
    -------
    (N,) int32
        Length of each in bytes.
    """
    how = find_codec(codec)
    patch = content.mask.patch
    lengths = np.zeros(n_units, dtype=np.int32)
    n = 0
    for n, data in enumerate(pictures, 1):
        if n > n_units:
            raise DatabaseError(f"{path}: not written: more pictures than {n_units} units")
        if n == 1 and (size := decode(data, codec).shape[:2]) != (
            patch.crop_height,
            patch.crop_width,
        ):
            raise DatabaseError(
                f"{path}: not written: pictures are {size[1]} x {size[0]} pixels, mask/crop_size "
                f"says {patch.crop_width} x {patch.crop_height}"
            )
        if not how.signs(data[:16]):
            raise DatabaseError(f"{path}: not written: picture {n - 1} is not encoded as {codec}")
        lengths[n - 1] = len(data)
        with writing(path):
            spool.write(data)
    if n < n_units:
        raise DatabaseError(f"{path}: not written: {n} pictures for {n_units} units")
    return lengths


def _write_attributes(file: h5py.File, fps: float, codec: str, jobs: int) -> None:
    texts = {
        "schema": SCHEMA_NAME,
        "codec": codec,
        "created": datetime.now(UTC).isoformat(timespec="seconds"),
        "host": platform.node(),
    }
    for name, text in texts.items():
        file.attrs[name] = np.bytes_(text.encode())
    file.attrs["schema_version"] = np.int64(SCHEMA_VERSION)
    file.attrs["jobs"] = np.int64(jobs)
    file.attrs["fps"] = np.float64(fps)


def write_dataset(file: h5py.File, field: Field, array: Array) -> None:
    """Write one field, with checksums."""
    row = max(1, array.nbytes // len(array))
    options: dict[str, Any] = {}
    rows = min(len(array), max(1, CHUNK_BYTES // row))
    if field.path == "units/landmarks":
        rows = min(len(array), LANDMARK_ROWS)
        options = {"compression": "gzip", "compression_opts": 4, "shuffle": True}
    if field.dtype == "string":
        options["dtype"] = h5py.string_dtype("utf-8", array.dtype.itemsize)
        array = array.astype(options["dtype"])
    file.create_dataset(
        field.path, data=array, chunks=(rows, *array.shape[1:]), fletcher32=True, **options
    )


def _write_pictures(
    path: Path, file: h5py.File, spool: IO[bytes], lengths: npt.NDArray[np.int32]
) -> Iterator[int]:
    """Write the spooled pictures, one padded chunk each, yielding how many are done."""
    with writing(path):
        spool.seek(0)
        padded = int(lengths.max())
        dataset = file.create_dataset(
            "pictures/data",
            shape=(len(lengths), padded),
            dtype=np.uint8,
            chunks=(1, padded),
            fletcher32=True,
        )
    for first in range(0, len(lengths), PICTURE_ROWS):
        batch = lengths[first : first + PICTURE_ROWS]
        with writing(path):
            block = np.zeros((len(batch), padded), dtype=np.uint8)
            for row, length in zip(block, batch, strict=True):
                row[:length] = np.frombuffer(spool.read(length), dtype=np.uint8)
            dataset[first : first + len(batch)] = block
        yield first + len(batch)
