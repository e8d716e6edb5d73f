"""From phonemes to a video: select units, stitch them onto a background, write the file."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator
from dataclasses import dataclass, replace
from fractions import Fraction
from functools import cached_property
from pathlib import Path
from typing import Final

import numpy as np
import numpy.typing as npt

from analysis.clip import sha256_of, track_face
from analysis.face import FaceFinder
from analysis.models import find_models
from analysis.reference import from_stored
from database.errors import MediaError, RenderError
from database.mask import Poses, cut_crop
from database.media import probe, snap_rate
from database.planes import Planes
from database.reader import UnitDatabase
from database.sound import Sound
from database.track import PhonemeTrack, frame_count
from database.video_writer import VideoWriter
from render.background import Background, playback_indices, stream_frames
from render.blend import BlendShape, blend_alpha, ring_weights
from render.compose import apply_gain, composite, fit_gain
from render.scene import Scene
from unitsel.costs import Weights
from unitsel.select import Selection, select_units
from unitsel.settings import SelectionSettings, default_settings
from unitsel.source import SelectionInput

Progress = Callable[[str, int, int], None]

GAIN_MEMORY: Final = 0.7
"""How much of the last frame's colour gain a frame keeps inside a segment: fits flicker."""


@dataclass(frozen=True)
class Written:
    """A video that was written.

    Parameters
    ----------
    path : Path
    background : Path
    frames : int
    fps : float
    seconds : float
        Length of the video.
    """

    path: Path
    background: Path
    frames: int
    fps: float
    seconds: float


class Synthesizer:
    """Makes the person of a database say something.

    Parameters
    ----------
    database : UnitDatabase
    settings : SelectionSettings or Weights, optional
        How units are selected; the database's own by default, and weights alone replace its
        weights.
    models : path, optional
        Folder with the face models, for backgrounds that are not in the database.
    blend : BlendShape, optional
        Where the mouth's picture ends and the background begins.
    """

    def __init__(
        self,
        database: UnitDatabase,
        settings: SelectionSettings | Weights | None = None,
        *,
        models: str | Path | None = None,
        blend: BlendShape | None = None,
    ) -> None:
        self.database = database
        if isinstance(settings, Weights):
            settings = replace(default_settings(database), weights=settings)
        self.settings = settings or default_settings(database)
        self._source = SelectionInput.of(database, self.settings.costs)
        self._models = models
        self._blend = blend

    @cached_property
    def _alpha(self) -> npt.NDArray[np.float32]:
        return blend_alpha(self.database.mask, self._blend)

    @cached_property
    def _ring(self) -> npt.NDArray[np.float32]:
        return ring_weights(self._alpha)

    def select(
        self,
        track: PhonemeTrack,
        *,
        sound: Sound | None = None,
        exclude_sequences: Collection[int | str] = (),
        progress: Progress | None = None,
    ) -> Selection:
        """Choose a recorded mouth for every frame of a phoneme track.

        Parameters
        ----------
        track : PhonemeTrack
        sound : Sound, optional
            What is heard, for the target cost "sound".
        exclude_sequences : collection of int or str
            Sequences, by index or name, whose units may not be used.
        progress : callable, optional

        Returns
        -------
        Selection

        Raises
        ------
        SelectionError
            If no unit may be used, or the target cost needs what is not there.
        """
        told = (
            None if progress is None else (lambda done, total: progress("selecting", done, total))
        )
        return select_units(
            self._source,
            track,
            self.settings,
            sound=sound,
            exclude_sequences=exclude_sequences,
            progress=told,
        )

    def background(
        self, video: str | Path | None = None, *, progress: Progress | None = None
    ) -> Background:
        """A video of the person, with the head's pose in each frame.

        Parameters
        ----------
        video : path, optional
            A video file of the same person; one that the database was built from is known
            already, any other is tracked now. By default the database's steadiest clip.
        progress : callable, optional

        Raises
        ------
        RenderError
            If there is no video to use.
        MediaError, FaceError
            If the video cannot be read, or shows no face.
        """
        sequences = self.database.sequences
        if video is None:
            return self._own_background(self._steadiest())
        path = Path(video)
        probe(path)
        checksum = sha256_of(path)
        if checksum in sequences.sha256:
            # Of the pieces of one long video the longest: less turning back and forth.
            own = [i for i, known in enumerate(sequences.sha256) if known == checksum]
            return self._own_background(max(own, key=lambda i: int(sequences.units[i])), path)
        if progress is not None:
            progress("tracking the background", 0, 1)
        db = self.database
        finder = FaceFinder(find_models(self._models))
        reference = from_stored(db.rigid)
        face = track_face(path, db.mask, db.camera, finder, reference=reference)
        if progress is not None:
            progress("tracking the background", 1, 1)
        return Background.from_tracked(path, probe(path).fps, face.numbers, face.poses)

    def _steadiest(self) -> int:
        """The sequence whose head moves least, of those whose footage is still what it was."""
        units, sequences = self.database.units, self.database.sequences
        longest = int(sequences.units.max())
        unrest = []
        for first, count in zip(sequences.first_unit, sequences.units, strict=True):
            mine = slice(first, first + count)
            # Turning counts by what it moves at the mouth, about 100 mm from the neck.
            motion = (
                units.translation[mine].std(axis=0)[:2].sum()
                + 100 * units.rotation[mine].std(axis=0).sum()
            )
            unrest.append(float(motion) * longest / max(1, int(count)))
        for s in np.argsort(unrest, kind="stable"):
            media = Path(sequences.media[s])
            if media.is_file() and sha256_of(media) == sequences.sha256[s]:
                return int(s)
        raise RenderError(
            f"{self.database.path}: no clip that it was built from is still where and what it was "
            f"(the first: {sequences.media[0]}); name a video of the person (--background VIDEO)"
        )

    def _own_background(self, sequence: int, path: Path | None = None) -> Background:
        db = self.database
        first = int(db.sequences.first_unit[sequence])
        units = np.arange(first, first + int(db.sequences.units[sequence]))
        return Background.from_tracked(
            path or db.sequences.media[sequence],
            db.fps,
            db.units.frame[units],
            Poses(db.units.rotation[units], db.units.translation[units]),
            float(db.starts[sequence]),
        )

    def render(
        self,
        selection: Selection,
        *,
        background: Background | None = None,
        fps: float | Fraction | None = None,
        progress: Progress | None = None,
    ) -> Iterator[Planes]:
        """Draw the pictures of a selection.

        Parameters
        ----------
        selection : Selection
        background : Background, optional
            By default the database's steadiest clip.
        fps : float, optional
            Frame rate of the pictures; by default the background's.
        progress : callable, optional

        Yields
        ------
        Planes
            Encoder's input planes of each frame: outside the blend region the background's own
            samples.

        Raises
        ------
        RenderError
            If OpenGL cannot be started or the background cannot be read as it was tracked.
        """
        db = self.database
        back = background or self.background()
        info = probe(back.path)
        camera = db.camera.scaled_to(info.width, info.height)
        rate = float(snap_rate(back.fps if fps is None else fps))
        n = frame_count(selection.duration, rate)
        units = selection.at_rate(rate, n)
        places = playback_indices(len(back), n, back.fps, rate)
        patch = db.mask.patch
        gain: npt.NDArray[np.float64] | None = None
        with Scene(info.width, info.height, patch, camera, self._alpha) as scene:
            for i, frame in enumerate(stream_frames(back, places)):
                pose = back.poses.matrix(int(places[i]))
                unit = int(units[i])
                crop = db.picture(unit)
                fitted = fit_gain(cut_crop(frame.rgb, patch, pose, camera), crop, self._ring)
                same_clip = i > 0 and db.units.sequence[unit] == db.units.sequence[units[i - 1]]
                if gain is None or not same_clip:
                    gain = fitted
                else:
                    gain = GAIN_MEMORY * gain + (1 - GAIN_MEMORY) * fitted
                layer = scene.draw(apply_gain(crop, gain), pose)
                yield composite(frame.planes, layer, info.colour)
                if progress is not None:
                    progress("rendering", i + 1, n)

    def write(
        self,
        selection: Selection,
        path: str | Path,
        *,
        audio: str | Path | Sound | None = None,
        background: Background | str | Path | None = None,
        fps: float | Fraction | None = None,
        crf: int = 18,
        progress: Progress | None = None,
    ) -> Written:
        """Render a selection into an mp4 (H.264, AAC).

        Parameters
        ----------
        selection : Selection
        path : path
            Written beside and renamed when complete.
        audio : path or Sound, optional
            Sound of the video, cut or lengthened by silence to the selection's length.
        background : Background or path, optional
            By default the database's steadiest clip.
        fps : float, optional
            Frame rate; by default the background's.
        crf : int
            Quality of the encoder; 18 is hard to tell from its input.
        progress : callable, optional

        Returns
        -------
        Written

        Raises
        ------
        MediaError
            If sound or video cannot be read or written.
        RenderError
            If a picture cannot be drawn.
        """
        if not isinstance(background, Background):
            background = self.background(background, progress=progress)
        _refuse_own_input(Path(path), background.path, audio)
        info = probe(background.path)
        rate = snap_rate(background.fps if fps is None else fps)
        with VideoWriter(
            path, info.width, info.height, rate, audio, colour=info.colour, crf=crf
        ) as video:
            for planes in self.render(
                selection, background=background, fps=rate, progress=progress
            ):
                video.write_planes(planes)
        return Written(
            Path(path), background.path, video.frames, float(rate), video.frames / float(rate)
        )


def _refuse_own_input(output: Path, background: Path, audio: str | Path | Sound | None) -> None:
    """A video that replaced what it was made from could not be made again."""
    for source in (background, None if isinstance(audio, Sound) else audio):
        if source is None or not (output.exists() and Path(source).exists()):
            continue
        if output.samefile(source):
            raise MediaError(f"{output}: is an input of this video too; name another output")
