"""Everything that a portrait's head holds, field by field.

It is an HDF5 file of the same make as a database's (database/schema.py): every dataset has a
checksum, strings a fixed length, and the root's attributes are few. `schema` tells the two apart.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from database.checks import check_finite
from database.mask import N_VERTICES
from database.mouth_look import MouthLook
from database.portrait_mesh import N_MASK
from database.schema import Field
from database.talk_mask import TalkMask

PORTRAIT_SCHEMA_NAME: Final = "unitsel-portrait"
PORTRAIT_SCHEMA_VERSION: Final = 1

# fmt: off
PORTRAIT_FIELDS: Final[tuple[Field, ...]] = (
    Field("portrait/photo", "uint8", ("bytes",), "bytes", "the photo as it is drawn, PNG"),
    Field("portrait/size", "int32", (2,), "pixel", "its width and height, even"),
    Field("portrait/vertices", "float64", (N_MASK, 2), "pixel",
          "the Talk Mask's vertices in the photo (database/portrait_mesh.py)"),
    Field("portrait/landmarks", "float32", (N_VERTICES, 2), "pixel",
          "face mesh in the photo, as the network gave it"),
    Field("portrait/mouth", "float32", (4, 3), "level",
          "colours of teeth, gum, tongue and cavity (database/mouth_look.py)"),
    Field("build/settings", "string", (1,), "", "what it was made with, JSON"),
    Field("build/versions", "string", (1,), "",
          "versions of unitsel and of the libraries that shaped the content, JSON"),
    Field("build/report", "string", (1,), "", "what was done to the photo, JSON"),
)
# fmt: on
"""All datasets."""


@dataclass(frozen=True)
class PortraitContent:
    """All of a portrait's head.

    Parameters
    ----------
    photo : (h, w, 3) uint8
        RGB, both sizes even.
    mask : TalkMask
    landmarks : (468, 2) float
    mouth : MouthLook
    settings, report : dict
        JSON values.
    """

    photo: npt.NDArray[np.uint8]
    mask: TalkMask
    landmarks: npt.NDArray[np.floating]
    mouth: MouthLook
    settings: dict[str, Any] = field(default_factory=dict)
    report: dict[str, Any] = field(default_factory=dict)


def check_portrait(mask: TalkMask, mouth: MouthLook) -> None:
    """Check a portrait's mask and mouth.

    Raises
    ------
    ValueError
        Naming the field and the fault.
    """
    check_finite("portrait/vertices", mask.vertices)
    if min(mask.width, mask.height) < 2 or mask.width % 2 or mask.height % 2:
        raise ValueError(
            f"portrait/size is {mask.width} x {mask.height}; both must be even and positive"
        )
    if mask.unit < 1:
        raise ValueError("portrait/vertices: the eyes are less than a pixel apart")
    colours = mouth.as_array()
    check_finite("portrait/mouth", colours)
    if colours.min() < 0 or colours.max() > 255:
        raise ValueError("portrait/mouth holds a level outside 0..255")
