"""A portrait's face drawn as it moves: one textured mesh, and the mouth inside it (OpenGL, EGL).

What is drawn, one over the other: the eyes, which stay where they are when a lid comes down over
them; the skin; the inside of the mouth between the inner lips, its edge soft
(render/portrait_shaders.py). Only the box around the mask's frame is drawn and read back; around
the frame it is the photo as it is.

Picture pixel (x, y) is at (x + 0.5, y + 0.5) of the framebuffer, less the box's corner, and at
(2 x + 0.5, 2 y + 0.5) of the texture (`between_pixels`); row 0 is the top one.
"""

from __future__ import annotations

import threading
from types import TracebackType
from typing import Any, Final, Self

import cv2
import moderngl
import numpy as np
import numpy.typing as npt

from database.errors import RenderError
from database.mouth_look import MouthLook
from database.portrait_mesh import (
    EYE_TRIANGLES,
    FRAME,
    INNER_CORNERS,
    LEFT_EYE,
    LEFT_LOWER_LID,
    LEFT_UPPER_LID,
    LOWER_INNER,
    N_MASK,
    RIGHT_EYE,
    RIGHT_LOWER_LID,
    RIGHT_UPPER_LID,
    SKIN_TRIANGLES,
    SKULL,
    UPPER_INNER,
)
from database.talk_mask import TalkMask
from render.portrait_shaders import (
    MOUTH_FRAGMENT,
    MOUTH_VERTEX,
    SKIN_FRAGMENT,
    SKIN_VERTEX,
)
from render.scene import start_opengl

F32 = npt.NDArray[np.float32]
F64 = npt.NDArray[np.float64]

UPPER_EDGE: Final = np.concatenate([INNER_CORNERS[:1], UPPER_INNER, INNER_CORNERS[1:]])
LOWER_EDGE: Final = np.concatenate([INNER_CORNERS[:1], LOWER_INNER, INNER_CORNERS[1:]])
"""The inner lips from corner to corner."""

RIM: Final = 2.0
"""Pixels that the lips are drawn on into the mouth, under its soft edge."""

GENERIC_MOUTH: Final = 0.486
"""Width of the generic mask's mouth, for which the teeth are drawn; units."""


class PortraitScene:
    """A photo's face in its mask; a context manager. Any thread may draw.

    Parameters
    ----------
    picture : (h, w, 3) uint8
        The photo, RGB; its sizes even.
    mask : TalkMask
    mouth : MouthLook

    Raises
    ------
    RenderError
        If OpenGL cannot be started, or the sizes do not fit one another.
    """

    def __init__(self, picture: npt.NDArray[np.uint8], mask: TalkMask, mouth: MouthLook) -> None:
        height, width = picture.shape[:2]
        if (mask.width, mask.height) != (width, height) or width % 2 or height % 2:
            raise RenderError(
                f"the mask is for {mask.width} x {mask.height} pixels, the photo has {width} x "
                f"{height}; they must be the same, and even"
            )
        self.width = width
        self.height = height
        self.mask = mask
        self.box = _box(mask)
        self._rest = mask.vertices
        self._skull = _Skull(mask)
        self._base = np.ascontiguousarray(picture)
        x0, y0, box_width, box_height = self.box
        # What lies outside the mask's frame, or on its edge, stays the photo's.
        inside = np.zeros((box_height, box_width), np.uint8)
        ring = np.rint((mask.vertices[FRAME] - (x0, y0)) * 16).astype(np.int32)
        cv2.fillPoly(inside, [ring], 1, cv2.LINE_8, 4)
        kept = cv2.erode(inside, np.ones((5, 5), np.uint8), borderValue=1) == 0
        self._outside = np.repeat(kept[..., None], 3, axis=2)
        self._around = self._base[y0 : y0 + box_height, x0 : x0 + box_width]
        self._lock = threading.Lock()
        self._context = start_opengl()
        with self._context as context:
            self._skin = context.program(vertex_shader=SKIN_VERTEX, fragment_shader=SKIN_FRAGMENT)
            self._mouth = context.program(
                vertex_shader=MOUTH_VERTEX, fragment_shader=MOUTH_FRAGMENT
            )
            for program in (self._skin, self._mouth):
                program["size"] = (box_width, box_height)
                program["corner"] = (x0, y0)
            fine = between_pixels(self._base)
            texels = (fine.shape[1], fine.shape[0])
            self._skin["texels"] = texels
            self._skin["picture"] = 0
            for name, colour in zip(
                ("teeth", "gum", "tongue", "cavity"), mouth.as_array().tolist(), strict=True
            ):
                self._mouth[name] = tuple(colour)
            self._mouth["pixel"] = self._skull.pixel
            self._texture = context.texture(texels, 3, fine.tobytes(), alignment=1)
            self._texture.filter = (moderngl.LINEAR, moderngl.LINEAR)
            self._texture.repeat_x = self._texture.repeat_y = False
            # The eyes' own vertices, then the mask's.
            rim = self._rest[np.concatenate([UPPER_EDGE, LOWER_EDGE])]
            self._places = np.concatenate([self._rest, self._rest, rim]).astype(np.float32)
            eyes, skin = EYE_TRIANGLES, SKIN_TRIANGLES + N_MASK
            self._position = context.buffer(self._places.tobytes(), dynamic=True)
            self._origin = context.buffer(self._places.tobytes())
            self._buffers = [self._position, self._origin]
            self._face = self._array(np.concatenate([eyes, skin, _rim_triangles()]))
            self._strip = context.buffer(reserve=4 * 4 * 2 * (len(UPPER_INNER) + 2), dynamic=True)
            self._buffers.append(self._strip)
            self._inside = context.vertex_array(
                self._mouth, [(self._strip, "2f 2f", "position", "depth")]
            )
            size = (box_width, box_height)
            self._target = context.framebuffer([context.renderbuffer(size, 4)])
            context.blend_func = moderngl.SRC_ALPHA, moderngl.ONE_MINUS_SRC_ALPHA

    def _array(self, triangles: npt.NDArray[np.int64]) -> Any:
        index = self._context.buffer(triangles.astype(np.int32).tobytes())
        self._buffers.append(index)
        return self._context.vertex_array(
            self._skin,
            [(self._position, "2f", "position"), (self._origin, "2f", "origin")],
            index_buffer=index,
        )

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        value: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.release()

    def release(self) -> None:
        """Give back everything that OpenGL holds; a second call does nothing."""
        with self._lock:
            self._release()

    def _release(self) -> None:
        if self._context is None:
            return
        with self._context:
            for attachment in self._target.color_attachments:
                attachment.release()
            self._target.release()
            for item in (
                *(self._face, self._inside),
                *(*self._buffers, self._texture, self._skin, self._mouth),
            ):
                item.release()
        self._context.release()
        self._context = None

    def draw(
        self,
        displacements: npt.NDArray[np.floating],
        jaw: float = 0.0,
        tongue: float = 0.0,
    ) -> npt.NDArray[np.uint8]:
        """Draw the part of the picture that may move: that of `box`.

        Parameters
        ----------
        displacements : (V, 2) float
            Of the mask's vertices, in its frame and unit (`database.portrait_mesh`).
        jaw : float
            Units that the lower teeth have come down.
        tongue : float
            How far the tongue is raised, 0 to 1.

        Returns
        -------
        (box height, box width, 3) uint8
            RGB.

        Raises
        ------
        RenderError
            If the displacements are not those of a mask or not finite, or the scene was
            released.
        """
        given = np.asarray(displacements, dtype=np.float64)
        if given.shape != (N_MASK, 2) or not np.isfinite([given.sum(), jaw, tongue]).all():
            raise RenderError(
                f"displacements of shape {given.shape}: a mask's are ({N_MASK}, 2), and finite"
            )
        moved = self._rest + np.where(self.mask.free[:, None], self.mask.to_pixels(given), 0.0)
        turn = self._skull.motion(moved)
        places = self._places.copy()
        places[:N_MASK] = self._eyes(moved, turn)
        places[N_MASK : 2 * N_MASK] = moved
        strip, places[2 * N_MASK :] = self._skull.opening(moved)
        with self._lock:
            if self._context is None:
                raise RenderError("the scene was released; make another to draw more")
            data = self._drawn(places, strip, turn, jaw, tongue)
        drawn = np.frombuffer(data, dtype=np.uint8).reshape(self._outside.shape)
        out = drawn.copy()
        np.copyto(out, self._around, where=self._outside)
        return out

    def _drawn(self, places: F32, strip: F32 | None, turn: F64, jaw: float, tongue: float) -> bytes:
        width, height = self.box[2:]
        with self._context:
            self._position.write(places.tobytes())
            self._target.use()
            self._target.viewport = (0, 0, width, height)
            self._texture.use(0)
            self._face.render(moderngl.TRIANGLES)
            if strip is not None:
                self._strip.write(strip.tobytes())
                matrix = self._skull.to_mouth(turn)
                self._mouth["to_mouth"].write(matrix.T.astype(np.float32).tobytes())
                self._mouth["jaw"] = max(float(jaw), 0.0) / self._skull.scale
                self._mouth["raised"] = min(max(float(tongue), 0.0), 1.0)
                self._context.enable(moderngl.BLEND)
                self._inside.render(moderngl.TRIANGLE_STRIP)
                self._context.disable(moderngl.BLEND)
            data: bytes = self._target.read((0, 0, width, height), components=3, alignment=1)
        return data

    def picture(
        self,
        displacements: npt.NDArray[np.floating],
        jaw: float = 0.0,
        tongue: float = 0.0,
    ) -> npt.NDArray[np.uint8]:
        """The whole picture, (h, w, 3) uint8; see `draw`."""
        out = self._base.copy()
        x0, y0, width, height = self.box
        out[y0 : y0 + height, x0 : x0 + width] = self.draw(displacements, jaw, tongue)
        return out

    def _eyes(self, moved: F64, turn: F64) -> F64:
        """Where the vertices are for what lies between the lids: a lid that closes covers it."""
        out = moved.copy()
        still = self._rest @ turn[:2] + turn[2]
        down = self.mask.axes[1] / self.mask.unit
        for eye, upper, lower in (
            (LEFT_EYE, LEFT_UPPER_LID, LEFT_LOWER_LID),
            (RIGHT_EYE, RIGHT_UPPER_LID, RIGHT_LOWER_LID),
        ):
            corners = moved[eye[[0, 7]]] - still[eye[[0, 7]]]
            base = still + corners.mean(axis=0)
            for lid, side in ((upper, 1.0), (lower, -1.0)):
                closing = np.maximum(side * (moved[lid] - base[lid]) @ down, 0.0)
                out[lid] = moved[lid] - side * closing[:, None] * down
        return out


class _Skull:
    """How the skull moves, and with it the frame in which the mouth is drawn."""

    def __init__(self, mask: TalkMask) -> None:
        rest = mask.vertices
        rows = SKULL[mask.free[SKULL]]
        self._rows = rows if len(rows) >= 6 else SKULL
        model = np.column_stack([rest[self._rows], np.ones(len(self._rows))])
        self._solve = np.linalg.pinv(model)
        self.scale = mask.mouth_width / GENERIC_MOUTH
        """Of this mouth in relation to the generic one."""
        self.unit = mask.unit * self.scale
        self.pixel = 1 / self.unit
        corners = rest[INNER_CORNERS]
        middle = (rest[UPPER_INNER[3]] + rest[LOWER_INNER[3]]) / 2
        x = mask.axes[0] / mask.unit
        y = np.array([-x[1], x[0]])
        centre = corners.mean(axis=0)
        # Across from the middle between the corners, down from the line between the lips.
        self._centre = x * (centre @ x) + y * (middle @ y)
        self._frame = np.stack([x, y]) / self.unit

    def motion(self, moved: F64) -> F64:
        """Affine motion of the skull in pixels, (3, 2): ``p @ m[:2] + m[2]``."""
        return np.asarray(self._solve @ moved[self._rows])

    def to_mouth(self, turn: F64) -> F64:
        """(3, 3) from pixels to the mouth's frame, the skull's motion taken out."""
        forward = np.eye(3)
        forward[:2] = turn.T
        still = np.eye(3)
        still[:2, :2] = self._frame
        still[:2, 2] = -self._frame @ self._centre
        return np.asarray(still @ np.linalg.inv(forward))

    def opening(self, moved: F64) -> tuple[F32 | None, F32]:
        """The open mouth as a strip of triangles, and the rim of the lips inside it.

        Returns
        -------
        strip : (2 n, 4) float32, or None
            Place, and depths below the upper lip and above the lower one in units; None where
            the mouth is shut.
        rim : (2 n, 2) float32
            Points a little inside the upper edge, then the lower.
        """
        down = self._frame[1] * self.unit
        above, below = moved[UPPER_EDGE], moved[LOWER_EDGE]
        gap = np.maximum((below - above) @ down, 0.0)
        inwards = np.minimum(RIM, gap / 2)[:, None] * down
        rim = np.concatenate([above + inwards, below - inwards]).astype(np.float32)
        if gap.max() <= 0:
            return None, rim
        out = np.zeros((2 * len(above), 4), dtype=np.float32)
        out[::2, :2], out[1::2, :2] = above, below
        out[::2, 3] = out[1::2, 2] = gap / self.unit
        return out, rim


def _rim_triangles() -> npt.NDArray[np.int64]:
    """Between the edges of the lips and the rim inside them."""
    n = len(UPPER_EDGE)
    out = []
    for edge, first in ((UPPER_EDGE, 0), (LOWER_EDGE, n)):
        for i in range(n - 1):
            a, b = N_MASK + edge[i], N_MASK + edge[i + 1]
            c, d = 2 * N_MASK + first + i, 2 * N_MASK + first + i + 1
            out += [[a, b, c], [b, d, c]]
    return np.array(out)


def between_pixels(picture: npt.NDArray[np.uint8]) -> npt.NDArray[np.uint8]:
    """A picture with one pixel more between any two, (2 h - 1, 2 w - 1, 3) uint8.

    Drawn from it with linear interpolation, a face that moves by parts of a pixel stays as sharp
    as it was, which it would not from the picture itself; and one that does not move is exact.
    """
    height, width = picture.shape[:2]
    half = np.array([[0.5, 0.0, 0.0], [0.0, 0.5, 0.0]])
    return np.asarray(
        cv2.warpAffine(
            picture,
            half,
            (2 * width - 1, 2 * height - 1),
            flags=cv2.INTER_CUBIC | cv2.WARP_INVERSE_MAP,
            borderMode=cv2.BORDER_REPLICATE,
        ),
        dtype=np.uint8,
    )


def _box(mask: TalkMask) -> tuple[int, int, int, int]:
    """Box of what may move: x, y, width, height, all even."""
    ring = mask.vertices[FRAME]
    low = np.maximum(np.floor((ring.min(axis=0) - 0.5) / 2).astype(int) * 2, 0)
    high = np.ceil((ring.max(axis=0) + 1.5) / 2).astype(int) * 2
    high = np.minimum(high, (mask.width, mask.height))
    return int(low[0]), int(low[1]), int(high[0] - low[0]), int(high[1] - low[1])
