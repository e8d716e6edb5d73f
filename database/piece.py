"""A piece of a media file: what is read where only a part of a long recording is meant.

A piece's time zero is its start, for picture and sound alike; its frames count from 0 there.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path

from database.errors import MediaError


@dataclass(frozen=True)
class Piece:
    """A media file from one time to another.

    Parameters
    ----------
    path : Path
    start : float
        Seconds from the file's first picture.
    end : float, optional
        Seconds on the same clock; by default the file's end.

    Raises
    ------
    MediaError
        If the times are not finite, negative, or not in order.
    """

    path: Path
    start: float = 0.0
    end: float | None = None

    def __post_init__(self) -> None:
        end = math.inf if self.end is None else self.end
        if not (math.isfinite(self.start) and 0 <= self.start < end) or end != end:
            raise MediaError(
                f"{self.path}: a piece from {self.start:g} to {end:g} s is none; its times must "
                "not be negative, and its end must come after its start"
            )

    def __str__(self) -> str:
        if self.whole:
            return str(self.path)
        if self.end is None:
            return f"{self.path} from {self.start:.2f} s"
        return f"{self.path} from {self.start:.2f} to {self.end:.2f} s"

    @property
    def whole(self) -> bool:
        """Whether this is all of the file."""
        return self.start == 0 and self.end is None


Source = str | Path | Piece
"""What can be read: a file, or a piece of one."""


def piece_of(source: Source) -> Piece:
    """The piece that is meant: of a path, the whole file."""
    return source if isinstance(source, Piece) else Piece(Path(source))
