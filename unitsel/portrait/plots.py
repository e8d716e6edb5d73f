"""Pictures that show whether a portrait's mask sits, and what its mouth looks like."""

from __future__ import annotations

from pathlib import Path
from typing import Final

import cv2
import numpy as np
import numpy.typing as npt

from database.errors import DatabaseError
from database.portrait_file import PortraitHead
from database.portrait_mesh import EYE_TRIANGLES, INNER_LIPS, OUTER_LIPS, SKIN_TRIANGLES
from render.portrait_scene import PortraitScene
from unitsel.plots import strip
from unitsel.portrait.keyframes import JAWS, MOUTH_FRAMES

UInt8Array = npt.NDArray[np.uint8]

FACE: Final = (0.95, 0.75, 1.45)
"""Units to the sides, above and below the middle between the eyes that a face is shown in."""

TILE: Final = (285, 330)

_GREEN, _RED, _YELLOW = (60, 200, 60), (230, 60, 60), (240, 220, 40)


def plot_portrait(head: PortraitHead, folder: str | Path) -> list[Path]:
    """Draw a portrait's mask, and the face with each of its mouths and with shut eyes.

    Parameters
    ----------
    head : PortraitHead
    folder : path
        Made if it is not there.

    Returns
    -------
    list of Path
        ``mask.png`` (the photo's own pixels, for `--adjust`) and ``mouths.png``.

    Raises
    ------
    DatabaseError
        If a picture cannot be written.
    RenderError
        If OpenGL cannot be started.
    """
    directory = Path(folder)
    try:
        directory.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise DatabaseError(f"{directory}: cannot be made ({error.strerror})") from error
    mask = head.mask
    faces = []
    with PortraitScene(head.photo, mask, head.mouth) as scene:
        for shape, jaw in zip(MOUTH_FRAMES, JAWS, strict=True):
            faces.append(scene.picture(shape + mask.close_lips(), float(jaw)))
        faces.append(scene.picture(mask.shut_eyes()))
    pictures = {
        "mask.png": draw_mask(head),
        "mouths.png": strip([face_of(head, f) for f in faces], 5),
    }
    return [_written(directory / name, picture) for name, picture in pictures.items()]


def draw_mask(head: PortraitHead) -> UInt8Array:
    """The photo with the mask over it: the lips yellow, the eyes red; (h, w, 3) uint8."""
    picture = head.photo.copy()
    places = np.rint((head.mask.vertices + 0.5) * 16 - 8).astype(np.int32)
    for triangles, colour in ((SKIN_TRIANGLES, _GREEN), (EYE_TRIANGLES, _RED)):
        cv2.polylines(picture, [*places[triangles]], True, colour, 1, cv2.LINE_AA, 4)
    for contour in (OUTER_LIPS, INNER_LIPS):
        cv2.polylines(picture, [places[contour]], True, _YELLOW, 1, cv2.LINE_AA, 4)
    return picture


def face_of(head: PortraitHead, picture: UInt8Array) -> UInt8Array:
    """The part of a picture around the face, at one size."""
    mask = head.mask
    (x, y), (side, above, below) = mask.origin, np.array(FACE) * mask.unit
    x0, x1 = max(0, round(x - side)), min(mask.width, round(x + side))
    y0, y1 = max(0, round(y - above)), min(mask.height, round(y + below))
    return np.asarray(
        cv2.resize(picture[y0:y1, x0:x1], TILE, interpolation=cv2.INTER_AREA), dtype=np.uint8
    )


def _written(path: Path, picture: UInt8Array) -> Path:
    if not cv2.imwrite(str(path), cv2.cvtColor(picture, cv2.COLOR_RGB2BGR)):
        raise DatabaseError(f"{path}: cannot be written")
    return path
