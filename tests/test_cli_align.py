"""``unitsel align``: the puppet's speech against its words, into every format."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest

from database.media import probe
from database.phonemes import PHONEMES
from database.timing import read_timing

Run = Callable[..., tuple[int, str, str]]


@pytest.fixture
def spoken(puppet: ModuleType, puppet_corpus: Path) -> tuple[Path, list[str]]:
    """Give a clip with speech, and its words."""
    if not puppet.can_speak():
        pytest.skip("needs speech: install the extra, unitsel[espeak]")
    name, sentence = next(iter(puppet.SPOKEN.items()))
    return puppet_corpus / f"{name}.mp4", sentence.split()


def test_align_writes_phones_and_words(
    spoken: tuple[Path, list[str]], run: Run, tmp_path: Path, puppet: ModuleType
) -> None:
    clip, words = spoken
    output = tmp_path / "said.TextGrid"
    status, out, err = run("align", clip, clip.with_suffix(".txt"), "-o", output, "--json")
    assert (status, err) == (0, "")
    assert out.count("\n") == 1
    document = json.loads(out)
    assert set(document) == {"timing", "words", "phones", "attempts", "notes"}
    assert document["timing"] == str(output)
    assert [w["word"] for w in document["words"]] == words
    assert {p["phone"] for p in document["phones"]} <= set(PHONEMES)
    assert document["attempts"] >= 1

    timing = read_timing(output)
    assert timing.phones is not None and timing.words is not None
    assert list(timing.words.words) == words
    assert [p["phone"] for p in document["phones"]] == list(timing.phones.labels)
    assert timing.phones.end == pytest.approx(probe(clip).duration, abs=0.05)
    # espeak says when it said what: the words' middles must be near that.
    _, truth = puppet.speak(" ".join(words))
    start, end = truth.speech_span()
    found = timing.phones.speech_span()
    assert np.allclose(found, (start, end), atol=0.12)


@pytest.mark.parametrize("name", ["said.lab", "said.csv", "said.json", "said.pho", "said.align"])
def test_the_extension_chooses_the_format(
    name: str, spoken: tuple[Path, list[str]], run: Run, tmp_path: Path
) -> None:
    clip, words = spoken
    output = tmp_path / name
    status, out, err = run("align", clip, clip.with_suffix(".txt"), "-o", output)
    assert (status, err) == (0, "")
    assert out.startswith(f"{output}: {len(words)} words, ")
    timing = read_timing(output)
    if name == "said.align":
        assert timing.words is not None and list(timing.words.words) == words
    else:
        assert timing.phones is not None and timing.phones.labels.count("sil") >= 2
    assert [p.name for p in tmp_path.iterdir()] == [name]


def test_word_times_bound_the_search(
    spoken: tuple[Path, list[str]], run: Run, tmp_path: Path
) -> None:
    clip, words = spoken
    free, bounded = tmp_path / "free.align", tmp_path / "bounded.TextGrid"
    assert run("align", clip, clip.with_suffix(".txt"), "-o", free)[0] == 0
    assert run("align", clip, free, "-o", bounded)[0] == 0
    first, second = read_timing(free).words, read_timing(bounded).words
    assert first is not None and second is not None
    assert second.words == tuple(words)
    assert np.allclose(first.starts, second.starts, atol=0.1)


def test_a_word_that_no_dictionary_knows_is_pronounced_or_asked_for(
    spoken: tuple[Path, list[str]], run: Run, tmp_path: Path
) -> None:
    clip, words = spoken
    script = tmp_path / "said.txt"
    script.write_text(" ".join(["plaice", "blooh", *words[2:]]))
    extra = tmp_path / "extra.dict"
    extra.write_text("plaice P L EY S\nblooh B L UW\n")
    output = tmp_path / "said.TextGrid"
    status, _, err = run("align", clip, script, "-o", output, "--dictionary", extra)
    assert status == 0, err
    words_found = read_timing(output).words
    assert words_found is not None and words_found.words[:2] == ("plaice", "blooh")
