"""Selected mouths drawn onto the frames of a background.

Frames are made in two steps that run side by side: reading (the background's frame, the unit's
picture, the colour between them) goes some frames ahead of drawing.
"""

from __future__ import annotations

import threading
import weakref
from collections import OrderedDict
from collections.abc import Callable, Generator, Iterable, Iterator
from contextlib import closing, nullcontext
from dataclasses import replace
from fractions import Fraction
from functools import cached_property
from typing import Final

import cv2
import numpy as np
import numpy.typing as npt

from database.errors import RenderError
from database.mask import Camera
from database.media import snap_rate
from database.pictures import Picture
from database.planes import Planes
from database.reader import UnitDatabase
from database.track import frame_count
from render.background import Background
from render.blend import BlendShape, blend_alpha
from render.colour_transfer import ColourTransfer
from render.compose import composite, cut_from_planes
from render.eyes import Eyes
from render.layer_picture import layer_picture
from render.mouth_painter import DecodedFrame, MouthPainter
from render.playback import Playback, PlayedFrame
from render.scene import MouthLayer, Scene
from unitsel.ahead import Ahead
from unitsel.placed import Placed
from unitsel.select import Selection
from unitsel.writing import Frame

Progress = Callable[[str, int, int], None]

READ_AHEAD: Final = 12
"""Frames that are decoded before they are drawn."""

CROPS_KEPT: Final = 64_000_000
"""Bytes of the background's own mouths that are kept, since its frames come again."""

Size = tuple[int, int]


class UnitPictures:
    """Draws the mouths of a database.

    Parameters
    ----------
    database : UnitDatabase
    blend : BlendShape, optional
        Where the mouth's picture ends and the background begins.
    """

    def __init__(self, database: UnitDatabase, blend: BlendShape | None = None) -> None:
        self._database = database
        self._blend = blend
        self.notes: tuple[str, ...] = ()
        """What a user should know of how the last background was played."""
        # Starting OpenGL takes as long as drawing a second of video, so what is started stays.
        self._scenes: dict[Camera, Scene] = {}
        self._lock = threading.Lock()

    @cached_property
    def _alpha(self) -> npt.NDArray[np.float32]:
        return blend_alpha(self._database.mask, self._blend)

    @cached_property
    def _transfer(self) -> ColourTransfer:
        return ColourTransfer(self._alpha)

    def draw(
        self,
        selection: Selection,
        background: Background,
        *,
        fps: float | Fraction | None = None,
        size: Size | None = None,
        alpha: bool = False,
        eyes: Background | None = None,
        progress: Progress | None = None,
    ) -> Iterator[Frame]:
        """Draw a selection; see `Synthesizer.render` and `draw_placed`."""
        rate = snap_rate(background.fps if fps is None else fps)
        n = frame_count(selection.duration, float(rate))
        whole = iter([Placed(selection, 0, 0.0, 0, n)])
        pictures = self.draw_placed(
            whole, background, rate, size=size, alpha=alpha, eyes=eyes, length=n
        )
        with closing(pictures):
            for i, picture in enumerate(pictures):
                yield picture
                if progress is not None:
                    progress("rendering", i + 1, n)

    def draw_placed(
        self,
        utterances: Iterable[Placed[Selection]],
        background: Background,
        rate: Fraction,
        *,
        size: Size | None = None,
        alpha: bool = False,
        eyes: Background | None = None,
        length: int | None = None,
    ) -> Generator[Frame, None, None]:
        """Draw utterances one after another, the background going on through all of them.

        Parameters
        ----------
        utterances : iterable of Placed
            Read in another thread, some frames before they are drawn.
        background : Background
        rate : Fraction
            Frames a second.
        size : (width, height), optional
            Of the pictures; by default the background's.
        alpha : bool
            Draw the mouth alone.
        eyes : Background, optional
            Whose eyes are laid on the background.
        length : int, optional
            Frames in all, where that is known.

        Yields
        ------
        Planes, or (height, width, 4) uint8
            The picture's planes, or the mouth's RGB and alpha, not premultiplied.
        """
        if alpha and eyes is not None:
            raise RenderError("eyes are laid on a background, and a mouth alone has none")
        drawn = self._layers(utterances, background, rate, size, eyes, length)
        with closing(drawn) as layers:
            for decoded, layer in layers:
                if alpha:
                    yield layer_picture(layer, decoded.planes.width, decoded.planes.height)
                else:
                    yield composite(decoded.planes, layer, decoded.frame.colour)

    def _layers(
        self,
        utterances: Iterable[Placed[Selection]],
        background: Background,
        rate: Fraction,
        size: Size | None,
        eyes: Background | None,
        length: int | None,
    ) -> Generator[tuple[DecodedFrame, MouthLayer], None, None]:
        """The mouth of each frame, and what it was drawn from."""
        with Playback(
            background, rate, self._database.mask.patch, self._database.camera, length=length
        ) as played:
            self.notes = played.notes
            own = (played.width, played.height)
            size = own if size is None else size
            check_size(size, own, background)
            painter = self.painter(size)
            steps = self.decoded(utterances, played, rate, size)
            mask, camera = self._database.mask, self._database.camera
            laid = nullcontext() if eyes is None else Eyes(eyes, mask, camera, rate, *size)
            with Ahead(steps, READ_AHEAD, "reading") as ahead, laid as own_eyes:
                for decoded in ahead:
                    layer = painter.paint(decoded)
                    if own_eyes is not None:
                        pose, colour = decoded.frame.pose, decoded.frame.colour
                        planes = own_eyes.lay(decoded.planes, pose, colour)
                        decoded = replace(decoded, planes=planes)
                    yield decoded, layer

    def painter(self, size: Size) -> MouthPainter:
        """What draws the mouths of one video, in pictures of a size."""
        scene = self._scene(self._database.camera.scaled_to(*size))
        return MouthPainter(scene, self._transfer, self._database.units.sequence)

    def decoded(
        self,
        utterances: Iterable[Placed[Selection]],
        played: Playback,
        rate: Fraction,
        size: Size,
    ) -> Iterator[DecodedFrame]:
        """Read and decode what the frames of utterances are made of.

        Parameters
        ----------
        utterances : iterable of Placed
        played : Playback
            The background.
        rate : Fraction
            Frames a second.
        size : (width, height)
            Of the pictures.
        """
        crops: OrderedDict[tuple[int, int], Picture] = OrderedDict()
        for utterance in utterances:
            for unit in units_of(utterance, rate).tolist():
                frame = next(played)
                crop = self._database.picture(unit)
                seen = self._seen(frame, played.camera, crops)
                fitted = self._transfer.field(seen, crop)
                yield DecodedFrame(frame, resized(frame.planes, size), unit, crop, fitted)

    def _seen(
        self,
        frame: PlayedFrame,
        camera: Camera,
        kept: OrderedDict[tuple[int, int], Picture],
    ) -> Picture:
        """The background's own mouth, cut out at its pose."""
        key = (frame.part, frame.place)
        if not frame.blended and key in kept:
            kept.move_to_end(key)
            return kept[key]
        patch = self._database.mask.patch
        crop = cut_from_planes(frame.planes, frame.colour, patch, frame.pose, camera)
        if not frame.blended:
            kept[key] = crop
            while len(kept) * crop.nbytes > CROPS_KEPT:
                kept.popitem(last=False)
        return crop

    def _scene(self, camera: Camera) -> Scene:
        """The scene for a camera, started once."""
        with self._lock:
            if camera not in self._scenes:
                patch = self._database.mask.patch
                scene = Scene(camera.width, camera.height, patch, camera, self._alpha)
                self._scenes[camera] = scene
                weakref.finalize(self, scene.release).atexit = False
            return self._scenes[camera]


def units_of(utterance: Placed[Selection], rate: Fraction) -> npt.NDArray[np.int64]:
    """Unit of each frame of an utterance, (stop - first,) int64; past its ends the nearest."""
    selection = utterance.selection
    middles = np.arange(utterance.first, utterance.stop) + 0.5
    times = middles / float(rate) - utterance.start
    # A time on the border of two frames belongs to the later one, whatever the rounding.
    place = np.floor(times * selection.fps + 1e-9).astype(np.int64)
    units: npt.NDArray[np.int64] = selection.units[np.clip(place, 0, len(selection.units) - 1)]
    return units


def check_size(size: Size, own: Size, background: Background) -> None:
    """Refuse a size of another shape than the background's.

    Raises
    ------
    RenderError
        Naming a size that fits.
    """
    width, height = size
    fitting = round(width * own[1] / own[0] / 2) * 2
    if width < 2 or height < 2 or width % 2 or height % 2 or abs(height - fitting) > 2:
        raise RenderError(
            f"size {width}x{height}: {background.path} is {own[0]}x{own[1]}; sizes are even and of "
            f"the same shape, such as {max(2, width // 2 * 2)}x{max(2, fitting)}"
        )


def resized(planes: Planes, size: Size) -> Planes:
    """A picture in another size, the same one if it has it already."""
    if (planes.width, planes.height) == size:
        return planes
    smaller = size[0] < planes.width
    how = cv2.INTER_AREA if smaller else cv2.INTER_CUBIC
    half = (size[0] // 2, size[1] // 2)
    y, u, v = (
        np.asarray(cv2.resize(plane, wanted, interpolation=how), dtype=np.uint8)
        for plane, wanted in ((planes.y, size), (planes.u, half), (planes.v, half))
    )
    return Planes(y, u, v)
