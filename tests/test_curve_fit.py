"""Fits of light curves: parameters found again, their errors, and what data do not determine."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from test_light_curve import BOX

import warpsim as ws

MONTE_CARLO = 0.1  # asked for, over 200 draws, of which a standard deviation has an error of 5 %
SEED = 7
N_DRAW = 200
PRECESSION = ["precession_rev_s", "precession_phase_rev", "precession_angle_deg"]
TIMES = np.arange(600.0, 612.0, 0.02)
SENSORS = ["sat11", "sat47"]


def curve_of(scene, parameters=PRECESSION, target="center", time_s=TIMES, **options):
    options = {"phase_time_s": 606.0, "bands": ["A", "C"], "device": "cpu"} | options
    return ws.LightCurve(scene, target, parameters, time_s, SENSORS, **options)


@pytest.fixture(scope="module")
def paper(scene):
    return scene.replace(sky__catalog="none").scenario


@pytest.mark.ci
def test_the_papers_cone_is_recovered_at_the_cramer_rao_bound(paper, record_accuracy):
    """Precession rate, phase and angle from light curves of two sensors, 200 draws of the noise."""
    curve = curve_of(paper)
    light = curve(curve.values)
    bound = np.array(list(curve.fisher(curve.values).sigma.values()))
    noisy = curve.sample(np.repeat(curve.values[None], N_DRAW, axis=0), key=SEED)
    off = {f"center.{name}": value for name, value in zip(PRECESSION, curve.values + 2 * bound, strict=True)}
    fits = [ws.fit([(curve, one, curve.sigma_w_cm2(light))], start=off) for one in noisy]
    error = (np.array([fit.values for fit in fits]) - curve.values) / bound
    record_accuracy(
        "Scatter of fits of light curves over their bounds, less 1", np.abs(error.std(axis=0) - 1).max(), MONTE_CARLO,
        "", "Cramer-Rao bounds",
    )  # fmt: skip
    assert np.abs(error.mean(axis=0)).max() < 5 / np.sqrt(N_DRAW)
    chi_square = np.array([fit.chi_square / fit.n_freedom for fit in fits])
    assert abs(chi_square.mean() - 1) < 5 * np.sqrt(2 / fits[0].n_freedom / N_DRAW)
    assert all(fit.converged for fit in fits)
    stated = np.array([list(fit.sigma.values()) for fit in fits])
    np.testing.assert_allclose(np.median(stated, axis=0), bound, rtol=0.1)


@pytest.mark.ci
def test_a_scan_finds_the_rate(paper):
    """From a rate and an angle far off: the scan tries rates with phases, whatever the brightness."""
    curve = curve_of(paper, [*PRECESSION, "scale"])
    truth = curve.values.copy()
    truth[[0, 1, 3]] = 1.37, 0.31, 1.8
    data = curve.sample(truth, key=SEED)
    start = {"center.precession_rev_s": 0.5, "center.precession_angle_deg": 5.0}
    found = ws.fit([(curve, data, None)], start=start, scan={"center.precession_rev_s": (0.2, 3.0)})
    sigma = np.array(list(found.sigma.values()))
    assert (np.abs(found.values - truth) < 5 * sigma).all()
    assert found["center.precession_rev_s"] == found.values[0]
    assert abs(found.chi_square / found.n_freedom - 1) < 5 * np.sqrt(2 / found.n_freedom)
    assert found.p_value > 1e-6
    assert ws.fit([(curve, data, 1e-3 * curve.sigma_w_cm2(data))]).p_value == 0.0
    listed = {"center.precession_rev_s": [1.3, 1.37], "center.precession_phase_rev": np.linspace(0, 1, 8)}
    given = ws.fit([(curve, data, None)], start=start, scan=listed)
    np.testing.assert_allclose(given.values, found.values, atol=1e-4 * sigma.max())


@pytest.mark.slow
def test_the_spin_of_a_box_is_found(scene):
    """But for half a turn, after which the box looks the same."""
    motion = ws.Attitude(0.7, 0.11, 30.0, axis=(0.2, -0.5, 0.4))
    box = ws.TargetSpec("box", BOX, ws.Graybody(reflectance=0.6), ws.Temperature(300.0), motion)
    other = scene.replace(sky__catalog="none", groups=[dataclasses.replace(scene.groups[0], targets=[box])])
    curve = curve_of(other, ["spin_rev_s", *PRECESSION, "spin_phase_rev"], "box")
    truth = curve.values.copy()
    truth[[0, 4]] = 1.093, 0.246
    found = ws.fit([(curve, curve.sample(truth, key=SEED), None)], scan={"box.spin_rev_s": (0.2, 2.0)})
    missed = found.values - truth
    missed[4] -= np.round(2 * missed[4]) / 2
    assert (np.abs(missed) < 5 * np.array(list(found.sigma.values()))).all()


@pytest.mark.ci
def test_bodies_and_curves_are_fitted_together(paper):
    """Two curves of one cone share its parameters; a cylinder has its own; what is NaN does not count."""
    cone = curve_of(paper, ["precession_angle_deg", "scale"])
    later = curve_of(paper, ["scale"], time_s=TIMES + 300.0, bands="E")
    cylinder = curve_of(paper, ["rolling_rev_s", "rolling_phase_rev"], "cylinder01")
    data = []
    for number, curve in enumerate((cone, later, cylinder)):
        one = curve.sample(curve.values, key=SEED, first=number)
        one[::7] = np.nan
        data.append((curve, one, curve.sigma_w_cm2(curve(curve.values))))
    found = ws.fit(data)
    assert found.names == [
        "center.precession_angle_deg", "center.scale", "cylinder01.rolling_rev_s", "cylinder01.rolling_phase_rev",
    ]  # fmt: skip
    truth = np.concatenate([cone.values, cylinder.values])
    assert (np.abs(found.values - truth) < 5 * np.array(list(found.sigma.values()))).all()
    assert found.n_freedom == sum(np.isfinite(one).sum() for _, one, _ in data) - 4
    alone = ws.fit(data[2:])
    np.testing.assert_allclose(found.covariance[2:, 2:], alone.covariance, rtol=1e-4)


def test_what_data_do_not_determine_is_named(paper):
    curve = curve_of(paper, ["scale", "radius_m", "height_m", "precession_phase_rev"])
    known = curve.fisher(curve.values)
    assert known.degenerate == "the measurements do not change with scale : radius_m : height_m = 1 : -0.25 : -1"
    assert known.least_singular_value < 1e-12
    assert set(known.weakest) == {"scale", "radius_m", "height_m"}
    with pytest.raises(ws.InputError, match="scale : radius_m : height_m"):
        _ = known.covariance
    found = ws.fit([(curve, curve.sample(curve.values, key=SEED), None)])
    assert "center.radius_m" in found.degenerate
    with pytest.raises(ws.InputError, match="singular"):
        _ = found.covariance
    tumbling = curve_of(paper, ["precession_angle_deg", "rolling_phase_rev"], "cylinder01")
    assert "precession_angle_deg : rolling_phase_rev = -360 : 1" in tumbling.fisher(tumbling.values).degenerate


def test_information_is_that_of_the_jacobian(paper):
    curve = curve_of(paper)
    slopes, sigma = curve.jacobian(curve.values), 2e-18
    by_hand = np.einsum("tsbp,tsbq->pq", slopes, slopes) / sigma**2
    known = curve.fisher(curve.values, sigma)
    np.testing.assert_allclose(known.matrix, by_hand, rtol=1e-10, atol=0)
    np.testing.assert_allclose(known.covariance, np.linalg.inv(by_hand), rtol=1e-8)
    assert known.degenerate == "" and 0 < known.least_singular_value <= 1


def test_bad_data_are_refused(paper):
    curve, later = curve_of(paper), curve_of(paper, phase_time_s=607.5)
    light = curve(curve.values)
    for data, options, words in (
        ([], {}, "at least one light curve"),
        ([(curve, light)], {}, "must be \\(LightCurve"),
        ([(curve, light[1:], None)], {}, "must have the shape of its curve"),
        ([(curve, light, 0.0)], {}, "must be above 0"),
        ([(curve, np.full_like(light, np.inf), None)], {}, "must be finite"),
        ([(curve, light, None), (later, light, None)], {}, "precession_phase_rev must count at one time.* 607.5 s"),
        ([(curve, np.full_like(light, np.nan), None)], {}, "at least 3 numbers"),
        ([(curve, light, None)], {"start": {"precession_rev_s": 1.0}}, "among center.precession_rev_s"),
        ([(curve, light, None)], {"scan": {"nobody.scale": [1.0]}}, "among center.precession_rev_s"),
        ([(curve, light, None)], {"scan": {"center.precession_rev_s": (0.0, 1e6)}}, "steps, more than"),
    ):
        with pytest.raises(ws.InputError, match=words):
            ws.fit(data, **options)


@pytest.mark.ci
def test_a_scan_of_few_data_over_a_long_time_ends_at_the_truth(paper):
    """Cells beside the true one fit nearly as well, and searches from them end in other minima."""
    time_s = np.arange(250.0, 1400.0, 40.0)
    curve = ws.LightCurve(paper, "center", PRECESSION, time_s, ["sat11"], ["A", "C"], "cpu", phase_time_s=800.0)
    exact = curve(curve.values)
    found = ws.fit([(curve, exact, 1e-18)], scan={"center.precession_rev_s": (0.99, 1.01)})
    assert found.chi_square < 1e-6 and found.p_value == 1.0
    np.testing.assert_allclose(found.values, curve.values, atol=1e-6)


def test_a_fit_prints_what_it_found(paper):
    curve = curve_of(paper)
    text = str(ws.fit([(curve, curve(curve.values), None)]))
    assert text.startswith("Fit(chi-square ") and "center.precession_rev_s 1 +- " in text
    sizes = curve_of(paper, ["scale", "radius_m", "height_m"])
    assert "do not change with" in str(ws.fit([(sizes, sizes.sample(sizes.values, key=3), None)]))


def test_parameters_that_end_on_a_bound_are_named(paper):
    """Light of more than a black body, then of less than nothing; an angle beside it has no bounds."""
    curve = curve_of(paper, ["emissivity.A", "precession_angle_deg"])
    sigma = curve.sigma_w_cm2(curve(curve.values))
    ends = curve(np.array([[0.0, 3.0], [1.0, 3.0]]))
    for beyond, ended_at in ((1.1, 1.0), (-0.1, 0.0)):
        found = ws.fit([(curve, ends[0] + beyond * (ends[1] - ends[0]), sigma)])
        assert found.at_bound == ["center.emissivity.A"] and found.converged
        assert abs(found["center.emissivity.A"] - ended_at) < 1e-12
        assert "on a bound: center.emissivity.A" in str(found)
    inside = ws.fit([(curve, ends[0] + 0.999 * (ends[1] - ends[0]), sigma)])
    assert inside.at_bound == [] and "bound" not in str(inside)


@pytest.mark.parametrize(
    ("target", "parameters"),
    [
        ("cylinder01", ["precession_angle_deg", "rolling_phase_rev"]),
        ("center", ["scale", "radius_m", "height_m"]),
        ("center", PRECESSION),
    ],
)
def test_a_fit_that_starts_at_the_truth_returns_at_once(paper, monkeypatch, target, parameters):
    """Without noise nothing is left to improve, also where the data do not determine the parameters."""
    curve = curve_of(paper, parameters, target)
    light, calls = curve(curve.values), []
    jacobian = ws.LightCurve.jacobian
    monkeypatch.setattr(ws.LightCurve, "jacobian", lambda *arguments: calls.append(1) or jacobian(*arguments))
    found = ws.fit([(curve, light, None)])
    np.testing.assert_array_equal(found.values, curve.values)
    assert found.converged and found.chi_square == 0.0 and found.p_value == 1.0
    assert len(calls) == 1 and bool(found.degenerate) == (parameters != PRECESSION)


def test_a_fit_of_no_light_returns(paper):
    """A target that no sensor sees: nothing changes with its parameters, and the fit says so."""
    curve = ws.LightCurve(paper, "center", PRECESSION, np.array([0.0, 1.0]), ["sat47"], ["A", "C"], "cpu")
    assert not curve(curve.values).any()
    found = ws.fit([(curve, np.full((2, 1, 2), 1e-18), 1e-18)])
    assert abs(found.chi_square - 4.0) < 1e-12 and "precession_rev_s" in found.degenerate


@pytest.mark.parametrize("highest", [1e20, 1e6, 1e300])
def test_a_scan_of_too_many_rates_is_refused_before_it_is_made(paper, highest):
    curve = curve_of(paper)
    with pytest.raises(ws.InputError, match="steps, more than"):
        ws.fit([(curve, curve(curve.values), None)], scan={"center.precession_rev_s": (0.0, highest)})
