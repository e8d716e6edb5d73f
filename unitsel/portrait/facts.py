"""What a portrait's head holds, in numbers."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from database.portrait_file import PortraitHead
from database.portrait_mesh import EYE_TRIANGLES, N_MASK, SKIN_TRIANGLES


@dataclass(frozen=True)
class PortraitFacts:
    """What `inspect_portrait` tells.

    Parameters
    ----------
    path : Path
    width, height : int
        Of the photo as it is drawn, pixels.
    eye_distance, mouth_width : float
        Between the outer eye corners and between the inner corners of the mouth, pixels.
    vertices, triangles : int
        Of the mask.
    opening : float
        How far the lips are apart in the photo, in parts of the eye distance.
    teeth : tuple of int
        Their colour, RGB levels.
    photo : str
        What it was made of.
    notes : tuple of str
        What was done to the photo.
    """

    path: Path
    width: int
    height: int
    eye_distance: float
    mouth_width: float
    vertices: int
    triangles: int
    opening: float
    teeth: tuple[int, int, int]
    photo: str
    notes: tuple[str, ...]

    def as_json(self) -> dict[str, Any]:
        """As JSON values."""
        return asdict(self) | {"path": str(self.path), "kind": "portrait"}


def inspect_portrait(head: PortraitHead) -> PortraitFacts:
    """Tell what a portrait's head holds.

    Raises
    ------
    DatabaseError
        If it is damaged.
    """
    mask = head.mask
    red, green, blue = (round(float(level)) for level in head.mouth.teeth)
    return PortraitFacts(
        head.path,
        mask.width,
        mask.height,
        round(mask.unit, 2),
        round(mask.mouth_width * mask.unit, 2),
        N_MASK,
        len(SKIN_TRIANGLES) + len(EYE_TRIANGLES),
        round(mask.opening, 4),
        (red, green, blue),
        str(head.settings.get("photo", "")),
        tuple(head.report.get("notes", ())),
    )
