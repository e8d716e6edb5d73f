"""Backgrounds that a user has added to a database: where their media are, and the head's motion.

Sizes: B backgrounds; poses, the frames of all of them, one background's after another's.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields
from typing import Any, Final

import numpy as np
import numpy.typing as npt

F32 = npt.NDArray[np.float32]

GROUP: Final = "backgrounds"
"""The group of the file that holds them."""

DESCRIBED: Final[tuple[tuple[str, str, tuple[str | int, ...], str, str], ...]] = (
    ("name", "string", ("B",), "", "name of the background (file name without extension)"),
    ("media", "string", ("B",), "", "video or photo"),
    ("sha256", "string", ("B",), "", "checksum of that file"),
    ("still", "uint8", ("B",), "0, 1", "1 for a photo, which has one frame"),
    ("fps", "float64", ("B",), "1/s", "frame rate of the video"),
    ("first", "int32", ("B",), "frame", "number of the first frame used, at that rate"),
    ("frames", "int32", ("B",), "count", "frames used, each with a face"),
    ("rotation", "float32", ("poses", 3), "rad", "head pose: rotation vector"),
    ("translation", "float32", ("poses", 3), "mm", "head pose: translation"),
    ("opening", "float32", ("poses",), "mm", "inner opening of the background's own mouth"),
    ("chin", "float32", ("poses",), "mm", "height of the chin's lowest point, mask frame"),
    ("light", "float32", ("poses",), "log level", "mean brightness of the skin around the mouth"),
)
"""Name, type, shape, unit and meaning of each field; all of them are optional."""


@dataclass(frozen=True)
class StoredBackgrounds:
    """Backgrounds of a database; see `DESCRIBED` for shapes and units."""

    name: tuple[str, ...]
    media: tuple[str, ...]
    sha256: tuple[str, ...]
    still: npt.NDArray[np.uint8]
    fps: npt.NDArray[np.float64]
    first: npt.NDArray[np.int32]
    frames: npt.NDArray[np.int32]
    rotation: F32
    translation: F32
    opening: F32
    chin: F32
    light: F32

    @classmethod
    def none(cls) -> StoredBackgrounds:
        """No backgrounds."""
        numbers = np.zeros(0, np.int32)
        points, values = np.zeros((0, 3), np.float32), np.zeros(0, np.float32)
        return cls(
            *((), (), (), np.zeros(0, np.uint8), np.zeros(0), numbers, numbers),
            *(points, points, values, values, values),
        )

    def __len__(self) -> int:
        return len(self.name)

    def rows(self, i: int) -> slice:
        """Frames of one background."""
        stop = int(self.frames[: i + 1].sum())
        return slice(stop - int(self.frames[i]), stop)

    def chosen(self, places: Sequence[int]) -> StoredBackgrounds:
        """Some of them, in the order given."""
        if not places:
            return self.none()
        rows = np.concatenate([np.r_[self.rows(i)] for i in places])
        values: dict[str, Any] = {}
        for f in fields(self):
            own = getattr(self, f.name)
            if isinstance(own, tuple):
                values[f.name] = tuple(own[i] for i in places)
            else:
                of_each = f.name in ("still", "fps", "first", "frames")
                values[f.name] = own[list(places) if of_each else rows]
        return StoredBackgrounds(**values)

    def joined(self, others: StoredBackgrounds) -> StoredBackgrounds:
        """These, then others."""
        values: dict[str, Any] = {}
        for f in fields(self):
            own, more = getattr(self, f.name), getattr(others, f.name)
            together = own + more if isinstance(own, tuple) else np.concatenate([own, more])
            values[f.name] = together
        return StoredBackgrounds(**values)


def check_backgrounds(backgrounds: StoredBackgrounds) -> None:
    """Raise `ValueError` if numbers are missing, not finite, or do not add up."""
    for f in fields(backgrounds):
        values = np.asarray(getattr(backgrounds, f.name))
        if values.dtype.kind == "f" and not np.isfinite(values).all():
            raise ValueError(f"{GROUP}/{f.name} holds a value that is not finite")
    if (backgrounds.fps <= 0).any():
        raise ValueError(f"{GROUP}/fps holds a rate that is not positive")
    if (backgrounds.frames < 1).any() or (backgrounds.first < 0).any():
        raise ValueError(f"{GROUP}/frames and {GROUP}/first must be at least 1 and 0")
    if int(backgrounds.frames.sum(dtype=np.int64)) != len(backgrounds.rotation):
        raise ValueError(f"{GROUP}/frames do not add up to the {len(backgrounds.rotation)} poses")
    if (backgrounds.still > 1).any() or (backgrounds.frames[backgrounds.still == 1] != 1).any():
        raise ValueError(f"{GROUP}/still must be 0 or 1, and a photo have one frame")
    if len(set(backgrounds.name)) < len(backgrounds):
        raise ValueError(f"{GROUP}/name holds a name twice")
