"""From one photo to a head that talks: the face found, the mask laid over it, the file written."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Final

import numpy as np
import numpy.typing as npt

from analysis.detector import FaceDetector, people
from analysis.face import FaceFinder, FaceSettings
from analysis.faces import check_choice
from analysis.models import find_models
from analysis.photo import LONGEST, Photo, read_photo
from analysis.portrait_adjust import Adjustment, adjust
from analysis.portrait_edges import EdgeSettings
from analysis.portrait_fit import fit_mask, is_open
from analysis.portrait_mouth import mouth_look
from database.errors import FaceError
from database.mask import OUTER_EYE_CORNERS
from database.portrait_file import write_portrait
from database.portrait_schema import PortraitContent

Progress = Callable[[str, int, int], None]

SMALLEST_FACE: Final = 32.0
"""Pixels between the outer eye corners; in less neither lips nor lids can be told."""

SMALL_FACE: Final = 70.0
"""Pixels; below it is told that the mouth will be coarse."""

TURNED: Final = 12.0
"""Degrees to a side, by the face mesh, which has them too small by a third, from which it is told
that the face should look at the camera."""

PROFILE: Final = 30.0
"""Degrees from which a face is refused: the far side of the mouth is out of sight."""

LOOKS: Final = ((0.93, -0.06), (1.07, 0.06), (0.97, 0.03), (1.03, -0.03))
"""Scales and turns in which the photo is looked at again; see `analysis.face.FaceSettings`. A
video averages over frames, a photo has one."""


@dataclass(frozen=True)
class PortraitSettings:
    """How a photo becomes a head.

    Parameters
    ----------
    face : str
        Which face where there are several: ``largest``, ``left``, ``right``, ``main`` (large and
        central) or a number from the left.
    longest : int
        Pixels of the longer side beyond which the photo is scaled down.
    lips : EdgeSettings
    """

    face: str = "largest"
    longest: int = LONGEST
    lips: EdgeSettings = field(default_factory=EdgeSettings)


@dataclass(frozen=True)
class PortraitReport:
    """What was made of a photo.

    Parameters
    ----------
    path : Path
    width, height : int
        Of its videos, pixels.
    eye_distance : float
        Pixels between the outer eye corners.
    mouth_width : float
        Pixels between the corners of the mouth.
    notes : tuple of str
        What was done or chosen, for people.
    """

    path: Path
    width: int
    height: int
    eye_distance: float
    mouth_width: float
    notes: tuple[str, ...]


def make_portrait(
    photo: str | Path,
    path: str | Path,
    *,
    adjustment: Adjustment | None = None,
    settings: PortraitSettings | None = None,
    models: str | Path | None = None,
    progress: Progress | None = None,
) -> PortraitReport:
    """Make a head of one photo, and write it.

    Parameters
    ----------
    photo : path
        A face that looks at the camera, its mouth closed.
    path : path
        The head's file.
    adjustment : Adjustment, optional
        What is put right by hand.
    settings : PortraitSettings, optional
    models : path, optional
        Folder with the face models.
    progress : callable, optional

    Returns
    -------
    PortraitReport

    Raises
    ------
    MediaError
        If the photo cannot be read.
    FaceError
        If it shows no face, or one that is too small or turned away.
    DatabaseError
        If the file cannot be written.
    """
    chosen = settings or PortraitSettings()
    told = progress or (lambda stage, done, total: None)
    told("fitting the mask", 0, 2)
    content = portrait_of(photo, adjustment=adjustment, settings=chosen, models=models)
    told("fitting the mask", 1, 2)
    write_portrait(path, content)
    told("fitting the mask", 2, 2)
    mask = content.mask
    return PortraitReport(
        Path(path),
        mask.width,
        mask.height,
        mask.unit,
        mask.mouth_width * mask.unit,
        tuple(content.report["notes"]),
    )


def portrait_of(
    photo: str | Path | Photo,
    *,
    adjustment: Adjustment | None = None,
    settings: PortraitSettings | None = None,
    models: str | Path | None = None,
) -> PortraitContent:
    """What `make_portrait` writes.

    Parameters
    ----------
    photo : path or Photo
    adjustment, settings, models
        See `make_portrait`.
    """
    chosen = settings or PortraitSettings()
    check_choice(chosen.face)
    name = "the photo" if isinstance(photo, Photo) else str(photo)
    read = photo if isinstance(photo, Photo) else read_photo(photo, chosen.longest)
    mesh, notes = _find(name, read.rgb, chosen, models)
    mask = fit_mask(read.rgb, mesh, chosen.lips)
    if mask.folded():
        raise FaceError(
            f"{name}: the mask does not fit ({mask.folded()} of its triangles are turned over); "
            "the face must look at the camera"
        )
    if adjustment is not None:
        mask = adjust(mask, adjustment)
    if is_open(mesh):
        notes.append(
            "the mouth is open: what is inside is drawn anew, and a closed one looks better"
        )
    report = {"notes": [*read.notes, *notes], "opening": mask.opening}
    kept = asdict(chosen) | {"photo": name}
    if adjustment is not None:
        kept["adjustment"] = {
            "box": adjustment.box,
            "vertices": {str(k): list(v) for k, v in adjustment.vertices.items()},
            "drags": [asdict(drag) for drag in adjustment.drags],
        }
    return PortraitContent(
        read.rgb,
        replace(mask, vertices=np.round(mask.vertices, 3)),
        mesh[:, :2],
        mouth_look(read.rgb, mask),
        kept,
        report,
    )


def _find(
    name: str,
    picture: npt.NDArray[np.uint8],
    settings: PortraitSettings,
    models: str | Path | None,
) -> tuple[npt.NDArray[np.float32], list[str]]:
    """The face's mesh, (468, 3), and what is to be told of it."""
    found_models = find_models(models)
    looks = FaceSettings(face=settings.face, looks=LOOKS)
    found = FaceFinder(found_models, looks).find(picture)
    faces = people(FaceDetector(found_models.detector, looks.detection_score).faces(picture))
    if found is None:
        if faces and settings.face.isdigit() and int(settings.face) > len(faces):
            raise FaceError(
                f"{name}: shows {len(faces)} face{'s' if len(faces) > 1 else ''}, so there is no "
                f"number {settings.face}"
            )
        raise FaceError(
            f"{name}: shows no face that looks at the camera; take a photo from the front, with "
            "eyes and mouth in sight"
        )
    points = found.points
    across = points[OUTER_EYE_CORNERS[1]] - points[OUTER_EYE_CORNERS[0]]
    distance = float(np.hypot(across[0], across[1]))
    turned = abs(float(np.degrees(np.arctan2(across[2], distance))))
    if turned > PROFILE:
        raise FaceError(
            f"{name}: the face is turned {turned:.0f} degrees to the side; take a photo from the "
            "front"
        )
    if distance < SMALLEST_FACE:
        raise FaceError(
            f"{name}: the face is too small ({distance:.0f} pixels between the outer eye corners, "
            f"{SMALLEST_FACE:.0f} are needed); take a larger photo, or cut out the face"
        )
    notes = []
    if len(faces) > 1:
        which = "the largest" if settings.face == "largest" else f"{settings.face!r}"
        notes.append(f"shows {len(faces)} faces; {which} was taken (--face chooses another)")
    if turned > TURNED:
        notes.append(f"the face is turned {turned:.0f} degrees; from the front it looks better")
    if distance < SMALL_FACE:
        notes.append(
            f"the face is small ({distance:.0f} pixels between the outer eye corners): the mouth "
            "will be coarse"
        )
    return points, notes
