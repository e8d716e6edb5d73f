"""Reads a database, each part when it is first asked for.

Whatever is wrong with the file, on opening or later, is one `DatabaseError` that names it.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import numpy.typing as npt

from database import checks
from database.database_file import DatabaseFile
from database.errors import DatabaseError
from database.lip_model import LipModel
from database.mask import N_VERTICES, Camera, Mask, MouthPatch
from database.pictures import Picture, decode, find_codec
from database.schema import (
    F32,
    FIELDS,
    GUIDES,
    CostModel,
    GuideModel,
    PhoneMarks,
    Phones,
    RigidTexture,
    Sequences,
    TextureModel,
    UnitLips,
    Units,
)
from database.storage import read_text_attribute, reading
from database.stored_backgrounds import StoredBackgrounds, check_backgrounds
from database.track import PhonemeTrack, context_windows


def open_database(path: str | Path) -> UnitDatabase:
    """Open a database file for reading.

    Raises
    ------
    DatabaseError
        If there is no such file, it is no database, it was made by a version of unitsel whose
        files this one does not read, or it is damaged.
    """
    return UnitDatabase(path)


class UnitDatabase(DatabaseFile):
    """A database file, open for reading.

    Arrays are read when first asked for, then kept, and cannot be written to. A database is a
    context manager, and a copy sent to another process opens the file again.

    Parameters
    ----------
    path : str or Path

    Raises
    ------
    DatabaseError
        On opening and from every member: if the file is not what it should be, an index is out
        of range, or the database was closed.
    """

    def __init__(self, path: str | Path) -> None:
        super().__init__(path)
        self._contexts: dict[int, npt.NDArray[np.uint8]] = {}
        try:
            with reading(self.path):
                checks.check_fps(self.fps)
                try:
                    find_codec(self.codec)
                except DatabaseError as error:
                    raise ValueError(f"its codec is {self.codec!r}, none of ours") from error
        except BaseException:
            self.close()
            raise

    def __reduce__(self) -> tuple[type[UnitDatabase], tuple[Path]]:
        return UnitDatabase, (self.path.absolute(),)

    def __len__(self) -> int:
        return self._sizes["N"]

    def __repr__(self) -> str:
        state = f"{len(self)} units" if self._handle is not None else "closed"
        return f"<UnitDatabase {self.path}: {state}>"

    def close(self) -> None:
        """Close the file; closing twice does no harm."""
        super().close()
        self._contexts.clear()

    @cached_property
    def fps(self) -> float:
        """Frame rate, 1/s."""
        with reading(self.path):
            return float(self._file.attrs["fps"])

    @cached_property
    def codec(self) -> str:
        """Name of the pictures' codec, as `database.pictures.find_codec` knows it."""
        with reading(self.path):
            return read_text_attribute(self._file, "codec")

    @cached_property
    def settings(self) -> dict[str, Any]:
        """Settings of the build."""
        return self._document("settings")

    @cached_property
    def versions(self) -> dict[str, Any]:
        """Versions of unitsel and its libraries at the build."""
        return self._document("versions")

    @cached_property
    def report(self) -> dict[str, Any]:
        """What the build skipped or repaired."""
        return self._document("report")

    @cached_property
    def consent(self) -> str:
        """What the person filmed has agreed to, as noted at the build; empty without a note."""
        with reading(self.path):
            if "consent" not in self._file:
                return ""
            note = str(self._read("consent/note")[0])
            checks.check_consent(note)
            return note

    @cached_property
    def sequences(self) -> Sequences:
        """The clips."""
        with reading(self.path):
            part = Sequences(**self._group("sequences", Sequences))
            checks.check_sequences(part, len(self))
            return part

    @cached_property
    def starts(self) -> npt.NDArray[np.float64]:
        """Start of each sequence in its media file, seconds, (S,)."""
        with reading(self.path):
            if "pieces" not in self._file:
                return np.zeros(self._sizes["S"])
            starts: npt.NDArray[np.float64] = self._read("pieces/start")
            checks.check_starts(starts)
            return starts

    @cached_property
    def units(self) -> Units:
        """The units' parameters."""
        with reading(self.path):
            part = Units(**self._group("units", Units))
            checks.check_units(part, self.sequences)
            return part

    @cached_property
    def phones(self) -> Phones:
        """The phones of all sequences."""
        with reading(self.path):
            part = Phones(**self._group("phones", Phones))
            checks.check_phones(part, self._sizes["S"])
            return part

    @cached_property
    def marks(self) -> PhoneMarks:
        """Closures and rests that were found in sound and lips; none in an older database."""
        with reading(self.path):
            if "marks" not in self._file:
                return PhoneMarks.none()
            part = PhoneMarks(**self._group("marks", PhoneMarks))
            checks.check_marks(part, self.phones)
            return part

    @cached_property
    def mask(self) -> Mask:
        """The person's mask."""
        with reading(self.path):
            width, height = self._read("mask/crop_size").tolist()
            patch = MouthPatch(self._read("mask/grid"), width, height)
            mask = Mask(self._read("mask/vertices"), patch)
            checks.check_mask(mask, self.camera)
            return mask

    @cached_property
    def camera(self) -> Camera:
        """The camera that filmed the clips."""
        with reading(self.path):
            focal, cx, cy, width, height = self._read("camera").tolist()
            return Camera(focal, cx, cy, int(width), int(height))

    @cached_property
    def texture(self) -> TextureModel:
        """PCA and reference lighting of the normalised crops."""
        with reading(self.path):
            part = TextureModel(**self._group("texture", TextureModel))
            checks.check_texture(part)
            return part

    @cached_property
    def costs(self) -> CostModel:
        """Phoneme distances and scales of the costs."""
        with reading(self.path):
            values = self._group("costs", CostModel)
            for name in ("target_scale", "visual_scale"):
                values[name] = float(values[name][0])
            part = CostModel(**values)
            checks.check_costs(part)
            return part

    @cached_property
    def rigid(self) -> RigidTexture | None:
        """What the person's rigid surface looks like; None where the build did not keep it."""
        with reading(self.path):
            if "rigid" not in self._file:
                return None
            part = RigidTexture(**self._group("rigid", RigidTexture))
            checks.check_rigid(part)
            return part

    @cached_property
    def guides(self) -> tuple[str, ...]:
        """Names of the guides that the database holds (`database.schema.GUIDES`)."""
        with reading(self.path):
            return tuple(kind for kind in GUIDES if f"guide_{kind}" in self._file)

    def guide(self, kind: str) -> GuideModel:
        """Read a guide: a prediction of the mouth (database/guide_model.py).

        Raises
        ------
        DatabaseError
            If the database holds none of this name, or it is damaged.
        """
        if kind not in self.guides:
            raise DatabaseError(
                f"{self.path}: holds no guide from {kind}; build it again from at least "
                "20 clips (with sound), or choose the target cost 'paper'"
            )
        with reading(self.path):
            part = GuideModel(**self._group(f"guide_{kind}", GuideModel))
            checks.check_guide(kind, part)
            return part

    @cached_property
    def lips(self) -> UnitLips | None:
        """The lip model and each unit's 20 points; None where the face mesh's contours stand."""
        with reading(self.path):
            if "lips" not in self._file:
                return None
            names = [f.path for f in FIELDS if f.path.startswith("lips/")]
            arrays = {name.partition("/")[2]: self._read(name) for name in names}
            part = UnitLips(LipModel.from_arrays(arrays), arrays["points"], arrays["found"])
            checks.check_lips(part)
            return part

    @property
    def lip_model(self) -> LipModel | None:
        """The active appearance model of the lips, if the database holds one."""
        return None if self.lips is None else self.lips.model

    @cached_property
    def backgrounds(self) -> StoredBackgrounds:
        """Backgrounds that were added; none where nobody added any."""
        with reading(self.path):
            if "backgrounds" not in self._file:
                return StoredBackgrounds.none()
            part = StoredBackgrounds(**self._group("backgrounds", StoredBackgrounds))
            check_backgrounds(part)
            return part

    def sound(self, i: int) -> npt.NDArray[np.float16] | None:
        """Features of a sequence's sound, in the time of its phones; None where it has none.

        Returns
        -------
        (steps, 26) float16
            See database/sound_features.py.
        """
        sequence = self._index(i, self._sizes["S"], "sequence")
        with reading(self.path):
            if "sound" not in self._file:
                return None
            steps = self._sound_steps
            end = int(steps[: sequence + 1].sum())
            part = self._file["sound/features"][end - int(steps[sequence]) : end]
            checks.check_finite("sound/features", part)
            return part if len(part) else None

    @cached_property
    def _sound_steps(self) -> npt.NDArray[np.int32]:
        steps: npt.NDArray[np.int32] = self._read("sound/steps")
        checks.check_sound(steps, self._sizes["F"])
        return steps

    @cached_property
    def selection(self) -> dict[str, Any]:
        """Settings of the selection that the database asks for; empty where it asks for none."""
        with reading(self.path):
            there = "selection/settings" in self._file
        return self._document("settings", "selection") if there else {}

    def landmarks(self, rows: Sequence[int] | npt.NDArray[np.integer] | slice) -> F32:
        """Raw face meshes of some units.

        Parameters
        ----------
        rows : sequence of int, or slice
            Units, in any order.

        Returns
        -------
        (n, 468, 2) float32
            Pixels of the recorded pictures.
        """
        units = self._unit_indices(rows)
        out = np.empty((len(units), N_VERTICES, 2), dtype=np.float32)
        with reading(self.path):
            dataset = self._file["units/landmarks"]
            step = dataset.chunks[0]
            order = np.argsort(units, kind="stable")
            blocks = units[order] // step
            for block in np.unique(blocks):
                here = order[np.searchsorted(blocks, block) : np.searchsorted(blocks, block + 1)]
                chunk = dataset[block * step : (block + 1) * step]
                out[here] = chunk[units[here] - block * step]
            checks.check_finite("units/landmarks", out)
        return out

    def picture(self, i: int) -> Picture:
        """Read the mouth's crop of unit `i`, (crop_height, crop_width, 3) uint8 RGB."""
        unit = self._unit_index(i)
        patch = self.mask.patch
        with reading(self.path):
            row = self._picture_data[unit]
            length = int(self.picture_lengths[unit])
            if not 0 < length <= len(row):
                raise ValueError(f"pictures/length[{unit}] is {length}, outside 1..{len(row)}")
            try:
                picture = decode(row[:length], self.codec)
            except DatabaseError as error:
                raise ValueError(f"picture of unit {unit}: {error}") from error
            if picture.shape[:2] != (patch.crop_height, patch.crop_width):
                raise ValueError(f"picture of unit {unit} is not of the size mask/crop_size")
            return picture

    def pictures(self, indices: Sequence[int] | npt.NDArray[np.integer] | slice) -> Picture:
        """Read the crops of some units in their order, (n, crop_height, crop_width, 3) uint8."""
        units = self._unit_indices(indices)
        patch = self.mask.patch
        out = np.empty((len(units), patch.crop_height, patch.crop_width, 3), dtype=np.uint8)
        for place, unit in enumerate(units.tolist()):
            out[place] = self.picture(unit)
        return out

    def sequence_track(self, s: int) -> PhonemeTrack:
        """Phonemes of sequence `s` in its own time, named as the clip."""
        s = self._index(s, self._sizes["S"], "sequence")
        phones = self.phones
        first, last = np.searchsorted(phones.sequence, (s, s + 1))
        bounds = np.append(phones.start[first:last], phones.end[last - 1])
        with reading(self.path):
            name = self.sequences.name[s]
            return PhonemeTrack(phones.phoneme[first:last].astype(np.int64), bounds, name)

    def context(self, n_frames: int) -> npt.NDArray[np.uint8]:
        """Phonemes recorded around each unit, at the database's frame rate.

        A sequence's track is sampled once and every unit takes the window at its frame number,
        so frames without a face, which are no units, count in their neighbours' contexts.

        Parameters
        ----------
        n_frames : int
            Frames on each side; `database.track.context_frames` gives the paper's.

        Returns
        -------
        (N, 2 n_frames + 1) uint8
            Silence beyond the ends of a track.
        """
        if n_frames < 0:
            raise DatabaseError(f"{self.path}: a context has no {n_frames} frames on each side")
        units, sequences = self.units, self.sequences
        if n_frames not in self._contexts:
            out = np.empty((len(self), 2 * n_frames + 1), dtype=np.uint8)
            for s in np.flatnonzero(sequences.units):
                rows = slice(sequences.first_unit[s], sequences.first_unit[s] + sequences.units[s])
                frames = units.frame[rows]
                seen = self.sequence_track(int(s)).sample(self.fps, int(frames[-1]) + n_frames + 1)
                out[rows] = context_windows(seen, n_frames)[frames]
            out.setflags(write=False)
            self._contexts[n_frames] = out
        return self._contexts[n_frames]

    @cached_property
    def _picture_data(self) -> h5py.Dataset:
        return self._file["pictures/data"]

    @cached_property
    def picture_lengths(self) -> npt.NDArray[np.int32]:
        """Bytes of each encoded picture, (N,) int32."""
        lengths: npt.NDArray[np.int32] = self._read("pictures/length")
        return lengths

    def _unit_index(self, i: int) -> int:
        return self._index(i, len(self), "unit")

    def _unit_indices(
        self, rows: Sequence[int] | npt.NDArray[np.integer] | slice
    ) -> npt.NDArray[np.int64]:
        if isinstance(rows, slice):
            return np.arange(len(self))[rows]
        units = np.asarray(rows)
        if units.ndim != 1 or (units.size and units.dtype.kind not in "iu"):
            raise DatabaseError(f"{self.path}: units must be given as a list of their numbers")
        for end in (units.min(), units.max()) if units.size else ():
            self._unit_index(int(end))
        return units.astype(np.int64)
