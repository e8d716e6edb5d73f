"""Shapes in time, against curves computed by hand from section 4 of Image Talk."""

from __future__ import annotations

import numpy as np
import pytest

from database.errors import TrackError
from unitsel.portrait.timing import Span, TimingSettings, shape_weights

REST, ONE, TWO, THREE = np.eye(4)


def paper(method: str = "contract", interpolation: str = "linear", **more: float) -> TimingSettings:
    """The paper's own times: a syllable's, not its sound's."""
    constants = {"lead": 0.0, "prepare": 0.0} | more
    return TimingSettings(method=method, interpolation=interpolation, **constants)


def curves(spans: list[Span], seconds: list[float], settings: TimingSettings) -> np.ndarray:
    """Weights at these times, through the frames that have them at their middles."""
    fps = 1000.0
    frames = shape_weights(spans, fps, 1 + round(fps * max(seconds)), 4, settings)
    at = (np.arange(len(frames)) + 0.5) / fps
    return np.stack([np.interp(seconds, at, c) for c in frames.T], axis=1)


ALONE = [Span(0.0, 1.0, np.stack([ONE, TWO]))]
TWICE = [Span(0.0, 1.0, np.stack([ONE, TWO])), Span(1.0, 2.0, THREE[None])]


def test_b_and_c() -> None:
    found = curves(ALONE, [0.1, 0.2, 0.3, 0.4, 0.6], paper())
    expected = [
        [0.5, 0.5, 0, 0],  # halfway to the first shape
        [0, 1, 0, 0],  # b = 0.2: there before the sound
        [0, 0.75, 0.25, 0],
        [0, 0.5, 0.5, 0],  # the time from b to c is divided evenly
        [0, 0, 1, 0],  # c = 0.6: the last shape
    ]
    np.testing.assert_allclose(found, expected, atol=2e-3)


def test_three_shapes_divide_the_time_from_b_to_c() -> None:
    spans = [Span(2.0, 4.0, np.stack([ONE, TWO, THREE]))]
    found = curves(spans, [2.4, 2.6, 2.8, 3.2], paper())
    np.testing.assert_allclose(found, [ONE, (ONE + TWO) / 2, TWO, THREE], atol=2e-3)


def test_method_a_contracts_to_a_semi_neutral_face() -> None:
    # rB = (t - c) / T: 0.2 at 0.8 s, 0.4 at d; from there the next syllable's first shape.
    found = curves(TWICE, [0.8, 1.0, 1.1, 1.2, 1.6, 2.0, 2.1, 2.6], paper())
    expected = [
        [0.2, 0, 0.8, 0],
        [0.4, 0, 0.6, 0],  # Ftransition
        [0.2, 0, 0.3, 0.5],
        THREE,
        THREE,  # b to c, one shape
        [0.4, 0, 0, 0.6],
        [0.5, 0, 0, 0.5],
        REST,
    ]
    np.testing.assert_allclose(found, expected, atol=2e-3)


def test_method_a_is_neutral_after_its_constant() -> None:
    apart = [Span(0.0, 1.0, ONE[None]), Span(2.0, 3.0, TWO[None])]
    found = curves(apart, [1.1, 1.6, 1.9, 2.0, 2.1, 2.2], paper())
    expected = [(ONE + REST) / 2, REST, REST, REST, (TWO + REST) / 2, TWO]
    np.testing.assert_allclose(found, expected, atol=2e-3)
    quick = curves(apart, [0.85, 1.1], paper(contraction=0.5))
    np.testing.assert_allclose(quick, [(ONE + REST) / 2, REST], atol=2e-3)


def test_method_b_goes_on_to_the_next_syllable() -> None:
    # Straight from c = 0.6 to the next b = 1.2.
    found = curves(TWICE, [0.6, 0.75, 0.9, 1.05, 1.2], paper("onward"))
    expected = [TWO, 0.75 * TWO + 0.25 * THREE, (TWO + THREE) / 2, 0.25 * TWO + 0.75 * THREE, THREE]
    np.testing.assert_allclose(found, expected, atol=2e-3)


def test_method_b_rests_in_a_pause() -> None:
    apart = [Span(0.0, 0.5, ONE[None]), Span(2.0, 2.5, TWO[None])]
    found = curves(apart, [0.1, 0.3, 0.55, 0.8, 1.9, 2.05, 2.1], paper("onward"))
    expected = [ONE, ONE, (ONE + REST) / 2, REST, REST, (TWO + REST) / 2, TWO]
    np.testing.assert_allclose(found, expected, atol=4e-3)


def test_hermite_curves_are_level_at_a_shape() -> None:
    # Between level ends a Hermite curve is 3 u^2 - 2 u^3.
    found = curves(ALONE, [0.05, 0.1, 0.3, 0.85], paper(interpolation="hermite"))
    expected = [
        [0.84375, 0.15625, 0, 0],
        [0.5, 0.5, 0, 0],
        [0, 0.84375, 0.15625, 0],
        [0.15625, 0, 0.84375, 0],
    ]
    np.testing.assert_allclose(found, expected, atol=2e-3)


def test_hermite_curves_pass_through_a_transition() -> None:
    # Shape two: 1 at 0.6, 0.6 at 1.0, 0 at 1.2. Slopes -1 and -3, so by the weighted harmonic mean
    # 1.8 / (0.8 / -1 + 1.0 / -3) = -1.5882 at 1.0; a quarter way on, u = 0.25 of 0.2 s:
    # 0.84375 * 0.6 + 0.140625 * 0.2 * -1.5882 = 0.4616.
    found = curves(TWICE, [1.05], paper(interpolation="hermite"))[0]
    assert found[2] == pytest.approx(0.4616, abs=2e-3)
    assert found[3] == pytest.approx(0.15625, abs=2e-3)
    assert found[0] == pytest.approx(1 - 0.4616 - 0.15625, abs=3e-3)


def test_the_shape_is_there_when_the_sound_begins() -> None:
    # Moved forward by 0.2 of the length: b is the sound's first moment, c at 0.4 of it.
    found = curves([Span(1.0, 2.0, np.stack([ONE, TWO]))], [0.8, 0.9, 1.0, 1.4], paper(lead=0.2))
    np.testing.assert_allclose(found, [REST, (ONE + REST) / 2, ONE, TWO], atol=2e-3)


def test_a_shape_is_not_early_where_the_tongue_begins() -> None:
    spans = [Span(1.0, 2.0, np.stack([ONE, TWO]), leads=False)]
    found = curves(spans, [1.0, 1.1, 1.2, 1.6], paper(lead=0.2))
    np.testing.assert_allclose(found, [REST, (ONE + REST) / 2, ONE, TWO], atol=2e-3)


def test_a_first_shape_is_prepared_for_some_time_and_a_closure_kept() -> None:
    short = [Span(1.0, 1.1, np.stack([ONE, TWO]), held=0.06)]
    found = curves(short, [0.88, 0.94, 1.0, 1.055, 1.076], paper(lead=0.2, prepare=0.12))
    np.testing.assert_allclose(found[:4], [REST, (ONE + REST) / 2, ONE, ONE], atol=5e-3)
    # The second shape after 0.4 of the 40 ms that are left.
    np.testing.assert_allclose(found[4], TWO, atol=3e-2)


@pytest.mark.parametrize("method", ["contract", "onward"])
@pytest.mark.parametrize("interpolation", ["linear", "hermite"])
def test_weights_are_weights(method: str, interpolation: str) -> None:
    random = np.random.default_rng(0)
    spans, t = [], 0.3
    for _ in range(200):
        length = random.uniform(0.02, 0.3)
        shapes = random.dirichlet(np.ones(4), random.integers(1, 4))
        spans.append(Span(t, t + length, shapes, random.choice([0.0, 0.03])))
        t += length + random.choice([0.0, 0.0, 0.05, 0.4])
    settings = TimingSettings(method=method, interpolation=interpolation)
    found = shape_weights(spans, 25.0, 1500, 4, settings)
    assert found.min() >= 0
    np.testing.assert_allclose(found.sum(axis=1), 1, atol=1e-12)
    assert found[0, 0] == 1 and found[-1, 0] == 1, "at rest before and after"


def test_no_speech_is_rest_and_overlap_is_an_error() -> None:
    np.testing.assert_array_equal(shape_weights([], 25.0, 3, 4, TimingSettings()), [REST] * 3)
    for spans in ([Span(0, 0, ONE[None])], [TWICE[0], Span(0.5, 1.5, ONE[None])]):
        with pytest.raises(TrackError, match="no length or overlaps"):
            shape_weights(spans, 25.0, 3, 4, TimingSettings())


@pytest.mark.parametrize(
    "wrong", [{"begin": 0.7}, {"lead": -1}, {"method": "c"}, {"interpolation": "x"}, {"pause": -1}]
)
def test_constants_out_of_range_are_refused(wrong: dict[str, object]) -> None:
    with pytest.raises(ValueError):
        TimingSettings(**wrong)
