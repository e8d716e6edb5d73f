"""Sound aligned to words: synthetic speech whose times are known, and the shared corpus."""

import numpy as np
import pytest

from analysis.align import Aligner, AlignSettings, Attempt
from database.errors import AlignmentError, PronunciationError, UnitselError
from database.lexicon import Lexicon
from database.phonemes import CLOSURES, SILENCE, VISEME_OF
from database.sound import Sound, read_sound
from database.timing import WordTrack, read_timing, read_words
from database.track import frame_times

RATE = 16000

SENTENCES = [
    "place blue by four now",
    "set white with nine again",
    "the big brown map fell from my bed",
    "people make better bread in summer",
    "move the lamp away from my bookshelf please",
]


@pytest.fixture(scope="module")
def aligner():
    return Aligner()


@pytest.fixture(scope="module")
def speak(puppet):
    """Say a sentence: its sound and espeak's own times."""
    if not puppet.can_speak():
        pytest.skip("needs speech: the optional extra `espeak`")
    return puppet.speak


def closures(track):
    """Middles of the phones that close the lips."""
    middles = (track.boundaries[:-1] + track.boundaries[1:]) / 2
    return middles[np.isin(track.phonemes, list(CLOSURES))]


@pytest.mark.parametrize("sentence", SENTENCES)
def test_synthetic_speech_is_aligned_to_its_words(speak, aligner, sentence):
    sound, truth = speak(sentence)
    found = aligner.align(sound, sentence.split())
    assert found.attempts == 1 and found.notes == ()
    assert found.words.words == tuple(sentence.split())
    assert found.track.start == 0
    assert found.track.end == pytest.approx(sound.duration, abs=1e-6)
    np.testing.assert_allclose(found.track.speech_span(), truth.speech_span(), atol=0.06)
    # At half of a video's frames' distance, nearly every viseme agrees with espeak's own times.
    times = frame_times(int(truth.end * 50), 50)
    same = VISEME_OF[found.track.at(times)] == VISEME_OF[truth.at(times)]
    assert same.mean() > 0.75
    assert len(closures(found.track)) == len(closures(truth))
    np.testing.assert_allclose(closures(found.track), closures(truth), atol=0.05)


def test_phones_and_words_agree(speak, aligner):
    sentence = SENTENCES[2]
    sound, _ = speak(sentence)
    found = aligner.align(sound, sentence.split())
    starts = set(found.track.boundaries.round(4))
    assert {round(t, 4) for t in (*found.words.starts, *found.words.ends)} <= starts
    spoken = (found.track.phonemes != SILENCE).sum()
    lexicon = Lexicon.default()
    lengths = [{len(v) for v in lexicon.pronunciations(w)} for w in sentence.split()]
    assert sum(map(min, lengths)) <= spoken <= sum(map(max, lengths))


def test_the_order_of_clips_does_not_matter(speak, aligner):
    sounds = [speak(s)[0] for s in SENTENCES]
    for sound, sentence in zip(sounds, SENTENCES, strict=True):
        used = aligner.align(sound, sentence.split()).track
        fresh = Aligner().align(sound, sentence.split()).track
        np.testing.assert_array_equal(used.boundaries, fresh.boundaries)
        np.testing.assert_array_equal(used.phonemes, fresh.phonemes)


@pytest.mark.parametrize(
    "words",
    [
        "set red with x seven soon",
        "the quick brown fox jumps over the lazy dog",
        "internationalization notwithstanding",
    ],
)
def test_wrong_words(speak, aligner, words):
    sound, _ = speak(SENTENCES[0])
    with pytest.raises(AlignmentError, match=r"clip9: .*5 attempts; are they what is spoken"):
        aligner.align(sound, words.split(), name="clip9")


def test_a_variant_is_chosen_by_the_sound(speak, aligner):
    """The dictionary has both ways to say "read"."""
    words = ["must", "read", "it", "now"]
    for spoken, heard, other in (("reed", "iy", "eh"), ("red", "eh", "iy")):
        sound, _ = speak(f"must {spoken} it now")
        labels = aligner.align(sound, words).track.labels
        assert heard in labels and other not in labels, spoken


def test_the_users_pronunciation_is_used(speak):
    sound, _ = speak("place blue by four now")
    mine = Lexicon.default().with_entries({"zzz": [("b", "l", "uw")]})
    found = Aligner(mine).align(sound, ["place", "zzz", "by", "four", "now"])
    assert found.words.words[1] == "zzz"
    # Also where the recogniser's own dictionary says otherwise.
    mine = Lexicon.default().with_entries({"red": [("b", "l", "uw")]})
    labels = Aligner(mine).align(sound, ["place", "red", "by", "four", "now"]).track.labels
    assert "r" not in labels[:8] and labels[labels.index("uw") - 1] == "l"


def test_punctuation_and_case_do_not_matter(speak, aligner):
    sound, _ = speak(SENTENCES[0])
    plain = aligner.align(sound, SENTENCES[0].split())
    marked = aligner.align(sound, ["Place", "BLUE,", "by", "“four”", "now!"])
    np.testing.assert_array_equal(marked.track.boundaries, plain.track.boundaries)


def no_speech():
    rng = np.random.default_rng(0)
    tone = 0.3 * np.sin(2 * np.pi * 440 * np.arange(2 * RATE) / RATE)
    return {
        "digital silence": np.zeros(2 * RATE),
        "noise": rng.normal(0, 0.1, 2 * RATE),
        "tone": tone,
        "not finite": np.full(2 * RATE, np.nan),
    }


@pytest.mark.parametrize("kind", no_speech())
def test_what_is_no_speech_is_one_clear_error(aligner, kind):
    sound = Sound(no_speech()[kind].astype(np.float32), RATE)
    with pytest.raises(AlignmentError, match="clip3: ") as caught:
        aligner.align(sound, SENTENCES[0].split(), name="clip3")
    assert "\n" not in str(caught.value)


def test_silence_around_speech_is_no_hindrance(speak, aligner):
    """Digital silence breaks the recogniser's front end: faint noise is added."""
    sound, truth = speak(SENTENCES[0])
    quiet = np.pad(sound.samples * (np.abs(sound.samples) > 1e-3), RATE)
    found = aligner.align(Sound(quiet, RATE), SENTENCES[0].split())
    np.testing.assert_allclose(
        found.track.speech_span(), np.array(truth.speech_span()) + 1.0, atol=0.08
    )


@pytest.mark.parametrize(
    ("samples", "rate", "words", "message"),
    [
        (1000, RATE, ["blue"], "shorter than 0.1 s"),
        (0, RATE, ["blue"], "shorter than 0.1 s"),
        (RATE, 44100, ["blue"], "16000 Hz, not 44100"),
        (RATE, RATE, [], "no words"),
        (RATE // 4, RATE, SENTENCES[4].split(), "could not be aligned"),
    ],
)
def test_sounds_that_cannot_be_aligned(aligner, samples, rate, words, message):
    noise = np.random.default_rng(0).normal(0, 0.01, samples).astype(np.float32)
    with pytest.raises(AlignmentError, match=f"clip1: .*{message}"):
        aligner.align(Sound(noise, rate), words, name="clip1")


def test_a_word_that_nobody_can_pronounce(aligner):
    sound = Sound(np.zeros(RATE, np.float32), RATE)
    for align in (
        lambda words: aligner.align(sound, words, name="clip1"),
        lambda words: aligner.align_bounded(
            sound, WordTrack(tuple(words), (0.1, 0.5), (0.5, 0.9)), name="clip1"
        ),
    ):
        with pytest.raises(PronunciationError, match="clip1: no pronunciation for 日本"):
            align(["blue", "日本"])


def test_bounded_words_stay_in_their_bounds(speak, aligner):
    sound, _ = speak(SENTENCES[0])
    free = aligner.align(sound, SENTENCES[0].split()).words
    found = aligner.align_bounded(sound, free)
    assert found.words.words == free.words
    np.testing.assert_allclose(found.words.starts, free.starts, atol=0.021)
    np.testing.assert_allclose(found.words.ends, free.ends, atol=0.021)


def test_bounds_that_contradict_the_sound_win(speak, aligner):
    """Whoever gives word times means them: each word is searched where it is said to be."""
    sound, _ = speak(SENTENCES[0])
    free = aligner.align(sound, SENTENCES[0].split()).words
    shift = 0.15
    moved = WordTrack(
        free.words,
        tuple(t - shift for t in free.starts),
        tuple(t - shift for t in free.ends),
        free.duration,
    )
    found = aligner.align_bounded(sound, moved)
    assert found.words.words == free.words
    slack = AlignSettings().tolerance + 0.011
    assert (np.array(found.words.starts) > np.array(moved.starts) - slack).all()
    assert (np.array(found.words.ends) < np.array(moved.ends) + slack).all()


def test_bounds_help_where_nothing_is_heard(aligner):
    """Without speech the dictionary's phones share each word's time."""
    rng = np.random.default_rng(0)
    sound = Sound(rng.normal(0, 0.05, 2 * RATE).astype(np.float32), RATE)
    words = WordTrack(("place", "blue"), (0.5, 1.0), (0.9, 1.4), 2.0)
    found = aligner.align_bounded(sound, words)
    assert found.words.words == ("place", "blue")
    np.testing.assert_allclose(found.words.starts, words.starts, atol=0.02)
    np.testing.assert_allclose(found.words.ends, words.ends, atol=0.02)
    assert tuple(p for p in found.track.labels if p != "sil") == (
        *("p", "l", "ey", "s"),
        *("b", "l", "uw"),
    )
    assert "one by one" in found.notes[0]


def test_a_bounded_word_beyond_the_sound_is_left_out(speak, aligner):
    sound, _ = speak("place blue")
    words = WordTrack(("place", "blue", "now"), (0.3, 0.6, 8.0), (0.6, 0.9, 8.5))
    found = aligner.align_bounded(sound, words)
    assert found.words.words == ("place", "blue")
    assert found.track.end == pytest.approx(sound.duration)
    with pytest.raises(AlignmentError, match="no word lies inside"):
        aligner.align_bounded(sound, WordTrack(("now",), (8.0,), (8.5,)))


def test_labels_that_look_like_silence_are_words_if_given(speak, aligner):
    """A word track may hold what the recogniser would call a filler."""
    sound, _ = speak("place sill now")
    words = WordTrack(("place", "<sill>", "now"), (0.3, 0.65, 1.0), (0.65, 1.0, 1.4))
    assert aligner.align_bounded(sound, words).words.words == ("place", "<sill>", "now")


def test_later_attempts_are_reported(speak):
    sound, _ = speak(SENTENCES[0])
    hopeless = Attempt(0.9, 0.9, 0.3, 3.0)
    usual = AlignSettings().attempts[0]
    found = Aligner(settings=AlignSettings(attempts=(hopeless, usual))).align(
        sound, SENTENCES[0].split()
    )
    assert found.attempts == 2
    assert found.notes == ("aligned at attempt 2",)


def test_clips_of_the_corpus(corpus, aligner):
    """Real speech: words come near to where the corpus's own word times put them."""
    apart = []
    for media in sorted(corpus.glob("*.mpg"))[::15]:
        timed = read_timing(media.with_suffix(".align")).words
        found = aligner.align(read_sound(media), read_words(media.with_suffix(".txt")))
        assert found.words.words == timed.words, media.stem
        apart += np.abs(np.subtract(found.words.starts, timed.starts)).tolist()
    assert np.median(apart) < 0.03
    assert np.percentile(apart, 95) < 0.2


def test_all_clips_of_the_corpus(corpus, heldout, aligner):
    media = sorted([*corpus.glob("*.mpg"), *heldout.glob("*.mpg")])
    failed = {}
    for path in media:
        try:
            aligner.align(read_sound(path), read_words(path.with_suffix(".txt")))
        except UnitselError as error:
            failed[path.stem] = str(error)
    assert len(failed) <= 0.01 * len(media), failed
