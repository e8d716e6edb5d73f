"""A portrait's face drawn as it moves: one textured mesh, and the mouth behind it (OpenGL, EGL).

What is drawn, one over the other: the photo as it is; the inside of the mouth, between the inner
lips (render/portrait_shaders.py); the eyes, which stay where they are when a lid comes down over
them; the skin. Only the box around the mask's frame is drawn and read back.

Picture pixel (x, y) is at (x + 0.5, y + 0.5) of the photo's texture and of the framebuffer, less
the box's corner; row 0 is the top one. Edges are smoothed by several samples a pixel.
"""

from __future__ import annotations

from types import TracebackType
from typing import Any, Final, Self

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

SAMPLES: Final = 4
"""Samples a pixel along the edges of triangles."""

GENERIC_MOUTH: Final = 0.486
"""Width of the generic mask's mouth, for which the teeth are drawn; units."""


class PortraitScene:
    """A photo's face in its mask; a context manager.

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
        self._context = start_opengl()
        with self._context as context:
            self._skin = context.program(vertex_shader=SKIN_VERTEX, fragment_shader=SKIN_FRAGMENT)
            self._mouth = context.program(
                vertex_shader=MOUTH_VERTEX, fragment_shader=MOUTH_FRAGMENT
            )
            for program in (self._skin, self._mouth):
                program["size"] = (box_width, box_height)
                program["corner"] = (x0, y0)
            self._skin["photo"] = (width, height)
            self._skin["picture"] = 0
            for name, colour in zip(
                ("teeth", "gum", "tongue", "cavity"), mouth.as_array().tolist(), strict=True
            ):
                self._mouth[name] = tuple(colour)
            self._mouth["pixel"] = self._skull.pixel
            self._texture = context.texture((width, height), 3, self._base.tobytes(), alignment=1)
            self._texture.filter = (moderngl.NEAREST, moderngl.NEAREST)
            # Four corners of the box, the eyes' own vertices, then the mask's.
            corners = np.array(
                [
                    [x0 - 0.5, y0 - 0.5],
                    [x0 + box_width - 0.5, y0 - 0.5],
                    [x0 + box_width - 0.5, y0 + box_height - 0.5],
                    [x0 - 0.5, y0 + box_height - 0.5],
                ]
            )
            self._places = np.concatenate([corners, self._rest, self._rest]).astype(np.float32)
            paper = np.array([[0, 1, 2], [0, 2, 3]])
            eyes, skin = EYE_TRIANGLES + 4, SKIN_TRIANGLES + 4 + N_MASK
            self._position = context.buffer(self._places.tobytes(), dynamic=True)
            self._origin = context.buffer(self._places.tobytes())
            self._buffers = [self._position, self._origin]
            self._paper = self._array(paper)
            self._face = self._array(np.concatenate([eyes, skin]))
            self._strip = context.buffer(reserve=4 * 4 * 2 * (len(UPPER_INNER) + 2), dynamic=True)
            self._buffers.append(self._strip)
            self._inside = context.vertex_array(
                self._mouth, [(self._strip, "2f 2f", "position", "depth")]
            )
            size = (box_width, box_height)
            self._smooth = context.framebuffer(
                [context.renderbuffer(size, 4, samples=min(SAMPLES, context.max_samples))]
            )
            self._target = context.framebuffer([context.renderbuffer(size, 4)])

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
        if self._context is None:
            return
        with self._context:
            for framebuffer in (self._smooth, self._target):
                for attachment in framebuffer.color_attachments:
                    attachment.release()
                framebuffer.release()
            for item in (
                *(self._paper, self._face, self._inside),
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
        if self._context is None:
            raise RenderError("the scene was released; make another to draw more")
        given = np.asarray(displacements, dtype=np.float64)
        if given.shape != (N_MASK, 2) or not np.isfinite([given.sum(), jaw, tongue]).all():
            raise RenderError(
                f"displacements of shape {given.shape}: a mask's are ({N_MASK}, 2), and finite"
            )
        moved = self._rest + np.where(self.mask.free[:, None], self.mask.to_pixels(given), 0.0)
        turn = self._skull.motion(moved)
        places = self._places
        places[4 : 4 + N_MASK] = self._eyes(moved, turn)
        places[4 + N_MASK :] = moved
        strip = self._skull.strip(moved)
        width, height = self.box[2:]
        with self._context:
            self._position.write(places.tobytes())
            self._smooth.use()
            self._smooth.viewport = (0, 0, width, height)
            self._texture.use(0)
            self._paper.render(moderngl.TRIANGLES)
            if strip is not None:
                self._strip.write(strip.tobytes())
                matrix = self._skull.to_mouth(turn)
                self._mouth["to_mouth"].write(matrix.T.astype(np.float32).tobytes())
                self._mouth["jaw"] = max(float(jaw), 0.0) / self._skull.scale
                self._mouth["raised"] = min(max(float(tongue), 0.0), 1.0)
                self._inside.render(moderngl.TRIANGLE_STRIP)
            self._face.render(moderngl.TRIANGLES)
            self._context.copy_framebuffer(self._target, self._smooth)
            data = self._target.read((0, 0, width, height), components=3, alignment=1)
        return np.frombuffer(data, dtype=np.uint8).reshape(height, width, 3)

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

    def strip(self, moved: F64) -> F32 | None:
        """The open mouth as a strip of triangles, (2 n, 4) float32; None where it is shut."""
        down = self._frame[1] * self.unit
        corners = moved[INNER_CORNERS]
        above = np.concatenate([corners[:1], moved[UPPER_INNER], corners[1:]])
        below = np.concatenate([corners[:1], moved[LOWER_INNER], corners[1:]])
        gap = (below - above) @ down / self.unit
        if gap.max() <= 0:
            return None
        out = np.zeros((2 * len(above), 4), dtype=np.float32)
        out[::2, :2], out[1::2, :2] = above, below
        out[::2, 3] = out[1::2, 2] = np.maximum(gap, 0)
        return out


def _box(mask: TalkMask) -> tuple[int, int, int, int]:
    """Box of what may move: x, y, width, height, all even."""
    ring = mask.vertices[FRAME]
    low = np.maximum(np.floor((ring.min(axis=0) - 0.5) / 2).astype(int) * 2, 0)
    high = np.ceil((ring.max(axis=0) + 1.5) / 2).astype(int) * 2
    high = np.minimum(high, (mask.width, mask.height))
    return int(low[0]), int(low[1]), int(high[0] - low[0]), int(high[1] - low[1])
