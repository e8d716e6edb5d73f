"""From phonemes to a video: select units, stitch them onto a background, write the file."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator, Sequence
from dataclasses import replace
from fractions import Fraction
from pathlib import Path

from database.media import snap_rate
from database.planes import Planes
from database.reader import UnitDatabase
from database.sound import Sound
from database.track import PhonemeTrack
from render.background import Background
from render.blend import BlendShape
from unitsel.backgrounds import find_background
from unitsel.costs import Weights
from unitsel.select import Selection, select_units
from unitsel.settings import SelectionSettings, default_settings
from unitsel.source import SelectionInput
from unitsel.unit_pictures import UnitPictures
from unitsel.writing import Written, write_video

Progress = Callable[[str, int, int], None]


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
        self._pictures = UnitPictures(database, blend)

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
        self, *videos: str | Path | None, progress: Progress | None = None
    ) -> Background:
        """Videos or a photo of the person, with the head's pose in each frame.

        Parameters
        ----------
        *videos : path
            Videos of the same person, joined in this order, or one photo; a clip of the database
            or a background that was added to it is known already, and may be given by its name,
            any other is tracked now. By default, and for None, the database's best background
            (`unitsel backgrounds`).
        progress : callable, optional

        Raises
        ------
        RenderError
            If there is no video to use, or those given cannot be joined.
        MediaError, FaceError
            If a video cannot be read, or shows no face.
        """
        named = [video for video in videos if video is not None]
        return find_background(self.database, named or None, models=self._models, progress=progress)

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
            By default the database's best one.
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
        chosen = background or self.background()
        return self._pictures.draw(selection, chosen, fps=fps, progress=progress)

    def write(
        self,
        selection: Selection,
        path: str | Path,
        *,
        audio: str | Path | Sound | None = None,
        background: Background | str | Path | Sequence[str | Path] | None = None,
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
        background : Background, path or sequence of paths, optional
            As in `background`.
            By default the database's best one.
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
            background = find_background(
                self.database, background, models=self._models, progress=progress
            )
        rate = snap_rate(background.fps if fps is None else fps)
        pictures = self.render(selection, background=background, fps=rate, progress=progress)
        return write_video(
            pictures, path, background=background.path, rate=rate, audio=audio, crf=crf
        )
