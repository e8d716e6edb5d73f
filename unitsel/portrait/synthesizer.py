"""From phonemes to a video of a portrait: the same steps as for a database of units."""

from __future__ import annotations

from collections.abc import Callable, Generator, Iterable, Iterator, Sequence
from contextlib import closing
from fractions import Fraction
from pathlib import Path

from database.errors import MediaError, RenderError
from database.media import snap_rate
from database.pinyin import TimedSyllable
from database.planes import Planes
from database.portrait_file import PortraitHead
from database.reader import UnitDatabase
from database.sound import Sound
from database.track import PhonemeTrack, frame_count
from unitsel.placed import Placed
from unitsel.portrait.driver import DriveSettings
from unitsel.portrait.performance import Performance
from unitsel.portrait.pictures import PortraitPictures
from unitsel.provenance import Provenance
from unitsel.stream_writing import write_stream
from unitsel.streaming import UTTERANCES_AHEAD, Spoken, StreamedFrame, stream
from unitsel.writing import Encoding, Frame, Written, write_video

Progress = Callable[[str, int, int], None]


class PortraitSynthesizer:
    """Makes a portrait say something; used as `unitsel.synthesizer.Synthesizer` is.

    Parameters
    ----------
    head : PortraitHead
    settings : DriveSettings, optional
        How the face is driven.
    like : UnitDatabase, optional
        Of a person whose lips move these: units are selected for what is said, and the photo's
        lips go as theirs did.
    """

    def __init__(
        self,
        head: PortraitHead,
        settings: DriveSettings | None = None,
        *,
        like: UnitDatabase | None = None,
    ) -> None:
        self.head = head
        self.settings = settings or DriveSettings()
        self._like = like
        self._pictures = PortraitPictures(head)

    def select(
        self,
        track: PhonemeTrack,
        *,
        syllables: Sequence[TimedSyllable] = (),
        sound: Sound | None = None,
        after: Performance | None = None,
        progress: Progress | None = None,
    ) -> Performance:
        """Say how a track is shown.

        Parameters
        ----------
        track : PhonemeTrack
        syllables : sequence of TimedSyllable
            Mandarin's, as `unitsel.speak` tells them.
        sound, after, progress
            As for databases; a portrait does without.

        Returns
        -------
        Performance
        """
        return Performance(track, self.settings, tuple(syllables), self._like)

    def provenance(self, comment: str | None = None) -> Provenance:
        """What a video made by this synthesizer says of itself."""
        return Provenance(self.head.path.name, self.head.identity, comment)

    def render(
        self,
        selection: Performance,
        *,
        background: None = None,
        fps: float | Fraction | None = None,
        size: tuple[int, int] | None = None,
        progress: Progress | None = None,
    ) -> Iterator[Planes]:
        """Draw the pictures of a performance.

        Parameters
        ----------
        selection : Performance
        background : None
            A portrait has its own.
        fps : float, optional
            Frame rate; by default the head's.
        size : (width, height), optional
            Of the pictures; by default the photo's.
        progress : callable, optional

        Yields
        ------
        Planes
            Encoder's input planes of each frame.

        Raises
        ------
        RenderError
            If OpenGL cannot be started, or the size has another shape than the photo.
        """
        _refuse_background(background)
        rate = snap_rate(self.head.fps if fps is None else fps)
        n = frame_count(selection.duration, float(rate))
        pictures = self._pictures.draw(iter([Placed(selection, 0, 0.0, 0, n)]), rate, size=size)
        with closing(pictures):
            for i, planes in enumerate(pictures):
                yield planes
                if progress is not None:
                    progress("rendering", i + 1, n)

    def stream(
        self,
        tracks: Iterable[Spoken],
        *,
        background: None = None,
        fps: float | Fraction | None = None,
        size: tuple[int, int] | None = None,
        alpha: bool = False,
        look_ahead: int = UTTERANCES_AHEAD,
        syllables: Sequence[TimedSyllable] = (),
    ) -> Generator[StreamedFrame[Performance], None, None]:
        """Draw utterances while later ones are still arriving; see `Synthesizer.stream`.

        `syllables` are Mandarin's, of all utterances together, in the time of the first.

        Yields
        ------
        StreamedFrame

        Raises
        ------
        RenderError
            As `render`, after the frames that came before.
        """
        _refuse_background(background)
        _refuse_alpha(alpha)
        rate = snap_rate(self.head.fps if fps is None else fps)
        start, said = 0.0, 0

        def select(
            track: PhonemeTrack, sound: Sound | None, before: Performance | None
        ) -> Performance:
            nonlocal start, said
            first, end = said, start + track.end
            while said < len(syllables) and syllables[said].start < end - 1e-9:
                said += 1
            mine = [s.later(-start) for s in syllables[first:said]]
            start = end
            return self.select(track, syllables=mine, sound=sound, after=before)

        def draw(utterances: Iterator[Placed[Performance]]) -> Iterator[Frame]:
            return self._pictures.draw(utterances, rate, size=size)

        return stream(tracks, select, draw, rate, look_ahead=look_ahead)

    def write(
        self,
        selection: Performance,
        path: str | Path,
        *,
        audio: str | Path | Sound | None = None,
        background: str | Path | None = None,
        fps: float | Fraction | None = None,
        encoding: Encoding | None = None,
        progress: Progress | None = None,
    ) -> Written:
        """Render a performance into a file; see `Synthesizer.write`.

        Parameters
        ----------
        selection : Performance
        path : path
        audio : path or Sound, optional
        background : None
            A portrait has its own.
        fps : float, optional
        encoding : Encoding, optional
        progress : callable, optional

        Raises
        ------
        MediaError
            If sound or video cannot be read or written.
        RenderError
            If a picture cannot be drawn.
        """
        _refuse_background(background)
        encoding = self._checked(encoding, Path(path))
        rate = snap_rate(self.head.fps if fps is None else fps)
        pictures = self.render(selection, fps=rate, size=encoding.size, progress=progress)
        return write_video(
            pictures,
            path,
            background=self.head.path,
            form=self._pictures.format(encoding.size),
            rate=rate,
            audio=audio,
            encoding=encoding,
            provenance=self.provenance(encoding.comment),
        )

    def write_stream(
        self,
        tracks: Iterable[Spoken],
        path: str | Path,
        *,
        audio: str | Path | None = None,
        background: str | Path | None = None,
        fps: float | Fraction | None = None,
        encoding: Encoding | None = None,
        begun: Callable[[Placed[Performance]], None] | None = None,
        progress: Progress | None = None,
        seconds: float | None = None,
        syllables: Sequence[TimedSyllable] = (),
    ) -> Written:
        """Write utterances while later ones are still arriving; see `Synthesizer.write_stream`.

        `syllables` as for `stream`.

        Raises
        ------
        RenderError, MediaError
            As `render` and `write`; no file is left then.
        """
        _refuse_background(background)
        encoding = self._checked(encoding, Path(path))
        rate = snap_rate(self.head.fps if fps is None else fps)
        return write_stream(
            self.stream(tracks, fps=rate, size=encoding.size, syllables=syllables),
            path,
            background=self.head.path,
            form=self._pictures.format(encoding.size),
            rate=rate,
            audio=audio,
            encoding=encoding,
            provenance=self.provenance(encoding.comment),
            begun=begun,
            progress=progress,
            seconds=seconds,
        )

    def _checked(self, encoding: Encoding | None, path: Path) -> Encoding:
        chosen = Encoding() if encoding is None else encoding
        _refuse_alpha(chosen.alpha)
        chosen.check(path)
        return chosen


def _refuse_background(background: object) -> None:
    if background is not None:
        raise RenderError(
            f"{background}: a portrait moves in its own photo and takes no background; leave it "
            "out (--background is for heads built from footage)"
        )


def _refuse_alpha(alpha: bool) -> None:
    if alpha:
        raise MediaError(
            "a portrait is drawn as a whole, so there is no mouth alone; leave transparency out "
            "(--alpha is for heads built from footage)"
        )
