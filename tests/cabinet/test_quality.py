"""Connection quality from replies."""

import pytest

from dovetail.cabinet.protocol import Quality
from dovetail.cabinet.quality import LinkQuality, QualityRule
from dovetail.errors import ConfigError


def test_ready_takes_80_good_replies():
    quality = LinkQuality(QualityRule())
    for _ in range(79):
        quality.add(True)
    assert quality.value is Quality.FAIR
    quality.add(True)
    assert quality.value is Quality.GOOD


@pytest.mark.parametrize(
    ("hits", "value"),
    [
        (0, Quality.POOR),
        (29, Quality.POOR),
        (30, Quality.FAIR),
        (79, Quality.FAIR),
        (80, Quality.GOOD),
        (96, Quality.GOOD),
        (97, Quality.EXCELLENT),
        (100, Quality.EXCELLENT),
    ],
)
def test_thresholds(hits, value):
    quality = LinkQuality(QualityRule(misses_max=100))
    for i in range(100):
        quality.add(i < hits)
    assert quality.ratio == pytest.approx(hits / 100)
    assert quality.value is value


def test_eleven_misses_in_a_row_are_poor():
    quality = LinkQuality(QualityRule())
    for _ in range(200):
        quality.add(True)
    for _ in range(10):
        quality.add(False)
    assert quality.value is Quality.GOOD
    quality.add(False)
    assert quality.value is Quality.POOR
    quality.add(True)
    assert quality.value is Quality.GOOD


def test_old_replies_leave_the_window():
    quality = LinkQuality(QualityRule(window=10, misses_max=10))
    for is_hit in [False] * 10 + [True] * 10:
        quality.add(is_hit)
    assert quality.ratio == 1.0


def test_reset_forgets_and_a_fault_forces():
    quality = LinkQuality(QualityRule())
    for _ in range(100):
        quality.add(True)
    quality.forced = Quality.FAIR
    assert quality.value is Quality.FAIR
    quality.forced = None
    assert quality.value is Quality.EXCELLENT
    quality.reset()
    assert quality.value is Quality.POOR


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"window": 0}, "window is 0"),
        ({"misses_max": -1}, "misses_max is -1"),
        ({"good_from": 0.1}, "must rise within 0 to 1"),
        ({"excellent_from": 1.5}, "must rise within 0 to 1"),
    ],
)
def test_contradicting_thresholds_are_refused(change, message):
    with pytest.raises(ConfigError, match=message):
        QualityRule(**change)
