"""Manifests: clips in a table, each mistake with its line and column."""

import pytest

from analysis.align import Aligner
from analysis.build import build_database
from analysis.corpus import align_clip
from analysis.footage import clips_of
from analysis.manifest import read_manifest
from database.errors import CorpusError, MediaError, TimingError
from database.media import probe
from database.reader import open_database
from database.sound import read_sound
from database.timing import read_timing


@pytest.fixture
def folder(tmp_path):
    for name in ("a.mp4", "b.mov", "times.TextGrid", "b.txt", "sub/a.mp4"):
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).write_text("x")
    return tmp_path


def manifest(folder, text):
    path = folder / "clips.csv"
    path.write_text(text, encoding="utf-8")
    return path


def test_rows_become_clips(folder):
    path = manifest(
        folder,
        "media,words,timing,start,end\n"
        'a.mp4,"Bin blue, now.",,1.5,4\n'
        "a.mp4,,times.TextGrid,4,7.25\n"
        "\n"
        "b.mov,,,,\n",
    )
    first, second, third = read_manifest(path)
    assert first.name == "a@00001.50-00004.00"
    assert first.words == ("Bin", "blue", "now")
    assert (first.start, first.end, first.scripts) == (1.5, 4.0, ())
    assert second.scripts == (folder / "times.TextGrid",)
    assert (third.name, third.start, third.end) == ("b", 0.0, None)
    assert third.scripts == (folder / "b.txt",)
    assert third.source.whole and not first.source.whole


def test_columns_in_any_order_and_of_two_files_with_one_name(folder):
    path = manifest(folder, "END, Words ,media\n2,one,a.mp4\n2,two,sub/a.mp4\n")
    assert [c.name for c in read_manifest(path)] == [
        "a.mp4@00000.00-00002.00",
        "sub/a.mp4@00000.00-00002.00",
    ]


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "is empty"),
        ("media,words\n", "lists no clip"),
        ("a.mp4,hello\n", "line 1, column 'a.mp4': is none of the header's columns, which are"),
        ("words,start\nx,1\n", "line 1: the header has no column 'media'"),
        ("media,start,start\na.mp4,1,1\n", "line 1, column 'start': is named twice"),
        ("media;words\na.mp4;x\n", "column 'media;words': is none .* .separated by commas"),
        ("media,words\na.mp4,one,two\n", "line 2: has 3 cells, the header has 2"),
        ("media,words\n,one\n", "line 2, column 'media': expected a media file, got nothing"),
        ("media,words\n\nc.mp4,one\n", r"line 3, column 'media': there is no file .*c\.mp4"),
        ("media,words\nb.txt,one\n", r"line 2, column 'media': expected a media file \(\.avi"),
        ("media,timing\na.mp4,x.TextGrid\n", "line 2, column 'timing': there is no file"),
        ("media,timing\na.mp4,b.txt\n", "line 2, column 'timing': expected a timing file"),
        ("media,words,start\na.mp4,x,soon\n", "column 'start': expected seconds, .* got 'soon'"),
        ("media,words,start\na.mp4,x,-1\n", "column 'start': expected seconds, 0 or more"),
        ("media,words,end\na.mp4,x,nan\n", "column 'end': expected seconds"),
        ("media,words,start,end\na.mp4,x,2,2\n", "column 'end': 2 s is not after the start at 2"),
        ("media,words\na.mp4,...\n", "column 'words': expected words, got '...'"),
        ("media,start\na.mp4,1\n", "line 2, column 'words': gives none, nor a timing"),
        ("media,words\na.mp4,x\na.mp4,y\n", "line 3, column 'media': names a again, as line 2"),
        ('media,words\na.mp4,"x\n', "line 2: unexpected end of data"),
    ],
)
def test_mistakes_are_named(folder, text, message):
    path = manifest(folder, text)
    with pytest.raises(CorpusError, match=message) as caught:
        read_manifest(path)
    assert str(caught.value).startswith(f"{path}: ")
    assert "\n" not in str(caught.value)


def test_other_footage_is_refused_with_a_remedy(folder):
    with pytest.raises(CorpusError, match="is not a folder"):
        clips_of(folder / "b.txt")
    with pytest.raises(CorpusError, match="is not a folder"):
        clips_of(folder / "nowhere.csv")
    with pytest.raises(CorpusError, match="is not one video, so a timing file"):
        clips_of(folder, timing=folder / "times.TextGrid")
    with pytest.raises(MediaError, match=r"a\.mp4: cannot be read as video"):
        clips_of(folder / "a.mp4", timing=folder / "times.TextGrid")


def test_limit_and_exclude(folder):
    lines = "".join(f"a.mp4,w,{i},{i + 1}\n" for i in range(9))
    path = manifest(folder, "media,words,start,end\n" + lines)
    clips = clips_of(path, limit=3)
    assert [c.start for c in clips] == [0, 4, 8]
    left = clips_of(path, exclude=[c.name for c in clips])
    assert len(left) == 6
    with pytest.raises(CorpusError, match="holds no clip 'x' to exclude"):
        clips_of(path, exclude=["x"])


def test_one_video_and_its_times(puppet_corpus, tmp_path):
    timed = next(p for p in sorted(puppet_corpus.glob("*.TextGrid")))
    video = timed.with_suffix(".mp4")
    assert [c.name for c in clips_of(video)] == [video.stem]
    alone = tmp_path / "alone.mp4"
    alone.symlink_to(video)
    with pytest.raises(CorpusError, match=r"has no timing file to cut it by; put alone\.TextGrid"):
        clips_of(alone)
    with pytest.raises(TimingError, match=r"none\.TextGrid: cannot be read"):
        clips_of(alone, timing=tmp_path / "none.TextGrid")
    long = tmp_path / "long.csv"
    long.write_text(f"0,{probe(video).duration + 5:.1f},aa\n")
    with pytest.raises(CorpusError, match=r"long\.csv: lasts .* is it another recording's\?"):
        clips_of(alone, timing=long)


def test_a_database_of_a_manifest(puppet_corpus, puppet_report, face_models, tmp_path, run):
    """A whole clip and a piece of the same one: the piece's units are those of the clip."""
    with open_database(puppet_report.path) as db:
        whole = next(
            i
            for i, n in enumerate(db.sequences.name)
            if (puppet_corpus / f"{n}.TextGrid").is_file()
        )
        name = db.sequences.name[whole]
        words = read_timing(puppet_corpus / f"{name}.TextGrid").words
        cut = (words.ends[0] + words.starts[1]) / 2
        path = tmp_path / "clips.csv"
        path.write_text(
            "media,timing,start,end\n"
            f"{puppet_corpus / name}.mp4,{puppet_corpus / name}.TextGrid,{cut},\n"
            f"{puppet_corpus / name}.mp4,{puppet_corpus / name}.TextGrid,,{cut}\n"
            f"{puppet_corpus / name}.mp4,,{words.starts[1] + 0.1},\n"
        )
        status, out, err = run("build", path, "-o", tmp_path / "a.h5", "--jobs", 1)
        assert status == 0, err
        assert "lies inside the" in out, "the third row cuts a word, and is skipped"
        with open_database(tmp_path / "a.h5") as other:
            assert len(other.sequences) == 2
            start = float(other.starts[0])
            assert abs(start - cut) <= 0.5 / db.fps + 1e-9
            assert other.starts[1] == 0
            assert other.sequences.words[0].split() == list(words.words[1:])
            frames = other.units.frame[other.units.sequence == 0]
            assert frames[0] == 0
            assert len(other) == pytest.approx(
                len(db.units.frame[db.units.sequence == whole]), abs=2
            )


def test_words_in_the_table_are_aligned(corpus):
    media = sorted(corpus.glob("*.mpg"))[0]
    words = (media.with_suffix(".txt")).read_text().split()
    clip = next(iter(clips_of(corpus, limit=1)))
    assert clip.media == media
    row = type(clip)(clip.name, media, (), 0.0, None, tuple(words))
    info = probe(media)
    found = align_clip(row, read_sound(media), info.duration, Aligner())
    assert found.text.split() == words


def test_build_options_that_are_none(run, folder):
    for option, value, message in (
        ("--face", "front", "chooses no face"),
        ("--sound-offset", "late", "expected auto, or milliseconds"),
        ("--sound-offset", "9999", "expected auto, or milliseconds"),
    ):
        status, out, err = run("build", folder, "-o", folder / "a.h5", option, value)
        assert status == 2 and out == ""
        assert message in err and err.count("\n") == 1


def test_a_manifest_must_give_a_usable_clip(folder, face_models):
    path = manifest(folder, "media,words\na.mp4,x\n")
    with pytest.raises(CorpusError, match="no clip of the corpus can be read"):
        build_database(path, folder / "a.h5", jobs=1)
