"""A portrait's face drawn frame by frame, as planes for an encoder."""

from __future__ import annotations

import threading
import weakref
from collections.abc import Generator, Iterable
from fractions import Fraction

import cv2
import numpy as np
import numpy.typing as npt

from database.errors import RenderError
from database.photo import HD_HEIGHT, FrameFormat
from database.planes import Colour, Planes
from database.portrait_file import PortraitHead
from database.portrait_mesh import FaceMotion
from database.talk_mask import TalkMask
from render.portrait_scene import PortraitScene
from unitsel.placed import Placed
from unitsel.portrait.performance import Performance

UInt8Array = npt.NDArray[np.uint8]
Size = tuple[int, int]


class PortraitPictures:
    """Draws a portrait's head.

    Parameters
    ----------
    head : PortraitHead
    """

    def __init__(self, head: PortraitHead) -> None:
        self._head = head
        # Starting OpenGL takes as long as drawing a second of video, so what is started stays.
        self._scenes: dict[Size, _Sheet] = {}
        self._lock = threading.Lock()

    def format(self, size: Size | None = None) -> FrameFormat:
        """Size and colours of the pictures.

        Raises
        ------
        RenderError
            If the size has another shape than the photo.
        """
        mask = self._head.mask
        width, height = self._checked(size) if size else (mask.width, mask.height)
        return FrameFormat(width, height, colour_of(height))

    def draw(
        self,
        utterances: Iterable[Placed[Performance]],
        rate: Fraction,
        *,
        size: Size | None = None,
    ) -> Generator[Planes, None, None]:
        """Draw utterances one after another; the face lives on from one to the next.

        Parameters
        ----------
        utterances : iterable of Placed
        rate : Fraction
            Frames a second.
        size : (width, height), optional
            Of the photo's shape; by default the photo's own.

        Yields
        ------
        Planes
            Outside the mask's frame those of the photo.
        """
        form = self.format(size)
        sheet = self._sheet((form.width, form.height), form.colour)
        for utterance in utterances:
            performance = utterance.selection
            motion = performance.motion(self._head.mask, float(rate), utterance.first / float(rate))
            last = len(motion) - 1
            for i in range(utterance.stop - utterance.first):
                yield sheet.planes(motion, min(i, last))

    def _checked(self, size: Size) -> Size:
        mask = self._head.mask
        width, height = size
        fitting = round(width * mask.height / mask.width / 2) * 2
        if width < 2 or height < 2 or width % 2 or height % 2 or abs(height - fitting) > 2:
            raise RenderError(
                f"size {width}x{height}: the portrait is {mask.width}x{mask.height}; sizes are "
                f"even and of its shape, {width // 2 * 2}x{fitting} for example"
            )
        return size

    def _sheet(self, size: Size, colour: Colour) -> _Sheet:
        """What is drawn on, started once for each size."""
        with self._lock:
            if size not in self._scenes:
                sheet = _Sheet(self._head, size, colour)
                self._scenes[size] = sheet
                weakref.finalize(self, sheet.scene.release).atexit = False
            return self._scenes[size]


class _Sheet:
    """A photo's planes at one size, and the scene whose box is laid over them."""

    def __init__(self, head: PortraitHead, size: Size, colour: Colour) -> None:
        photo, mask = scaled(head.photo, head.mask, size)
        self.scene = PortraitScene(photo, mask, head.mouth)
        self._colour = colour
        self._photo = to_planes(photo, colour)

    def planes(self, motion: FaceMotion, frame: int) -> Planes:
        """One frame."""
        x0, y0, width, height = self.scene.box
        drawn = to_planes(
            self.scene.draw(
                motion.displacements[frame], float(motion.jaw[frame]), float(motion.tongue[frame])
            ),
            self._colour,
        )
        out = Planes(self._photo.y.copy(), self._photo.u.copy(), self._photo.v.copy())
        out.y[y0 : y0 + height, x0 : x0 + width] = drawn.y
        rows, columns = slice(y0 // 2, (y0 + height) // 2), slice(x0 // 2, (x0 + width) // 2)
        out.u[rows, columns], out.v[rows, columns] = drawn.u, drawn.v
        return out


def scaled(photo: UInt8Array, mask: TalkMask, size: Size) -> tuple[UInt8Array, TalkMask]:
    """A photo and its mask at another size."""
    if size == (mask.width, mask.height):
        return photo, mask
    factors = np.array(size) / (mask.width, mask.height)
    how = cv2.INTER_AREA if factors.min() < 1 else cv2.INTER_CUBIC
    # Pixel centres are at integers, so the halves go along.
    vertices = (mask.vertices + 0.5) * factors - 0.5
    resized = np.asarray(cv2.resize(photo, size, interpolation=how), dtype=np.uint8)
    return resized, TalkMask(vertices, *size)


def to_planes(rgb: UInt8Array, colour: Colour) -> Planes:
    """A picture's planes, quicker than `database.planes.rgb_to_planes` and within a level of it.

    The photo and what is drawn over it go the same way, so that no seam shows.
    """
    matrix = np.column_stack([colour.from_rgb, colour.offset])
    height, width = rgb.shape[:2]
    half = cv2.resize(rgb, (width // 2, height // 2), interpolation=cv2.INTER_AREA)
    y = cv2.transform(rgb, matrix[:1])
    uv = cv2.transform(half, matrix[1:])
    return Planes(
        np.asarray(y, dtype=np.uint8).reshape(height, width),
        np.ascontiguousarray(uv[..., 0]),
        np.ascontiguousarray(uv[..., 1]),
    )


def colour_of(height: int) -> Colour:
    """What the planes of a picture so high mean, as players take it."""
    return Colour("bt709" if height >= HD_HEIGHT else "bt601")
