"""Instants without astropy: the numbers are astropy's, to the last bit, and what is no plain date is left to it."""

from __future__ import annotations

import subprocess
import sys
import warnings

import erfa
import numpy as np
import pytest
from astropy.time import Time
from astropy.utils.iers import LeapSeconds

import warpsim as ws
from warpsim.instant import instant, instant_of, plain_instant, tdb_jd, tt_jd, utc_time


def random_dates(count: int) -> list[str]:
    """Days, minutes and seconds all over the years that warpsim takes, ends of days and leap days among them."""
    rng = np.random.default_rng(5)
    days = np.datetime64("1960-01-01") + rng.integers(0, 140 * 365, count)
    second = rng.choice([0, 1, 43199, 43200, 86399, *rng.integers(0, 86400, 20)], count)
    texts = [
        str(day + np.timedelta64(int(s), "s")) for day, s in zip(days.astype("datetime64[s]"), second, strict=True)
    ]
    return [*texts, "2024-02-29T23:59:59", "1972-06-30T23:59:59", "2016-12-31T23:59:59", "2017-01-01T00:00:00"]


@pytest.mark.ci
def test_numbers_are_astropys_to_the_last_bit():
    for text in random_dates(2000):
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", erfa.ErfaWarning)  # dubious years
            expected = instant_of(Time(text, scale="utc"))
        found = plain_instant(text)
        assert found is not None
        assert (found.utc, found.tai, found.tt) == (expected.utc, expected.tai, expected.tt), text
        if text >= "1972":  # before, astropy does not give back each second as it was written
            assert found.isot == expected.isot


@pytest.mark.parametrize("text", ["2025-03-20", "2025-03-20T12:00", "2025-03-20 12:00:07", " 2025-03-20T12:00:07Z "])
def test_ways_to_write_a_plain_date(text):
    assert instant(text) == instant_of(utc_time(text))
    assert plain_instant(text.strip().removesuffix("Z")) is not None


@pytest.mark.parametrize("text", ["2025-03-20T12:00:07.25", "2025:079:12:00:07", "2016-12-31T23:59:60"])
def test_other_dates_are_left_to_astropy(text):
    assert plain_instant(text) is None
    if ":079:" not in text:  # a year without a month is refused
        assert instant(text) == instant_of(utc_time(text))


@pytest.mark.parametrize(
    "text",
    ["", "soon", "2025:079:12:00:07", "2025-03-20T24:00:01", "2025-02-30", "2025-13-01", "1959-12-31", "2100-01-01"],
)
def test_errors_are_those_of_utc_time(text):
    messages = []
    for parse in (utc_time, instant):
        with pytest.raises(ws.InputError) as caught:
            parse(text)
        messages.append(str(caught.value))
    assert messages[0] == messages[1]


def test_scene_times_count_alike_from_both():
    scene, time_s = ws.Scene.load("stss"), np.array([-3.0, 0.0, 1614.0])
    for dates in (tt_jd, tdb_jd):
        (whole, fraction), (other_whole, other_fraction) = (
            dates(e, time_s) for e in (scene.epoch, scene.scenario.epoch)
        )
        assert whole == other_whole and np.array_equal(fraction, other_fraction)


def test_leap_seconds_of_the_list_are_taken(checkout_environment):
    """Where ERFA knows fewer than the list that comes with astropy, the list counts."""
    code = (
        "import erfa; erfa.leap_seconds.set(erfa.leap_seconds.get()[:-1])\n"
        "from warpsim.instant import plain_instant\n"
        "print(plain_instant('2025-01-01').tai.jd2 * 86400)"
    )
    shown = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=True, env=checkout_environment
    ).stdout
    last = LeapSeconds.from_iers_leap_seconds()["tai_utc"][-1]
    assert float(shown) + 43200.0 == pytest.approx(last, abs=1e-6, rel=0)


@pytest.mark.ci
def test_a_first_frame_needs_no_astropy(checkout_environment):
    code = (
        "import sys, warpsim as ws\n"
        "scene = ws.Scene.load('stss')\n"
        "scene.scenario.sensors_with_access, scene.scenario.tracks\n"
        "print([name for name in sys.modules if name.split('.')[0] == 'astropy'])"
    )
    shown = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=True, env=checkout_environment
    ).stdout
    assert shown.strip() == "[]"


@pytest.mark.parametrize("action", ["error", "always"])
@pytest.mark.ci
def test_years_ahead_are_no_cause_for_warnings(action, tmp_path):
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter(action)
        epoch = utc_time("2055-06-01T00:00:00")
        assert epoch.isot == "2055-06-01T00:00:00.000"
        tdb_jd(epoch, 0.0)
        time_s = np.arange(0.0, 601.0, 60.0)
        orbit = ws.KeplerOrbit(60.0, altitude_km=900.0)
        states = [part[:, 0] for part in orbit.states(epoch, time_s)]
        ws.write_oem(tmp_path / "a.oem", ws.EphemerisSegment.of_states("a", epoch, time_s, *states))
        ws.EphemerisOrbit(tmp_path / "a.oem", frame="ITRF").states(epoch, time_s)
        scene = ws.Scene.load("stss").replace(epoch_utc="2055-06-01T00:00:00", sky__catalog="none")
        ws.write_czml(scene, tmp_path / "a.czml", step_s=100.0)
        ws.render_to_folder(scene, tmp_path / "out", frames=[60], sensors=["sat11"], bands=["A"], every_frame=True)
    assert not [str(warning.message) for warning in caught if "dubious" in str(warning.message)]


def test_no_leap_seconds_are_counted_ahead():
    whole, fraction = tt_jd(utc_time("2055-06-01T00:00:00"), 0.0)
    assert (whole - 2471784.5 + fraction) * 86400.0 == pytest.approx(37.0 + 32.184, abs=1e-4, rel=0)  # those of 2017
