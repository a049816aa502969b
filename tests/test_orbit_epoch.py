"""Epochs far ahead: taken without complaints, as the documentation says what is assumed of them."""

from __future__ import annotations

import warnings

import numpy as np
import pytest

import warpsim as ws
from warpsim.instant import tdb_jd, tt_jd, utc_time


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
