"""How a recording wants to be turned before it is shown (FFmpeg's display matrix).

Telephones write pictures as the sensor lies and note the turn in the file. Quarter turns and
mirrors are carried out on the planes, sample for sample; any other angle goes to the nearest
quarter.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from typing import Final, cast

import av
import numpy as np
import numpy.typing as npt
from av.sidedata.sidedata import SideData, Type

from database.planes import Planes

Plane = npt.NDArray[np.uint8]


@dataclass(frozen=True)
class Orientation:
    """Columns and rows exchanged, then mirrored.

    Parameters
    ----------
    transposed : bool
        Whether columns become rows.
    mirrored, upturned : bool
        Whether, after that, left and right or top and bottom change places.
    """

    transposed: bool = False
    mirrored: bool = False
    upturned: bool = False

    def size(self, width: int, height: int) -> tuple[int, int]:
        """Width and height after turning."""
        return (height, width) if self.transposed else (width, height)

    def turned(self, planes: Planes) -> Planes:
        """The planes as they are to be seen."""
        return Planes(self._plane(planes.y), self._plane(planes.u), self._plane(planes.v))

    def _plane(self, plane: Plane) -> Plane:
        out = plane.T if self.transposed else plane
        out = out[:: -1 if self.upturned else 1, :: -1 if self.mirrored else 1]
        return np.ascontiguousarray(out)


UPRIGHT: Final = Orientation()
"""What most files ask for: nothing."""


def orientation_of(frame: av.VideoFrame) -> Orientation:
    """What a decoded frame's display matrix asks for; upright where it has none."""
    data = next((d for d in _side_data(frame) if d.type == Type.DISPLAYMATRIX), None)
    if data is None:
        return UPRIGHT
    # x' = a x + c y and y' = b x + d y, with y down.
    a, b, _, c, d = np.frombuffer(bytes(data), np.int32, 5).astype(np.float64)
    if abs(a) + abs(d) >= abs(b) + abs(c):
        return Orientation(False, bool(a < 0), bool(d < 0))
    return Orientation(True, bool(c < 0), bool(b < 0))


def _side_data(frame: av.VideoFrame) -> Iterator[SideData]:
    # PyAV calls its container a mapping, but iterating gives the values.
    return iter(cast(Iterable[SideData], frame.side_data))
