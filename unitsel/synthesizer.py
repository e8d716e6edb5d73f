"""From phonemes to a video: select units, stitch them onto a background, write the file."""

from __future__ import annotations

from collections.abc import Callable, Collection, Generator, Iterable, Iterator, Sequence
from dataclasses import replace
from fractions import Fraction
from pathlib import Path
from typing import cast

from database.fingerprint import identity
from database.media import snap_rate
from database.planes import Planes
from database.reader import UnitDatabase
from database.sound import Sound
from database.track import PhonemeTrack
from render.background import Background
from render.blend import BlendShape
from unitsel.backgrounds import find_background
from unitsel.costs import Weights
from unitsel.placed import Placed
from unitsel.provenance import Provenance
from unitsel.select import Selection, select_units
from unitsel.settings import SelectionSettings, default_settings
from unitsel.source import SelectionInput
from unitsel.stream_writing import write_stream
from unitsel.streaming import UTTERANCES_AHEAD, Spoken, StreamedFrame, stream
from unitsel.unit_pictures import UnitPictures
from unitsel.writing import Encoding, Frame, Written, refuse_inputs, write_video

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
        after: Selection | None = None,
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
        after : Selection, optional
            What is shown right before, so that the first mouth follows from its last.
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
            after=None if after is None else int(after.units[-1]),
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

    def provenance(self, comment: str | None = None) -> Provenance:
        """What a video made by this synthesizer says of itself."""
        return Provenance(self.database.path.name, identity(self.database), comment)

    def render(
        self,
        selection: Selection,
        *,
        background: Background | None = None,
        eyes: Background | None = None,
        fps: float | Fraction | None = None,
        size: tuple[int, int] | None = None,
        progress: Progress | None = None,
    ) -> Iterator[Planes]:
        """Draw the pictures of a selection.

        Parameters
        ----------
        selection : Selection
        background : Background, optional
            By default the database's best one.
        eyes : Background, optional
            Clip of the person whose eyes (blinks, gaze) are laid on the background.
        fps : float, optional
            Frame rate of the pictures; by default the background's.
        size : (width, height), optional
            Of the pictures; by default the background's.
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
        pictures = self._pictures.draw(
            selection, chosen, fps=fps, size=size, eyes=eyes, progress=progress
        )
        return cast(Iterator[Planes], pictures)

    def stream(
        self,
        tracks: Iterable[Spoken],
        *,
        background: Background | None = None,
        eyes: Background | None = None,
        fps: float | Fraction | None = None,
        size: tuple[int, int] | None = None,
        alpha: bool = False,
        look_ahead: int = UTTERANCES_AHEAD,
        exclude_sequences: Collection[int | str] = (),
    ) -> Generator[StreamedFrame[Selection], None, None]:
        """Draw utterances while later ones are still arriving.

        The next utterance is selected, from the last mouth of this one on, while this one is
        drawn. The background goes on from one to the next; memory does not grow with the length.

        Parameters
        ----------
        tracks : iterable of PhonemeTrack, or of (PhonemeTrack, Sound)
            One an utterance; the next may be waited for. Iterated in a thread of its own.
        background : Background, optional
            By default the database's best one.
        eyes : Background, optional
            As in `render`.
        fps : float, optional
            Frame rate; by default the background's.
        size : (width, height), optional
            Of the pictures; by default the background's.
        alpha : bool
            Draw the mouth alone, as RGB and alpha.
        look_ahead : int
            Utterances that are selected before they are drawn, at most.
        exclude_sequences : collection of int or str
            Sequences, by index or name, whose units may not be used.

        Yields
        ------
        StreamedFrame
            A picture, with its time in the utterances' sounds, one after another.

        Raises
        ------
        SelectionError, RenderError, MediaError
            As `select` and `render`, after the frames that came before.
        """
        chosen = background or self.background()
        rate = snap_rate(chosen.fps if fps is None else fps)

        def select(track: PhonemeTrack, sound: Sound | None, before: Selection | None) -> Selection:
            heard = sound if self.settings.target.guide == "sound" else None
            return self.select(
                track, sound=heard, exclude_sequences=exclude_sequences, after=before
            )

        def draw(utterances: Iterator[Placed[Selection]]) -> Iterator[Frame]:
            return self._pictures.draw_placed(
                utterances, chosen, rate, size=size, alpha=alpha, eyes=eyes
            )

        return stream(tracks, select, draw, rate, look_ahead=look_ahead)

    def write(
        self,
        selection: Selection,
        path: str | Path,
        *,
        audio: str | Path | Sound | None = None,
        background: Background | str | Path | Sequence[str | Path] | None = None,
        eyes: Background | str | Path | None = None,
        fps: float | Fraction | None = None,
        encoding: Encoding | None = None,
        progress: Progress | None = None,
    ) -> Written:
        """Render a selection into a file.

        Parameters
        ----------
        selection : Selection
        path : path
            Written beside and renamed when complete. The suffix says the container: .mp4, .webm,
            .mov, .mkv; a name without one is a folder of numbered PNG pictures.
        audio : path or Sound, optional
            Sound of the video. A file's is taken over as it is where the container allows, and
            ends with the selection; else it is encoded, cut or lengthened to that length.
        background : Background, path or sequence of paths, optional
            As in `background`. By default the database's best one.
        eyes : Background or path, optional
            Clip of the person whose eyes (blinks, gaze) are laid on the background.
        fps : float, optional
            Frame rate; by default the background's.
        encoding : Encoding, optional
            Codec, quality, size, transparency, comment.
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
        encoding = Encoding() if encoding is None else encoding
        encoding.check(Path(path))
        background, eyes = self._laid_on(Path(path), background, eyes, progress)
        rate = snap_rate(background.fps if fps is None else fps)
        pictures = self._pictures.draw(
            selection,
            background,
            fps=rate,
            size=encoding.size,
            alpha=encoding.alpha,
            eyes=eyes,
            progress=progress,
        )
        written = write_video(
            pictures,
            path,
            background=background.path,
            rate=rate,
            audio=audio,
            encoding=encoding,
            provenance=self.provenance(encoding.comment),
        )
        return replace(written, notes=self._pictures.notes)

    def write_stream(
        self,
        tracks: Iterable[Spoken],
        path: str | Path,
        *,
        audio: str | Path | None = None,
        background: Background | str | Path | Sequence[str | Path] | None = None,
        eyes: Background | str | Path | None = None,
        fps: float | Fraction | None = None,
        encoding: Encoding | None = None,
        exclude_sequences: Collection[int | str] = (),
        begun: Callable[[Placed[Selection]], None] | None = None,
        progress: Progress | None = None,
        seconds: float | None = None,
    ) -> Written:
        """Write utterances into a file while later ones are still arriving; see `stream`.

        Parameters
        ----------
        tracks : iterable of PhonemeTrack, or of (PhonemeTrack, Sound)
        path : path
            As in `write`.
        audio : path, optional
            Sound of the whole; by default the utterances' own, each cut or lengthened by silence
            to its track.
        background, eyes, fps, encoding, exclude_sequences
            As in `write` and `stream`.
        begun : callable, optional
            Called with each utterance, placed, before its first picture.
        progress : callable, optional
        seconds : float, optional
            Length of the whole, for the progress.

        Returns
        -------
        Written

        Raises
        ------
        SelectionError, RenderError, MediaError
            As `select`, `render` and `write`; no file is left then.
        """
        encoding = Encoding() if encoding is None else encoding
        encoding.check(Path(path))
        background, eyes = self._laid_on(Path(path), background, eyes, progress)
        rate = snap_rate(background.fps if fps is None else fps)
        frames = self.stream(
            tracks,
            background=background,
            fps=rate,
            size=encoding.size,
            alpha=encoding.alpha,
            eyes=eyes,
            exclude_sequences=exclude_sequences,
        )
        written = write_stream(
            frames,
            path,
            background=background.path,
            rate=rate,
            audio=audio,
            encoding=encoding,
            provenance=self.provenance(encoding.comment),
            begun=begun,
            progress=progress,
            seconds=seconds,
        )
        return replace(written, notes=self._pictures.notes)

    def _laid_on(
        self,
        path: Path,
        background: Background | str | Path | Sequence[str | Path] | None,
        eyes: Background | str | Path | None,
        progress: Progress | None,
    ) -> tuple[Background, Background | None]:
        """What a video is laid on, opened; none of it may be the output."""
        if not isinstance(background, Background):
            background = find_background(
                self.database, background, models=self._models, progress=progress
            )
        if eyes is not None and not isinstance(eyes, Background):
            eyes = self.background(eyes, progress=progress)
        laid = (*background.more, *(() if eyes is None else eyes.parts))
        refuse_inputs(path, [part.path for part in laid])
        return background, eyes
