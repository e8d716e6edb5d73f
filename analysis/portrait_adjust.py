"""A mask put right by hand (Image Talk, section 5.2): as a box, and by dragging with falloff."""

from __future__ import annotations

import json
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from database.errors import FaceError
from database.portrait_mesh import FRAME, MESH_INDEX, N_MASK
from database.talk_mask import TalkMask

F64 = npt.NDArray[np.float64]

REACH: Final = 0.25
"""Units around a dragged place that follow it, where nothing else is said."""


@dataclass(frozen=True)
class Drag:
    """A place of the mask that is pulled elsewhere.

    Parameters
    ----------
    start, end : (float, float)
        From where to where; pixels of the photo as it is drawn.
    reach : float
        How far around it vertices follow, less and less; units (distances of the outer eye
        corners). 0 takes the nearest vertex alone.
    """

    start: tuple[float, float]
    end: tuple[float, float]
    reach: float = REACH


@dataclass(frozen=True)
class Adjustment:
    """What is changed of a mask, in this order.

    Parameters
    ----------
    box : (left, top, right, bottom), optional
        Where the box around the face's own vertices (all but the rings) goes; pixels.
    vertices : dict of int to (x, y)
        Vertices that are put somewhere, alone.
    drags : tuple of Drag
        One after another.
    """

    box: tuple[float, float, float, float] | None = None
    vertices: dict[int, tuple[float, float]] = field(default_factory=dict)
    drags: tuple[Drag, ...] = ()


def adjust(mask: TalkMask, adjustment: Adjustment) -> TalkMask:
    """A mask put right by hand.

    Parameters
    ----------
    mask : TalkMask
    adjustment : Adjustment

    Raises
    ------
    FaceError
        If triangles are turned over by it that were not before.
    """
    vertices = mask.vertices.copy()
    if adjustment.box is not None:
        vertices = _into_box(vertices, adjustment.box)
    for index, place in adjustment.vertices.items():
        vertices[index] = place
    for drag in adjustment.drags:
        vertices = dragged(vertices, drag, mask.unit)
    changed = replace(mask, vertices=vertices)
    if changed.folded() > mask.folded():
        raise FaceError(
            f"the adjustment turns {changed.folded() - mask.folded()} of the mask's triangles "
            "over; drag less far, or with a greater reach"
        )
    return changed


def dragged(vertices: F64, drag: Drag, unit: float) -> F64:
    """Pull a place of a mask; vertices around it follow, those of the frame never do.

    Parameters
    ----------
    vertices : (V, 2) float64
        Pixels.
    drag : Drag
    unit : float
        Pixels of the mask's unit.
    """
    away = np.linalg.norm(vertices - drag.start, axis=1) / unit
    away[FRAME] = np.inf
    if drag.reach > 0:
        share = np.clip(1 - (away / drag.reach) ** 2, 0, None) ** 2
    else:
        share = np.zeros(len(vertices))
        share[np.argmin(away)] = 1
    by = np.subtract(drag.end, drag.start)
    return np.asarray(vertices + share[:, None] * by)


def _into_box(vertices: F64, box: tuple[float, float, float, float]) -> F64:
    face = vertices[MESH_INDEX >= 0]
    low, high = face.min(axis=0), face.max(axis=0)
    new_low, new_high = np.array(box[:2]), np.array(box[2:])
    out = vertices.copy()
    inner = np.ones(N_MASK, bool)
    inner[FRAME] = False
    out[inner] = (vertices[inner] - low) / (high - low) * (new_high - new_low) + new_low
    return out


def read_adjustment(path: str | Path) -> Adjustment:
    """Read an adjustment from a JSON file.

    It is an object with any of ``box`` (``[left, top, right, bottom]``), ``vertices``
    (``{"12": [x, y]}``) and ``drags`` (``[{"from": [x, y], "to": [x, y], "reach": 0.25}]``), in
    pixels of the photo as it is drawn.

    Raises
    ------
    FaceError
        If the file cannot be read or holds something else.
    """
    file = Path(path)
    try:
        document = json.loads(file.read_text(encoding="utf-8"))
    except OSError as error:
        raise FaceError(f"{file}: cannot be read ({error.strerror or error})") from error
    except ValueError as error:
        raise FaceError(f"{file}: is no JSON file ({error})") from error
    try:
        return _parsed(document)
    except (ValueError, TypeError) as error:
        raise FaceError(
            f'{file}: {error}; the form is {{"box": [left, top, right, bottom], "vertices": '
            '{"12": [x, y]}, "drags": [{"from": [x, y], "to": [x, y], "reach": 0.25}]}'
        ) from error


def _parsed(document: Any) -> Adjustment:
    if not isinstance(document, dict):
        raise ValueError("is no JSON object")
    _refuse_others("it", document, {"box", "vertices", "drags"})
    box = None
    if document.get("box") is not None:
        left, top, right, bottom = _numbers("box", document["box"], 4)
        if right <= left or bottom <= top:
            raise ValueError(
                "box: the right edge must be beyond the left, the bottom below the top"
            )
        box = (left, top, right, bottom)
    given = document.get("vertices", {})
    if not isinstance(given, dict):
        raise ValueError("vertices is no object")
    vertices = {}
    for name, place in given.items():
        if not (name.isascii() and name.isdigit() and int(name) < N_MASK):
            raise ValueError(f"vertices: {name!r} is no vertex, they are 0 to {N_MASK - 1}")
        x, y = _numbers(f"vertices, {name}", place, 2)
        vertices[int(name)] = (x, y)
    listed = document.get("drags", [])
    if not isinstance(listed, list):
        raise ValueError("drags is no list")
    return Adjustment(box, vertices, tuple(_drag(i, one) for i, one in enumerate(listed)))


def _drag(i: int, one: Any) -> Drag:
    where = f"drags[{i}]"
    if not isinstance(one, dict) or not {"from", "to"} <= one.keys():
        raise ValueError(f"{where} has no 'from' and 'to'")
    _refuse_others(where, one, {"from", "to", "reach"})
    (reach,) = _numbers(f"{where}, reach", [one.get("reach", REACH)], 1)
    if reach < 0:
        raise ValueError(f"{where}: its reach is below 0")
    x, y = _numbers(f"{where}, from", one["from"], 2)
    to_x, to_y = _numbers(f"{where}, to", one["to"], 2)
    return Drag((x, y), (to_x, to_y), reach)


def _refuse_others(where: str, document: dict[str, Any], known: set[str]) -> None:
    others = sorted(set(document) - known)
    if others:
        raise ValueError(f"{where} has {others[0]!r}, which means nothing here")


def _numbers(name: str, value: Any, count: int) -> list[float]:
    numbers = value if isinstance(value, list) else []
    whole = len(numbers) == count and all(
        isinstance(n, int | float) and not isinstance(n, bool) and np.isfinite(n) for n in numbers
    )
    if not whole:
        raise ValueError(f"{name} must be {count} finite number{'s' if count > 1 else ''}")
    return [float(n) for n in numbers]
