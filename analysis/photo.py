"""A photo from a file: upright, RGB, of a size that can be drawn.

What a camera or a browser leaves in a picture is dealt with here: EXIF's turn, transparency,
palettes, grey and 16 bit, sizes beyond what a video needs, odd sizes that no video has.
"""

from __future__ import annotations

import warnings
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np
import numpy.typing as npt
from PIL import Image, ImageOps, UnidentifiedImageError

from database.errors import MediaError

LONGEST: Final = 1280
"""Pixels: the longer side of a photo is brought down to this."""

SMALLEST: Final = 64
"""Pixels: no face can be told in less."""

PAPER: Final = (255, 255, 255)
"""What shines through where a picture is transparent."""

WIDE_MODES: Final = ("I", "I;16", "I;16B", "I;16L", "F")


@dataclass(frozen=True)
class Photo:
    """A picture that was read.

    Parameters
    ----------
    rgb : (h, w, 3) uint8
        Both sizes even.
    notes : tuple of str
        What was done to it, for people.
    """

    rgb: npt.NDArray[np.uint8]
    notes: tuple[str, ...]


def read_photo(path: str | Path, longest: int = LONGEST) -> Photo:
    """Read a photo.

    Parameters
    ----------
    path : path
        Any still picture that Pillow reads.
    longest : int
        Pixels of the longer side beyond which it is scaled down.

    Raises
    ------
    MediaError
        If it cannot be read, or is too small.
    """
    file = Path(path)
    try:
        with warnings.catch_warnings():
            # Large photos are expected, and bounded below.
            warnings.simplefilter("ignore", Image.DecompressionBombWarning)
            with Image.open(file) as image:
                return _prepared(file, image, longest)
    except FileNotFoundError:
        raise MediaError(f"{file}: there is no such file; name a photo") from None
    except IsADirectoryError:
        raise MediaError(f"{file}: is a folder; name a photo in it") from None
    except Image.DecompressionBombError:
        raise MediaError(
            f"{file}: has more pixels than can be read safely; scale it down to some "
            f"{longest} pixels first"
        ) from None
    except UnidentifiedImageError:
        raise MediaError(
            f"{file}: is no picture that can be read; save it as JPEG or PNG"
        ) from None
    except (OSError, SyntaxError, ValueError, EOFError) as error:
        reason = getattr(error, "strerror", None) or " ".join(str(error).split()) or "no reason"
        raise MediaError(f"{file}: cannot be read ({reason}); save it anew") from error


def _prepared(file: Path, image: Image.Image, longest: int) -> Photo:
    notes = []
    width, height = image.size
    if min(width, height) < SMALLEST:
        raise MediaError(
            f"{file}: is only {width} x {height} pixels; a face needs a photo of at least "
            f"{SMALLEST} x {SMALLEST}, and looks well from some 300 on"
        )
    # JPEG decodes at a fraction of its size for nothing.
    image.draft("RGB", (2 * longest, 2 * longest))
    turned = ImageOps.exif_transpose(image)
    if turned.size != image.size or image.getexif().get(0x0112, 1) not in (0, 1):
        notes.append("turned upright as its EXIF data say")
    colour = _in_colour(turned, notes)
    scale = longest / max(width, height)
    if scale < 1:
        sideways = turned.size != image.size
        size = (height, width) if sideways else (width, height)
        small = (max(2, round(size[0] * scale)), max(2, round(size[1] * scale)))
        colour = colour.resize(small, Image.Resampling.LANCZOS)
        notes.append(f"scaled from {size[0]} x {size[1]} to {small[0]} x {small[1]} pixels")
    rgb = np.asarray(colour, dtype=np.uint8)
    even = rgb[: rgb.shape[0] // 2 * 2, : rgb.shape[1] // 2 * 2]
    if min(even.shape[:2]) < SMALLEST:
        raise MediaError(
            f"{file}: is {width} x {height} pixels, which leaves too narrow a strip; cut out the "
            "part around the face"
        )
    return Photo(np.ascontiguousarray(even), tuple(notes))


def _in_colour(image: Image.Image, notes: list[str]) -> Image.Image:
    if image.mode in WIDE_MODES:
        values = np.asarray(image, dtype=np.float64)
        low, high = float(np.nanmin(values)), float(np.nanmax(values))
        top = 65535.0 if high > 255 else max(high, 1.0) if high <= 1 else 255.0
        levels = np.clip((values - min(low, 0.0)) / (top - min(low, 0.0)) * 255, 0, 255)
        image = Image.fromarray(np.rint(np.nan_to_num(levels)).astype(np.uint8))
    grey = image.mode in ("1", "L", "LA")
    if image.mode in ("LA", "PA", "RGBA", "La", "RGBa") or "transparency" in image.info:
        image = image.convert("RGBA")
        if image.getchannel("A").getextrema() != (255, 255):
            notes.append("laid on white where it is transparent")
        paper = Image.new("RGBA", image.size, (*PAPER, 255))
        image = Image.alpha_composite(paper, image)
    if grey:
        notes.append("is grey: teeth and mouth will be, too")
    return image.convert("RGB")
