"""Detectors that are read row by row, and TDI, against images of all rows at once at each row's own time."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import special

import warpsim as ws

SENSOR, MIDDLE_S = "sat27", 800.0
N_ROW, N_COL, SIGMA_PX = 48, 64, 0.9
LINE_S = 4e-4

PER_LINE = 0.3
"""Of the brightest source per pixel, for each pixel that it moves from row to row: all rows of a stamp have the time
of the source's own. At sigma = 0.9 px the light d rows above is off by d v, at most 0.144 v of it along y, 0.072 v
along x; twice that."""
CENTRE_ATOL_PX = 1e-5  # of pixels weighted with float32 light; what stamps leave out is less than 1e-8 of it
STILL_ATOL = 1e-5  # the line of the images: aberration and orbits within a read-out of milliseconds
LIGHT_RTOL = 2e-6  # float32, and paths that give rows' times to 1e-3 px
BOX_ATOL = 2e-6  # as images of streaks: half of flux_error, and sums of float32

NO_STARS = ws.StarCatalog.from_arrays([], [], {})
NO_SUN = {"sun": False, "earth": False, "albedo": False}


def ball(radius_m):
    return {
        "name": "center",
        "shape": {"kind": "sphere", "radius_m": radius_m},
        "surface": {"reflectance": 0.1},
        "temperature": {"start_k": 400.0, "end_k": 400.0},
    }


def plain(scene, radius_m=1e-5, **changes):
    """One frame of an instant, all rows at once."""
    return scene.replace(
        frames={"count": 1, "interval_s": 10.0, "start_s": MIDDLE_S},
        optics={"aperture_m": 0.4, "psf": "gaussian", "sigma_px": SIGMA_PX, "stamp_cut_nei": 1e-6},
        camera={"n_row": N_ROW, "n_col": N_COL, "fov_deg": 0.5},
        bands=["A"],
        lighting=NO_SUN,
        **{"targets": [ball(radius_m)], **changes},
    )


def rendered(scene, catalog, device="cpu", frames=(0,), sensors=(SENSOR,)):
    """Noiseless signal [W/cm2], (n_frame, n_row, n_col) of the first sensor, and the frames."""
    renderer = ws.Renderer(scene, device, catalog=catalog)
    found = renderer.render(list(frames), list(sensors), keep_signal=True, keep_stars=True)
    return found.signal_w_cm2.numpy()[:, 0, 0].astype(np.float64), found


def by_rows(scene, catalog, device, line_s, n_line=0, per_line=1):
    """Signal whose rows are those of frames, each at its row's time: means of instants over an exposure of n_line."""
    step_s = abs(line_s) / per_line
    n_mean = max(n_line * per_line, 1)
    start_s = MIDDLE_S - 0.5 * (N_ROW - 1) * abs(line_s) - 0.5 * (n_mean - 1) * step_s
    n_frame = (N_ROW - 1) * per_line + n_mean
    frames = {"count": n_frame, "interval_s": step_s, "start_s": start_s}
    signal, found = rendered(scene.replace(frames=frames), catalog, device, range(n_frame))
    first = np.arange(N_ROW)[:: 1 if line_s > 0 else -1] * per_line
    return np.stack([signal[k : k + n_mean, row].mean(axis=0) for row, k in enumerate(first)]), found


@pytest.fixture(scope="module")
def field(scene):
    """Stars about what is looked at, a hundred in a square degree."""
    rng = np.random.default_rng(5)
    boresight = scene.scenario.view_axes(SENSOR, [MIDDLE_S])[0]
    radius, angle = np.radians(3.0) * np.sqrt(rng.random(8000)), 2 * np.pi * rng.random(8000)
    position = np.stack([np.tan(radius) * np.cos(angle), np.tan(radius) * np.sin(angle), np.ones(8000)], axis=1)
    x, y, z = (position @ boresight).T
    ra_deg, dec_deg = np.degrees(np.arctan2(y, x)) % 360, np.degrees(np.arctan2(z, np.hypot(x, y)))
    return ws.StarCatalog.from_arrays(ra_deg, dec_deg, {"A": 10 ** rng.uniform(-1, 1, 8000)})


@pytest.fixture(scope="module")
def pointings(scene):
    """By name: ways in which the sky or the target moves over the image by 10 px/s or more."""
    x, y, z = scene.scenario.view_axes(SENSOR, [MIDDLE_S])[0, 2]
    ra_deg, dec_deg = float(np.degrees(np.arctan2(y, x))), float(np.degrees(np.arcsin(z)))
    rows = [
        {"time_s": MIDDLE_S + side * 100.0, "ra_deg": ra_deg + side * 20.0, "dec_deg": dec_deg + side * 5.0}
        for side in (-1.0, 1.0)
    ]
    drift = {"urad_s": [1500.0, -2500.0], "reset_s": 799.3}
    fixed = {"kind": "fixed", "ra_dec_deg": (ra_deg, dec_deg)}
    slew = {"max_rate_deg_s": 0.3, "max_acceleration_deg_s2": 0.2, "settle_s": 1.0}
    steps = [{"start_s": 0.0, "track": "main"}, {"start_s": MIDDLE_S - 1.0, "ra_dec_deg": (ra_deg + 2.0, dec_deg)}]
    return {
        "drift": {**fixed, "drift": drift},
        "scan": {"kind": "table", "mode": "scan", "rows": rows},
        "slew": {"kind": "schedule", "steps": steps, "slew": slew},
        "fixed": {"kind": "fixed", "ra_dec_deg": (ra_deg + 0.06, dec_deg + 0.1)},
    }


CASES = [
    ("drift", LINE_S, 0), ("drift", -LINE_S, 0), ("scan", LINE_S, 0), ("slew", -LINE_S, 0), ("fixed", LINE_S, 0),
    ("drift", LINE_S, 16), ("scan", -LINE_S, 16), ("fixed", -10 * LINE_S, 16),
]  # fmt: skip


@pytest.mark.parametrize(("name", "line_s", "n_line"), CASES)
@pytest.mark.ci
def test_rows_are_those_of_their_own_times(scene, device, field, pointings, name, line_s, n_line, record_accuracy):
    """The error is that of one time for a stamp: it shrinks with the movement from row to row."""
    catalog = NO_STARS if name == "fixed" else field
    one = plain(scene, 3.0 if name == "fixed" else 1e-5, pointing=pointings[name])
    errors = []
    for factor in (1.0, 0.25):
        own_s = line_s * factor
        exposure_s = n_line * abs(own_s)
        expected, instants = by_rows(one, catalog, device, own_s, n_line, 4 if n_line else 1)
        rolling = one.replace(detector__line_time_s=own_s, detector__exposure_s=exposure_s)
        signal, found = rendered(rolling, catalog, device)
        at_once, _ = rendered(one.replace(detector__exposure_s=exposure_s), catalog, device)
        brightest = max(found.stars["irradiance_w_cm2"].max(initial=0.0), found.truth["irradiance_w_cm2"].max())
        per_line_px = speed_px_s(instants, name == "fixed") * abs(own_s)
        assert per_line_px > 5e-4
        errors.append(np.abs(signal - expected).max() / brightest)
        unit = "of the light for each px from row to row"
        record_accuracy("Rows read in turn", errors[-1] / per_line_px, PER_LINE, unit, "frames at the rows' times")
        assert np.abs(at_once - expected).max() > 5 * np.abs(signal - expected).max()
    assert errors[1] < 0.4 * errors[0]


def speed_px_s(found, of_target):
    """Largest speed over the image of a source that first and last frame have."""
    table = found.truth if of_target else found.stars
    key = "target" if of_target else "id"
    first, last = (table[table["frame"] == frame] for frame in (0, len(found.frames) - 1))
    ends = [(a, b) for a in first for b in last[last[key] == a[key]]]
    moved = [np.hypot(b["x_px"] - a["x_px"], b["y_px"] - a["y_px"]) / (b["time_s"] - a["time_s"]) for a, b in ends]
    return max(moved)


def test_stars_that_stand_still_are_as_if_read_at_once(scene, device, field, pointings):
    one = plain(scene, pointing=pointings["fixed"])
    signal, found = rendered(one.replace(detector__line_time_s=1e-5), field, device)
    at_once, _ = rendered(one, field, device)
    assert np.abs(signal - at_once).max() <= STILL_ATOL * found.stars["irradiance_w_cm2"].max()


@pytest.mark.parametrize("line_s", [2e-3, -2e-3])
def test_truth_is_where_the_light_is(scene, device, pointings, line_s):
    """And the time is that of the row; stars' positions are those of light alike (test below)."""
    drifting = plain(scene, 3.0, pointing={**pointings["drift"], "roll_deg": 20.0})
    for start_s in (MIDDLE_S - 0.4, MIDDLE_S + 0.1):
        frames = {"count": 1, "interval_s": 1.0, "start_s": start_s}
        signal, found = rendered(drifting.replace(frames=frames, detector__line_time_s=line_s), NO_STARS, device)
        main = found.truth[0]
        assert main["in_fov"] and abs(main["y_px"] - 0.5 * (N_ROW - 1)) > 3
        rows, columns = np.indices(signal[0].shape)
        centre = [(signal[0] * axis).sum() / signal[0].sum() for axis in (columns, rows)]
        np.testing.assert_allclose([main["x_px"], main["y_px"]], centre, rtol=0, atol=CENTRE_ATOL_PX)
        assert found.truth["row_time_s"].unit == "s"
        assert main["row_time_s"] == pytest.approx((main["y_px"] - 0.5 * (N_ROW - 1)) * line_s, rel=0, abs=1e-12)
        then = {"count": 1, "interval_s": 1.0, "start_s": start_s + float(main["row_time_s"])}
        own = rendered(drifting.replace(frames=then), NO_STARS, device)[1].truth[0]
        for name in ("x_px", "y_px", "range_km", "irradiance_w_cm2", "snr"):
            assert main[name] == pytest.approx(own[name], rel=1e-5), name
    assert "row_time_s" not in rendered(drifting, NO_STARS, device)[1].truth.colnames


def test_stars_of_the_table_are_at_the_times_of_their_rows(scene, device, field, pointings):
    one = plain(scene, pointing=pointings["scan"])
    stars = rendered(one.replace(detector__line_time_s=5e-3), field, device)[1].stars
    inside = stars[stars["in_fov"]]
    assert len(inside) > 5
    for star in inside:
        frames = {"count": 1, "interval_s": 1.0, "start_s": MIDDLE_S + float(star["y_px"] - 23.5) * 5e-3}
        then = rendered(one.replace(frames=frames), field, device)[1].stars
        (own,) = then[then["id"] == star["id"]]
        np.testing.assert_allclose([star["x_px"], star["y_px"]], [own["x_px"], own["y_px"]], rtol=0, atol=2e-3)


@pytest.mark.parametrize("exposure_s", [0.0, 0.01])
def test_a_turning_target_is_as_bright_as_at_its_rows_time(scene, device, exposure_s):
    """A plate that flashes ten times a second, near the top of the image."""
    plate = {
        **ball(1.0),
        "shape": {"kind": "plate", "length_m": 1.0, "width_m": 1.0},
        "attitude": {"rolling_rev_s": 5.0},
    }
    one = plain(
        scene, targets=[plate], pointing={"track": "main", "offset_px": (3.0, -19.3)}, detector__exposure_s=exposure_s
    )
    for line_s in (1e-3, -1e-3):
        truth = rendered(one.replace(detector__line_time_s=line_s), NO_STARS, device)[1].truth[0]
        assert truth["row_time_s"] == pytest.approx(-19.3 * line_s, rel=1e-6)
        own_s = MIDDLE_S + float(truth["row_time_s"])
        light = ws.light_curves(one, [own_s, MIDDLE_S], SENSOR, bands="A").irradiance_w_cm2[:, 0, 0, 0]
        assert abs(light[1] / light[0] - 1) > 0.05
        assert truth["irradiance_w_cm2"] == pytest.approx(light[0], rel=LIGHT_RTOL)


@pytest.mark.parametrize("line_s", [1e-5, -1e-5])
def test_tdi_smears_by_a_pixel_along_columns(scene, device, field, pointings, line_s, record_accuracy):
    one = plain(scene, pointing=pointings["fixed"])
    tdi = one.replace(detector__line_time_s=line_s, detector__tdi_stages=32, detector__exposure_s=32 * abs(line_s))
    signal, found = rendered(tdi, field, device)
    node, weight = np.polynomial.legendre.leggauss(20)
    expected = np.zeros((N_ROW, N_COL))
    for star in found.stars:
        across = fractions(N_COL, star["x_px"])
        along = sum(0.5 * w * fractions(N_ROW, star["y_px"] + 0.5 * t) for t, w in zip(node, weight, strict=True))
        expected += star["irradiance_w_cm2"][0] * along[:, None] * across
    error = np.abs(signal[0] - expected).max() / found.stars["irradiance_w_cm2"].max()
    record_accuracy("Blur of TDI by a pixel", error, BOX_ATOL, "of the flux", "error functions")
    np.testing.assert_allclose(found.stars["dy_px"], -np.sign(line_s), rtol=0, atol=0.02)


def fractions(n, centre_px):
    """Fractions of a Gaussian's light in a line of pixels."""
    return np.diff(special.ndtr((np.arange(n + 1) - 0.5 - centre_px) / SIGMA_PX))


def test_a_frame_is_the_same_in_any_batch(scene, device, field, pointings):
    many = plain(scene, 3.0, pointing={**pointings["drift"], "on": "all"}).replace(
        frames={"count": 6, "interval_s": 0.2, "start_s": MIDDLE_S - 0.5},
        detector__line_time_s=2e-3, detector__exposure_s=0.02,
    )  # fmt: skip
    together = ws.Renderer(many, device, catalog=field).render(range(6), ["sat11", SENSOR])
    alone = ws.Renderer(many, device, catalog=field, n_thread=1).render([4], [SENSOR])
    turned = ws.Renderer(many, device, catalog=field).render([4, 1], [SENSOR, "sat11"])
    np.testing.assert_array_equal(together.counts.numpy()[4, 1], alone.counts.numpy()[0, 0])
    np.testing.assert_array_equal(together.counts.numpy()[4], turned.counts.numpy()[0, ::-1])


WRONG = [
    ({"line_time_s": 1.5}, r"detector.line_time_s: must be in \[-1, 1\]"),
    ({"line_time_s": 0.5}, r"detector.line_time_s: must read all 48 rows within 10 s, got 0.5"),
    ({"line_time_s": -0.205}, r"line_time_s: must read all 48 rows within frames.interval_s \(9.8\), got -0.205"),
    ({"line_time_s": 1e-3, "streaks": False}, r"streaks: must be true with line_time_s"),
    ({"tdi_stages": 4}, r"tdi_stages: needs line_time_s, the time of a stage, got 4"),
    ({"tdi_stages": 4, "line_time_s": -1e-3, "exposure_s": 5e-3}, r"exposure_s: must be .*line_time_s\| \(0.004\)"),
]


@pytest.mark.parametrize(("detector", "message"), WRONG)
def test_what_does_not_fit_is_refused_in_one_line(scene, detector, message):
    two = plain(scene).replace(frames={"count": 2, "interval_s": 9.8})
    with pytest.raises(ws.InputError, match=message) as error:
        two.replace(**{f"detector__{name}": value for name, value in detector.items()})
    assert "\n" not in str(error.value)
