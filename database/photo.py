"""Still pictures in place of a video: JPEG and PNG, told by their content, not by their names."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Final

import numpy as np
import numpy.typing as npt
from PIL import Image, ImageOps, UnidentifiedImageError

from database.errors import MediaError
from database.media import probe
from database.planes import Colour

SIGNATURES: Final = (b"\xff\xd8\xff", b"\x89PNG\r\n\x1a\n")
"""First bytes of a JPEG and of a PNG file."""

LONGEST_SIDE: Final = 1920
"""Pixels; larger photos are made smaller: cameras take pictures that no video is made of."""

HD_HEIGHT: Final = 720
"""Pixels from which on a picture is taken to be BT.709, as players do."""


@dataclass(frozen=True)
class FrameFormat:
    """What frames of a video or photo look like.

    Parameters
    ----------
    width, height : int
        Even.
    colour : Colour
        Meaning of their planes.
    """

    width: int
    height: int
    colour: Colour


def is_photo(path: str | Path) -> bool:
    """Whether a file is a still picture; one that cannot be read is none."""
    try:
        with Path(path).open("rb") as file:
            return file.read(8).startswith(SIGNATURES)
    except OSError:
        return False


def read_photo(path: str | Path) -> npt.NDArray[np.uint8]:
    """Read a photo, upright as it asks for, its longer side `LONGEST_SIDE` at most.

    Returns
    -------
    (height, width, 3) uint8
        RGB, of even size.

    Raises
    ------
    MediaError
        If the file is missing or damaged, or a picture of another kind.
    """
    path = Path(path)
    try:
        with Image.open(path, formats=("JPEG", "PNG")) as opened:
            picture = ImageOps.exif_transpose(opened).convert("RGB")
    except FileNotFoundError:
        raise MediaError(f"{path}: there is no such file") from None
    except UnidentifiedImageError:
        raise MediaError(
            f"{path}: is no JPEG or PNG picture that can be read; save it again"
        ) from None
    except (OSError, ValueError, SyntaxError, Image.DecompressionBombError) as error:
        reason = " ".join(str(error).split())
        raise MediaError(f"{path}: cannot be read as a picture ({reason})") from error
    longest = max(picture.size)
    if longest > LONGEST_SIDE:
        size = tuple(max(2, round(s * LONGEST_SIDE / longest)) for s in picture.size)
        picture = picture.resize((size[0], size[1]), Image.Resampling.LANCZOS)
    width, height = (s // 2 * 2 for s in picture.size)
    if min(width, height) < 2:
        raise MediaError(f"{path}: a picture of {picture.width} x {picture.height} shows nothing")
    return np.ascontiguousarray(np.asarray(picture, dtype=np.uint8)[:height, :width])


def frame_format(path: str | Path) -> FrameFormat:
    """Size and colours of a video's or a photo's frames.

    Raises
    ------
    MediaError
        If it cannot be read.
    """
    path = Path(path)
    if is_photo(path):
        stat = path.stat()
        return _photo_format(path, stat.st_size, stat.st_mtime_ns)
    info = probe(path)
    return FrameFormat(info.width, info.height, info.colour)


@lru_cache(maxsize=16)
def _photo_format(path: Path, size: int, changed: int) -> FrameFormat:
    """Kept while the photo stays as it is, as `probe` does for videos."""
    height, width = read_photo(path).shape[:2]
    return FrameFormat(width, height, Colour("bt709" if height >= HD_HEIGHT else "bt601"))
