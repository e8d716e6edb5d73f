"""Whatever a timing file holds, it is read or it is one TimingError of one line."""

import random
from pathlib import Path

import numpy as np
import pytest

from database.errors import TimingError
from database.timing import (
    parse_timing,
    read_timing,
    read_words,
    timing_extensions,
    write_timing,
)
from database.track import PhonemeTrack

DATA = Path(__file__).parent / "data" / "timing"
FIXTURES = sorted(f for f in DATA.iterdir() if f.suffix != ".txt")

TRACK = PhonemeTrack(np.array([1, 2]), np.array([0, 0.5, 1.0]))

GRID = 'File type = "ooTextFile"\nObject class = "TextGrid"\n\nxmin = 0\nxmax = 1\n'
TIER = (
    'tiers? <exists>\nsize = 1\nitem []:\nitem [1]:\nclass = "IntervalTier"\nname = "phones"\n'
    "xmin = 0\nxmax = 1\nintervals: size = 1\nintervals [1]:\n"
)


def attempt(file: Path, data: bytes | None = None) -> str:
    """Read a file, or its bytes; the error's message, checked for its form, or nothing."""
    try:
        timing = read_timing(file) if data is None else parse_timing(file, data)
    except TimingError as error:
        message = str(error)
        assert message.startswith(f"{file}: ")
        assert "\n" not in message
        assert len(message) < len(str(file)) + 500
        return message
    assert timing.phones is not None or timing.words is not None
    return ""


def bad(tmp_path: Path, name: str, content: str | bytes) -> str:
    file = tmp_path / name
    file.write_bytes(content if isinstance(content, bytes) else content.encode())
    message = attempt(file)
    assert message, "was read"
    return message.removeprefix(f"{file}: ")


@pytest.mark.parametrize("fixture", FIXTURES, ids=lambda f: f.name)
def test_cut_off_at_any_byte(fixture: Path, tmp_path: Path) -> None:
    data = fixture.read_bytes()
    file = tmp_path / f"cut{fixture.suffix}"
    failed = 0
    for n in range(len(data)):
        failed += bool(attempt(file, data[:n]))
    assert failed > 0


@pytest.mark.parametrize("fixture", FIXTURES, ids=lambda f: f.name)
def test_any_bytes_changed(fixture: Path, tmp_path: Path) -> None:
    data = fixture.read_bytes()
    file = tmp_path / f"changed{fixture.suffix}"
    rng = random.Random(fixture.name)
    for _ in range(150):
        changed = bytearray(data)
        for _ in range(rng.choice((1, 1, 3, 20))):
            # Mostly text, so that the change is not simply no UTF-8.
            changed[rng.randrange(len(changed))] = rng.choice((rng.randrange(256), *b'0-9."\n, {e'))
        attempt(file, bytes(changed))


@pytest.mark.parametrize("fixture", FIXTURES, ids=lambda f: f.name)
def test_any_line_left_out_or_doubled(fixture: Path, tmp_path: Path) -> None:
    lines = fixture.read_bytes().splitlines(keepends=True)
    file = tmp_path / f"lines{fixture.suffix}"
    for i in range(len(lines)):
        for some in (lines[:i] + lines[i + 1 :], lines[: i + 1] + lines[i:]):
            attempt(file, b"".join(some))


@pytest.mark.parametrize("extension", timing_extensions())
@pytest.mark.parametrize("fixture", FIXTURES, ids=lambda f: f.name)
def test_one_format_under_anothers_name(fixture: Path, extension: str, tmp_path: Path) -> None:
    file = tmp_path / f"other{extension}"
    attempt(file, fixture.read_bytes())


@pytest.mark.parametrize("extension", timing_extensions())
def test_empty_binary_and_odd_files(extension: str, tmp_path: Path) -> None:
    name = f"a{extension}"
    assert bad(tmp_path, name, b"") == "the file is empty"
    assert bad(tmp_path, name, b" \n\t\n") == "the file is empty"
    assert "expected text" in bad(tmp_path, name, bytes(range(256)))
    assert "control character" in bad(tmp_path, name, b"\x00" * 100)
    assert "line 2: expected text in UTF-8, got byte 0xe9" in bad(tmp_path, name, b"a\nb\xe9\n")
    bad(tmp_path, name, "[" * 100_000)
    bad(tmp_path, name, '{"w":' * 50_000)
    bad(tmp_path, name, "9" * 5000 + " " + "9" * 5000 + " a")
    bad(tmp_path, name, '"')
    bad(tmp_path, name, ";")


@pytest.mark.parametrize("extension", timing_extensions())
def test_no_file_and_a_folder(extension: str, tmp_path: Path) -> None:
    assert "cannot be read: No such file" in attempt(tmp_path / f"none{extension}")
    folder = tmp_path / f"folder{extension}"
    folder.mkdir()
    assert "cannot be read: Is a directory" in attempt(folder)
    with pytest.raises(TimingError, match="cannot be read"):
        read_timing(str(tmp_path / f"a\0{extension}"))
    with pytest.raises(TimingError, match="cannot be read"):
        read_words(tmp_path)


@pytest.mark.parametrize("name", ["a.eaf", "a", ".TextGrid", "a.TextGrid.bak"])
def test_an_extension_that_no_format_has(name: str, tmp_path: Path) -> None:
    file = tmp_path / name
    with pytest.raises(TimingError, match=r"one of the extensions \.textgrid, \.lab") as caught:
        read_timing(file)
    assert str(file) in str(caught.value)
    with pytest.raises(TimingError, match="one of the extensions"):
        write_timing(file, TRACK)
    assert not list(tmp_path.iterdir())


def test_an_alphabet_that_is_none(tmp_path: Path) -> None:
    with pytest.raises(TimingError, match=r"alphabet 'runes'; choose one of auto, table"):
        read_timing(tmp_path / "a.lab", "runes")


@pytest.mark.parametrize(
    ("name", "content", "said"),
    [
        ("a.lab", "0 100000 s\n100000 ih\n", "line 2: expected 'start end label'"),
        ("a.lab", "0 100000 s\n0.1 0.2 ih\n", "line 2: expected the start as a whole number"),
        ("a.lab", "0 100000 s\n100000 90000 t\n", "line 2: expected an end after the start"),
        ("a.lab", "0 100000 s\n50000 150000 t\n", "line 2: expected a start at or after 0.01 s"),
        ("a.lab", "-9 100000 s\n", "line 1: expected times from 0 on"),
        ("a.lab", "0 100000 s\n100000 200000 ih\n200000 300000 qqq\n",
         "line 3: unknown phoneme 'qqq' in alphabet 'table'; nearest known:"),
        ("a.lab", "0 100000 S\n100000 200000 IH\n200000 300000 t\n300000 400000 AH0\n",
         "line 3: expected ARPAbet phonemes in one case, got 't'"),
        ("a.lab", "0 99999999999999999 s\n", "line 1: expected times below 1e+06 s"),
        ("a.align", "0 15500 sil\n15500 x bin\n", "line 2: expected the end as a whole number"),
        ("a.align", "0 15500 sil\n", "holds no word"),
        ("a.pho", "_ 50\ns\n", "line 2: expected 'phone milliseconds', got 's'"),
        ("a.pho", "_ 50\ns fifty\n", "line 2: expected the length in milliseconds as a number"),
        ("a.pho", "_ 50\ns -3\n", "line 2: expected a length of 0 or more"),
        ("a.pho", "_ 50\ns nan\n", "line 2: expected the length in milliseconds as a number"),
        ("a.pho", "_ 50\ns 1e999\n", "line 2: expected the length in milliseconds as a finite"),
        ("a.pho", "_ 50\nqq% 40\n@ 40\n", "line 2: unknown phoneme 'qq%' in alphabet 'sampa'"),
        ("a.pho", "; nothing\n", "holds no phone"),
        ("a.csv", "start,end,label\n0,1\n1,2,s\n2,x,t\n", "line 4: expected the end in seconds"),
        ("a.csv", "start,end,label\n0,1,s\n1\n", "line 3: expected 3 columns or more"),
        ("a.csv", "start,end,label\n", "line 1: expected rows"),
        ("a.csv", "from,to,what\n0,1,s\n", "line 1: expected the header 'start,end,label'"),
        ("a.csv", 'start,end,label\n0,1,"s\n', "line 2: expected comma-separated values"),
        ("a.csv", "Begin,End,Label,Type,Speaker\n0,1,s,phones,x\n0,1\n",
         "line 3: expected 5 columns"),
        ("a.csv", "Begin,End,Label,Type,Speaker\n0,1,s,phones,x\n0,1,s,phones,y\n",
         "expected one speaker, got several tiers of one kind: 'x - phones', 'y - phones'"),
        ("a.csv", "Begin,End,Label,Type,Speaker\n", "expected a tier named 'phones' or 'words'"),
        ("a.json", '{\n"tiers": {\n', "line 3: expected JSON"),
        ("a.json", "[]", "top level: expected an object with 'tiers', got []"),
        ("a.json", '{"tiers": []}', "top level: expected 'tiers' to be an object"),
        ("a.json", '{"tiers": {"phones": {"entries": [[0, 1, "s"], [1, 2]]}}}',
         "tier 'phones', entry 2: expected [begin, end, label]"),
        ("a.json", '{"tiers": {"phones": {"entries": [[0, NaN, "s"]]}}}',
         "tier 'phones', entry 1: expected the end in seconds as a finite number"),
        ("a.json", '{"tiers": {"phones": {"entries": [[0, true, "s"]]}}}',
         "tier 'phones', entry 1: expected the end in seconds as a number, got True"),
        ("a.json", '{"tiers": {"phones": {"entries": [[0, 1, "qqq"], [1, 2, "s"]]}}}',
         "tier 'phones', entry 1: unknown phoneme 'qqq'"),
        ("a.json", '{"w": []}', "holds no word; the speech was not recognised"),
        ("a.json", '{"w": [{"t": "a", "b": 0}]}', "top level, word 1: expected a member 'd'"),
        ("a.json", '{"w": [{"t": "a", "b": 0, "d": 1, "w": [{"b": 0}]}]}',
         "top level, word 1, phone 1: expected a member 't'"),
        ("a.TextGrid", "Hello world\n", "line 2: expected File type = \"ooTextFile\", got the end"),
        ("a.TextGrid", '"ooTextFile"\n"PitchTier"', 'line 2: expected "TextGrid", got'),
        ("a.TextGrid", GRID + "tiers? <absent>\n", "expected a tier named 'phones' or 'words'"),
        ("a.TextGrid", GRID + TIER + 'xmin = 0\nxmax = 1\ntext = "aa',
         "line 18: expected a closing quote"),
        ("a.TextGrid", GRID + TIER + 'xmin = 0\nxmax = one\ntext = "aa"\n',
         "line 17: expected a number or a quoted text after =, got 'one'"),
        ("a.TextGrid", GRID + TIER + 'xmin = 0\nxmax = 1.2.3\ntext = "aa"\n',
         "line 17: expected the end of an interval as a number, got '1.2.3'"),
        ("a.TextGrid", GRID + TIER + 'xmin = 0\ntext = "aa"\n',
         "line 17: expected the end of an interval, got 'aa'"),
        ("a.TextGrid", GRID + TIER + 'xmin = 1\nxmax = 0\ntext = "aa"\n',
         "line 16: expected an end after the start, got 'aa' from 1 to 0 s"),
        ("a.TextGrid", GRID + TIER + 'xmin = 0\nxmax = 1\ntext = "aa"\n7\n',
         "line 19: expected the end of the file after the last tier, got '7'"),
        ("a.TextGrid", GRID + TIER + 'xmin = 0\nxmax = 1\ntext = "qqq"\n',
         "line 16: unknown phoneme 'qqq'"),
        ("a.TextGrid", GRID + TIER.replace("phones", "sentence")
         + 'xmin = 0\nxmax = 1\ntext = "bin blue"\n',
         "line 16: expected one phone or one word a span, got 'bin blue'"),
    ],
)  # fmt: skip
def test_the_message_names_the_place_and_what_was_expected(
    tmp_path: Path, name: str, content: str, said: str
) -> None:
    assert bad(tmp_path, name, content).startswith(said)


def test_a_huge_file_is_refused_unread(tmp_path: Path) -> None:
    file = tmp_path / "a.lab"
    with file.open("wb") as stream:
        stream.truncate(17 * 2**20)
    assert "larger than 16 MiB" in attempt(file)


def test_an_unknown_symbol_keeps_its_cause(tmp_path: Path) -> None:
    file = tmp_path / "a.pho"
    file.write_text("%% 10\ns 10\n")
    with pytest.raises(TimingError) as caught:
        read_timing(file)
    assert type(caught.value.__cause__).__name__ == "PhonemeError"


def test_nothing_half_written(tmp_path: Path) -> None:
    file = tmp_path / "a.lab"
    file.write_text("old\n")
    tiny = PhonemeTrack(np.array([1]), np.array([0, 1e-9]))
    with pytest.raises(TimingError, match=r"a\.lab: 'ae' from 0 to 1e-09 s is too short"):
        write_timing(file, tiny)
    with pytest.raises(TimingError, match="cannot be written as 'grid'; this extension takes htk"):
        write_timing(file, TRACK, "grid")
    assert file.read_text() == "old\n"
    with pytest.raises(TimingError, match="cannot be written: No such file"):
        write_timing(tmp_path / "none" / "a.lab", TRACK)
    folder = tmp_path / "b.lab"
    folder.mkdir()
    with pytest.raises(TimingError, match="cannot be written"):
        write_timing(folder, TRACK)
    assert sorted(f.name for f in tmp_path.iterdir()) == ["a.lab", "b.lab"]


def test_a_new_file_has_the_usual_permissions(tmp_path: Path) -> None:
    write_timing(tmp_path / "a.lab", TRACK)
    (tmp_path / "plain").write_text("")
    assert (tmp_path / "a.lab").stat().st_mode == (tmp_path / "plain").stat().st_mode
