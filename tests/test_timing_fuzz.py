"""Any bytes, and any edit of a valid file, are a timing or one documented error, soon.

More examples: UNITSEL_FUZZ_EXAMPLES=20000 pytest tests/test_timing_fuzz.py. Atheris runs the same
property: tests/fuzz/atheris_timing.py.
"""

import importlib
import json
import os
import re
import sys
import time
import tracemalloc
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from database.timing.json_text import MAX_VALUES
from database.timing.source import MAX_LINES
from database.timing.tiers import MAX_SPANS

HERE = Path(__file__).parent
sys.path.insert(0, str(HERE / "fuzz"))
harness = importlib.import_module("atheris_timing")
fuzz = importlib.import_module("timing_property")
sys.path.remove(str(HERE / "fuzz"))

EXAMPLES = int(os.environ.get("UNITSEL_FUZZ_EXAMPLES", "120"))
some = settings(
    max_examples=EXAMPLES,
    deadline=None,
    suppress_health_check=[HealthCheck.too_slow, HealthCheck.data_too_large],
)

ENCODINGS = ("utf-8", "utf-8-sig", "utf-16", "utf-16-le", "utf-16-be")
SEEDS = {
    f.name: (f.suffix.lower(), f.read_bytes()) for f in sorted((HERE / "data/timing").iterdir())
}


def _text(data: bytes) -> str:
    if b"\0" not in data:
        return data.decode("utf-8-sig")
    marked = data[:2] in (b"\xff\xfe", b"\xfe\xff")
    return data.decode("utf-16" if marked else "utf-16-be" if data[0] == 0 else "utf-16-le")


TEXTS = {name: (extension, _text(data)) for name, (extension, data) in SEEDS.items()}
TOKENS = st.sampled_from(
    [
        *("nan", "1e999", "-1", "0", "-0.0", "1e-9", "9" * 30, "9" * 5000, "0.1", "1e5", "١"),
        *('"', '""', "\n", "\n\n", "\r", "\t", " ", ",", ";", ";;", "#", "!", "=", "<", ">", "{"),
        *("}", "[", "]", "(", ")", "(2)", "_B", "-->", "'", "\\", "&lt;", "&#0;", "\\ud800"),
        *("\\u0000", "\\u001c", "\u0329", "\u2028", "\x85", "\x00", "\x1c", "\ufeff", "ɪ", "日本"),
        *("sil", "oov", "oov_S", "<unk>", "<eps>", "X", "Q", "AH0", "phones", "words", "a b c"),
        *("<exists>", "<absent>", "TextTier", "<ALT>", "<ALT_BEGIN>", "* *", "WEBVTT", "NOTE"),
        *("00:00:01,000 --> 00:00:02,000\n", "<00:00:01.000>", "99:99:99,999", "start,end,label"),
        *("null", "true", "{}", "[]", "not-found-in-audio", "not-found-in-transcript", "points"),
    ]
)


@st.composite
def edited_files(draw: st.DrawFn) -> tuple[str, bytes]:
    """A valid file with a few edits, seldom under another format's name."""
    extension, text = TEXTS[draw(st.sampled_from(sorted(TEXTS)))]
    for _ in range(draw(st.integers(1, 4))):
        kind = draw(st.sampled_from(("number", "word", "insert", "cut", "lines", "splice")))
        if kind in ("number", "word"):
            found = list(re.finditer(r"[-\d.]+" if kind == "number" else r"[\w.<>-]+", text))
            if found:
                match = draw(st.sampled_from(found))
                text = text[: match.start()] + draw(TOKENS) + text[match.end() :]
        elif kind == "lines":
            lines = text.splitlines(keepends=True)
            if lines:
                i, j = (draw(st.integers(0, len(lines) - 1)) for _ in range(2))
                lines[i : i + draw(st.integers(0, 2))] = lines[j : j + draw(st.integers(0, 3))]
                text = "".join(lines)
        else:
            i = draw(st.integers(0, len(text)))
            if kind == "insert":
                text = text[:i] + draw(TOKENS | st.text(max_size=5)) + text[i:]
            elif kind == "cut":
                text = text[:i] + text[i + draw(st.integers(1, 40)) :]
            else:
                other = TEXTS[draw(st.sampled_from(sorted(TEXTS)))][1]
                text = text[:i] + other[draw(st.integers(0, len(other))) :]
    if draw(st.integers(0, 9)) == 0:
        extension = draw(st.sampled_from(fuzz.EXTENSIONS))
    return extension, text.encode(draw(st.sampled_from(ENCODINGS)), "replace")


VALUES: st.SearchStrategy[Any] = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=6) | TOKENS
    | st.sampled_from([0, 0.1, 0.2, 1, "aa", "B"]),
    lambda inner: st.lists(inner, max_size=3)
    | st.dictionaries(st.sampled_from(["w", "words", "tiers", "start", "b", "phones"]), inner),
    max_leaves=6,
)  # fmt: skip
TREES = [json.loads(t) for e, t in TEXTS.values() if e == ".json" and t.count("\n{") == 0]


def _places(value: Any) -> list[tuple[Any, Any]]:
    """Every member of a JSON value, as a container and a key."""
    keys = (
        list(value)
        if isinstance(value, dict)
        else list(range(len(value)))
        if isinstance(value, list)
        else []
    )
    return [(value, k) for k in keys] + [p for k in keys for p in _places(value[k])]


@st.composite
def edited_json(draw: st.DrawFn) -> bytes:
    """A valid JSON file in which members are replaced, removed or doubled."""
    tree = json.loads(json.dumps(draw(st.sampled_from(TREES))))
    for _ in range(draw(st.integers(1, 3))):
        places = _places(tree)
        if not places:
            break
        inside, key = draw(st.sampled_from(places))
        kind = draw(st.sampled_from(("replace", "remove", "double")))
        if kind == "replace":
            inside[key] = draw(VALUES)
        elif kind == "remove":
            del inside[key]
        elif isinstance(inside, list):
            inside.insert(key, inside[key])
    return json.dumps(tree).encode()


@some
@given(st.sampled_from(fuzz.EXTENSIONS), st.binary(max_size=200) | st.text().map(str.encode))
def test_any_bytes(extension: str, data: bytes) -> None:
    fuzz.check_file(extension, data)


@some
@given(edited_files())
def test_any_edit_of_a_valid_file(file: tuple[str, bytes]) -> None:
    fuzz.check_file(*file)


@some
@given(edited_json())
def test_any_edit_of_valid_json(data: bytes) -> None:
    fuzz.check_file(".json", data)


def test_the_property_tells_valid_from_damaged() -> None:
    for extension, data in SEEDS.values():
        assert fuzz.check_file(extension, data) == ""
    assert "empty" in fuzz.check_file(".ctm", b"")


def test_the_harness_runs_the_same_property_on_its_seeds(tmp_path: Path) -> None:
    assert harness.check_tagged is fuzz.check_tagged
    written = harness.write_seeds(tmp_path / "corpus")
    assert {f.name for f in written} == set(SEEDS)
    for file in written:
        harness.check_tagged(file.read_bytes())
        extension, data = SEEDS[file.name]
        assert file.read_bytes()[1:] == data
        assert fuzz.EXTENSIONS[file.read_bytes()[0]] == extension
    harness.check_tagged(b"")


def test_the_harness_says_what_it_lacks(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    assert "name a folder" in harness.main(["atheris_timing.py", "-runs=1"])
    monkeypatch.setitem(sys.modules, "atheris", None)
    assert "pip install atheris" in harness.main(["atheris_timing.py", str(tmp_path / "corpus")])


GRID = 'File type = "ooTextFile"\nObject class = "TextGrid"\n0\n9\n<exists>\n'
N = 8000
# What grows without a bound, or by the square of its size, in a careless reader.
HOSTILE: dict[str, tuple[str, Callable[[], str]]] = {
    "quotes": (".textgrid", lambda: GRID + '"' * 3 * N),
    "numbers": (".textgrid", lambda: GRID + "1 " * 3 * N),
    "a tier of no end": (".textgrid", lambda: GRID + '1 "IntervalTier" "phones" 0 9 499999\n'
                         + '0 1 "s"\n' * N),
    "many tiers": (".textgrid", lambda: GRID + f"{N // 4}\n"
                   + '"IntervalTier" "a" 0 9 1 0 1 "s"\n' * (N // 4)),
    "a long name": (".textgrid", lambda: GRID + f'1 "IntervalTier" "{"phones " * N}" 0 9 x'),
    "a long label": (".csv", lambda: "0,1," + "ab" * 3 * N),
    "distinct labels": (".lab", lambda: "\n".join(f"{i} {i + 1} A{i:x}b" for i in range(N))),
    "arpabet of two cases": (".csv", lambda: "\n".join(
        f"{i},{i + 1},{('ah', 'AH')[i % 2]}{' ' * (i % 30)}" for i in range(N))),
    "commas": (".csv", lambda: "," * 3 * N),
    "long numbers": (".csv", lambda: "9" * 3 * N + ",1,a"),
    "empty arrays": (".json", lambda: '{"tiers": [' + "[]," * N + "[]]}"),
    "many values": (".json", lambda: "{}" * (MAX_VALUES + 2)),
    "deep": (".json", lambda: '{"words": [' + '{"word": [' * N),
    "deep and closed": (".json", lambda: '{"tiers": ' + "[" * 900 + "]" * 900 + "}"),
    "full stops": (".txt", lambda: "." * 3 * N),
    "apostrophes": (".txt", lambda: "'" * 3 * N),
    "accents": (".txt", lambda: "a" + "\u0301\u0323" * N),
    "words in a cue": (".srt", lambda: "1\n00:01 --> 00:02\n" + "a " * 2 * N),
    "tags": (".vtt", lambda: "WEBVTT\n\n00:01 --> 00:02\n" + "<a" * N + "[(" * N + "{\\" * N),
    "many recordings": (".ctm", lambda: "\n".join(f"a{i} 1 0 1 b" for i in range(N))),
    "shapes": (".tsv", lambda: "\n".join(f"{i} {'AB'[i % 2]}" for i in range(N))),
}  # fmt: skip


@pytest.mark.parametrize("name", HOSTILE)
def test_hostile_files_take_bounded_time_and_memory(name: str) -> None:
    extension, build = HOSTILE[name]
    data = build().encode()
    tracemalloc.start()
    began = time.process_time()
    try:
        fuzz.check_file(extension, data, writing=False)
        used = time.process_time() - began
        peak = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    assert used < fuzz.CPU_SECONDS
    assert peak < 250 * len(data)


def test_files_with_too_much_in_them_are_refused() -> None:
    assert f"more than {MAX_LINES} lines" in fuzz.check_file(".lab", b"\n" * (MAX_LINES + 1) + b"a")
    assert f"from 0 to {MAX_SPANS}, got 500001" in fuzz.check_file(
        ".textgrid", (GRID + '1 "IntervalTier" "phones" 0 9 500001').encode()
    )
    assert "got 2001 different labels; are they words?" in fuzz.check_file(
        ".pho", "\n".join(f"a{i} 10" for i in range(2001)).encode()
    )
    assert f"at most {MAX_VALUES} JSON values" in fuzz.check_file(".json", b"1 " * (MAX_VALUES + 1))
