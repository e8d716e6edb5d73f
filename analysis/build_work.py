"""The steps of a build, from clips to a database."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path

from analysis.aam_points import Marks
from analysis.assemble import assemble
from analysis.build_settings import BuildSettings
from analysis.clip import sha256_of
from analysis.clip_workers import ClipTask, Shared, analyse_clips
from analysis.corpus import Clip
from analysis.estimate import Estimate, estimate_build, size_text
from analysis.face import FaceFinder
from analysis.identity import circumstances
from analysis.models import FaceModels
from analysis.reference import to_stored
from analysis.shard_store import ShardStore
from analysis.shards import Refusal, Shard, read_shard
from database.errors import CorpusError, UnitselError
from database.lexicon import Lexicon
from database.media import MediaInfo, probe
from database.pictures import AUTO_CODEC, codec_for
from database.schema import DatabaseContent
from database.writer import write_database

Progress = Callable[[str, int, int], None]
"""Called with the name of a stage, how much of it is done, and of how much."""


@dataclass(frozen=True)
class Speech:
    """How words are pronounced: the lexicon, and the user's file that is part of it."""

    lexicon: Lexicon
    dictionary: str | Path | None


class Work:
    """One build at work: `begin`, `analyse`, `write`.

    Parameters
    ----------
    target : Path
        The database.
    store : ShardStore
    settings : BuildSettings
    models : FaceModels
    jobs : int
        Clips analysed at a time.
    tell : callable
        Progress: stage, done, total.
    """

    estimate: Estimate
    """What is expected, known once the build has begun."""

    def __init__(
        self,
        target: Path,
        store: ShardStore,
        settings: BuildSettings,
        models: FaceModels,
        jobs: int,
        tell: Progress,
    ) -> None:
        self.skipped: dict[str, str] = {}
        """Clips left out, and why."""
        self.person: tuple[str, ...] = ()
        """Clips that were looked at for the mask."""
        self.changed: tuple[str, ...] = ()
        """What differs from an earlier build whose clips could not be taken for it."""
        self.reused = 0
        """Clips that an earlier build had analysed."""
        self._target, self._store, self._settings = target, store, settings
        self._models, self._jobs, self._tell = models, jobs, tell
        self._tasks: list[ClipTask] = []
        self._outcomes: dict[ClipTask, Shard | Refusal] = {}

    def begin(self, clips: Sequence[Clip], person: Sequence[str], speech: Speech) -> None:
        """Look at the clips, find the person, see what is there already, and estimate the rest.

        Parameters
        ----------
        clips : sequence of Clip
        person : sequence of str
            Clips to make the mask of; all if empty.
        speech : Speech

        Raises
        ------
        CorpusError
            If no clip can be read.
        FaceError
            If none shows a face.
        DatabaseError
            If there is too little space.
        """
        settings, store = self._settings, self._store
        self._clips = tuple(clips)
        infos = self._probe(clips)
        self._fps = self._frame_rate(clips, infos)
        sums = self._checksums([c for c in clips if c.name not in self.skipped])
        usable = [c for c in clips if c.name not in self.skipped]
        finder = FaceFinder(self._models, settings.face)
        self._tell("finding the person", 0, 1)
        looked_at = _named(usable, person) if person else usable
        if settings.hand is not None:
            # First, so that a person who is kept is found anew when this clip changes.
            marked = _named(usable, [settings.hand.clip])
            looked_at = marked + [c for c in looked_at if c not in marked]
        self._person, self.person = store.person(looked_at, sums, finder, self._models, settings)
        self._tell("finding the person", 1, 1)
        if settings.codec == AUTO_CODEC:
            patch = self._person.mask.patch
            settings = replace(settings, codec=codec_for(patch.crop_width, patch.crop_height))
            self._settings = settings
        store.enter(
            circumstances(self._person, self._fps, self._models, speech.dictionary, settings)
        )
        for clip in usable:
            sha256 = sums[clip.media]
            task = ClipTask(clip, sha256, store.path(clip, sha256))
            self._tasks.append(task)
            found = store.find(clip, task.path)
            if found is not None:
                self._outcomes[task] = found
        self.reused = len(self._outcomes)
        self.changed = () if self.reused else store.changed()
        self.estimate = estimate_build(
            [(t.clip, infos[t.clip.name]) for t in self._left()],
            self.shards(),
            len(usable),
            mask=self._person.mask,
            camera=self._person.camera,
            fps=self._fps,
            finder=finder,
            motion=settings.motion,
            codec=settings.codec,
            jobs=self._jobs,
            target=self._target,
        )

    def analyse(self, speech: Speech) -> None:
        """Analyse the clips that are not kept.

        Raises
        ------
        CorpusError
            If no clip of all can be used.
        DatabaseError
            If a shard cannot be written.
        """
        settings, total = self._settings, len(self._tasks)
        self._tell("analysing clips", len(self._outcomes), total)

        def done(task: ClipTask, outcome: Shard | Refusal) -> None:
            self._outcomes[task] = outcome
            self._tell("analysing clips", len(self._outcomes), total)

        shared = Shared(
            self._person,
            self._fps,
            self._models,
            speech.lexicon,
            settings.codec,
            settings.face,
            settings.motion,
            settings.align,
        )
        analyse_clips(self._left(), shared, self._jobs, done)
        for task in self._tasks:
            outcome = self._outcomes[task]
            if isinstance(outcome, Refusal):
                self.skipped[task.clip.name] = outcome.reason
        if not self.shards():
            first = next(iter(self.skipped.values()))
            raise CorpusError(f"none of the {total} clips could be used; the first: {first}")

    def write(self, marks: Marks | None = None) -> DatabaseContent:
        """Fit what depends on all clips and write the database.

        Parameters
        ----------
        marks : Marks, optional
            Lips marked by hand.

        Raises
        ------
        DatabaseError
            If it cannot be written.
        """
        settings, shards = self._settings, self.shards()
        content, landmarks = assemble(
            shards,
            mask=self._person.mask,
            camera=self._person.camera,
            fps=self._fps,
            texture=settings.texture,
            lag=settings.lag,
            guide=settings.guide,
            offset=settings.offset,
            lips=settings.lips,
            lip_marks=marks,
            codec=settings.codec,
            jobs=self._jobs,
            settings={k: v for k, v in asdict(settings).items() if k != "consent"},
            skipped=self.skipped,
            tell=self._tell,
        )
        report = content.report | {
            "footage": [c.as_json() for c in self._clips],
            "person": list(self.person),
        }
        content = replace(
            content,
            rigid=to_stored(self._person.reference),
            report=report,
            consent=settings.consent,
        )
        write_database(
            self._target,
            content,
            (data for shard in shards for data in read_shard(shard.path).pictures()),
            landmarks,
            settings.codec,
            self._jobs,
            lambda done, total: self._tell("writing", done, total),
        )
        return content

    def shards(self) -> list[Shard]:
        """Shards so far, in the clips' order."""
        found = (self._outcomes.get(task) for task in self._tasks)
        return [outcome for outcome in found if isinstance(outcome, Shard)]

    def interrupted(self) -> str:
        """What a user should know who has interrupted the build."""
        kept = len(self.shards())
        if not kept:
            return "interrupted before a clip was done; nothing was left"
        return (
            f"interrupted; {kept} of {len(self._tasks)} clips are kept in {self._store.folder} "
            f"({size_text(self._store.size())}), and the same command goes on from there"
        )

    def _left(self) -> list[ClipTask]:
        return [t for t in self._tasks if t not in self._outcomes]

    def _probe(self, clips: Sequence[Clip]) -> dict[str, MediaInfo]:
        """What the clips are; those that cannot be read are skipped."""
        infos = {}
        for clip in clips:
            try:
                infos[clip.name] = probe(clip.source)
            except UnitselError as error:
                self.skipped[clip.name] = str(error)
        if not infos:
            raise CorpusError(
                f"no clip of the corpus can be read; the first: {next(iter(self.skipped.values()))}"
            )
        return infos

    def _frame_rate(self, clips: Sequence[Clip], infos: dict[str, MediaInfo]) -> float:
        """The commonest frame rate; slower clips are skipped."""
        fps = Counter(round(i.fps, 3) for i in infos.values()).most_common(1)[0][0]
        for clip in clips:
            info = infos.get(clip.name)
            if info is not None and info.fps < 0.98 * fps:
                self.skipped[clip.name] = (
                    f"{clip.source}: has {info.fps:g} frames a second, less than the corpus's "
                    f"{fps:g}"
                )
        return fps

    def _checksums(self, clips: Sequence[Clip]) -> dict[Path, str]:
        """SHA-256 of the clips' media; those that cannot be read are skipped."""
        sums: dict[Path, str] = {}
        for clip in clips:
            try:
                if clip.media not in sums:
                    sums[clip.media] = sha256_of(clip.media)
            except OSError as error:
                self.skipped[clip.name] = f"{clip.media}: cannot be read ({error.strerror})"
        return sums


def _named(clips: Sequence[Clip], names: Sequence[str]) -> list[Clip]:
    by_name = {c.name: c for c in clips}
    for name in names:
        if name not in by_name:
            raise CorpusError(f"the corpus holds no usable clip {name!r} to make the mask of")
    return [by_name[n] for n in names]
