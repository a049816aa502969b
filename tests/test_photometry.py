"""Rendered stars measured by other people's programs: photutils fits them, sep detects them.

Images are in units of NEI, so the noise of a pixel has variance 1, and the last digit of the counts its own. The
bounds are Cramer and Rao's, from derivatives of the pixel-integrated point spread function by scipy.
"""

from __future__ import annotations

import numpy as np
import pytest
from scipy.special import ndtr

import warpsim as ws

sep = pytest.importorskip("sep", reason="sep is not installed (extra oracle)")
psf_tools = pytest.importorskip("photutils.psf", reason="photutils is not installed (extra oracle)")

NEI = 1e-18
GAIN, OFFSET = 40.0, 1000.0
PIXEL_VARIANCE = 1.0 + 1.0 / (12.0 * GAIN**2)
W_CM2_PER_JY = ws.BANDS["A"].w_cm2_per_jy

UNBIASED = 1e-3
"""The promise on photometry at high SNR; measured are 1e-5 to 1e-4, the noise of these many measurements."""
OF_BOUND = 0.10
"""The promise on the scatter of places, against Cramer and Rao's bound."""
SPACING_PX, BOX = 20, 11
FLUX_NEI = 1500.0
"""Of a star whose flux and place are measured: SNR of some hundreds."""


def grid_places(n_row, n_col, seed=21, spacing_px=SPACING_PX):
    """Places on a grid, each at a phase of its own, shape (n, 2)."""
    x, y = np.meshgrid(np.arange(spacing_px // 2, n_col, spacing_px), np.arange(spacing_px // 2, n_row, spacing_px))
    xy = np.column_stack([x.ravel(), y.ravel()]).astype(float)
    return xy + np.random.default_rng(seed).uniform(-0.5, 0.5, xy.shape)


def rendered_stars(scene, xy_px, flux_nei, n_frame, sigma_px):
    """Frames of a fixed sky in NEI, (n_frame, n_row, n_col), and the labels of the stars."""
    n_row, n_col = (np.ptp(xy_px, axis=0)[::-1] + SPACING_PX).round().astype(int)
    described = scene.replace(
        camera={"n_row": int(n_row), "n_col": int(n_col), "fov_deg": 1.0},
        optics={"aperture_m": 0.4, "psf": "gaussian", "sigma_px": sigma_px, "stamp_cut_nei": 1e-4},
        detector={"kind": "nei", "nei_w_cm2": NEI, "sei_w_cm2": 1500 * NEI, "bits": 16, "offset_counts": OFFSET,
                  "counts_per_nei": GAIN},
        pointing={"kind": "fixed", "ra_dec_deg": [80.0, 50.0], "up": "north"}, bands=["A"],
        frames={"count": n_frame, "interval_s": 0.1, "start_s": 700.0},
        targets=[scene.to_dict()["groups"][0]["targets"][0]],
        sky={"catalog": "none", "aberration": False},
    )  # fmt: skip
    (sensor,) = [
        name for name in described.sensor_names
        if described.position_m(name, [700.0])[0] @ described.scenario.view_axes(name, [700.0])[0, 2] > 7e6
    ][:1]  # fmt: skip
    direction = described.camera.direction(xy_px, described.scenario.view_axes(sensor, [700.0])[0])
    catalog = ws.StarCatalog.from_arrays(
        np.degrees(np.arctan2(direction[:, 1], direction[:, 0])), np.degrees(np.arcsin(direction[:, 2])),
        {"A": flux_nei * NEI / W_CM2_PER_JY},
    )  # fmt: skip
    images = ws.Renderer(described, device="cpu", catalog=catalog).render(range(n_frame), [sensor], keep_stars=True)
    first = images.stars[images.stars["frame"] == 0]
    first.sort("catalog_row")
    assert len(images.stars) == n_frame * len(xy_px)
    return (images.counts.numpy()[:, 0, 0] - OFFSET) / GAIN, np.column_stack([first["x_px"], first["y_px"]])


def gaussian_shares(xy_px, sigma_px, centre):
    """Shares of pixels of the box about a pixel, shape (BOX, BOX)."""
    edges = np.arange(BOX + 1) - BOX / 2
    across, down = (np.diff(ndtr((edges + middle - at) / sigma_px)) for middle, at in zip(centre, xy_px, strict=True))
    return down[:, None] * across[None]


def cramer_rao(shares_at, xy_px, flux_nei):
    """Smallest standard deviations of x, y [px] and flux [NEI] of unbiased fits to the box about a star, (3,)."""
    step, centre = 1e-4, np.rint(xy_px)
    slopes = []
    for axis in range(2):
        aside = np.eye(2)[axis] * step
        slopes.append(flux_nei * (shares_at(xy_px + aside, centre) - shares_at(xy_px - aside, centre)) / (2 * step))
    slopes.append(shares_at(xy_px, centre))
    flat = np.stack([slope.ravel() for slope in slopes])
    return np.sqrt(np.diag(np.linalg.inv(flat @ flat.T / PIXEL_VARIANCE)))


def fitted(images, model, xy_px, flux_nei):
    """What photutils says of each star on each image: (n_image, n_star, 3) of x, y and flux."""
    from astropy.table import Table

    photometry = psf_tools.PSFPhotometry(model, (BOX, BOX), aperture_radius=4)
    error = np.full(images[0].shape, np.sqrt(PIXEL_VARIANCE))
    start = Table({"x_init": np.rint(xy_px[:, 0]), "y_init": np.rint(xy_px[:, 1]), "flux_init": flux_nei * 0.9})
    found = []
    for image in images:
        table = photometry(image, error=error, init_params=start)
        found.append(np.column_stack([table["x_fit"], table["y_fit"], table["flux_fit"]]))
    return np.array(found)


def assert_unbiased_and_at_the_bound(found, xy_px, flux_nei, bounds):
    """Photometry to UNBIASED, places without bias, and the scatter of both within OF_BOUND of the bound."""
    truth = np.column_stack([xy_px, flux_nei])
    missed = found - truth
    n = missed[..., 0].size
    bias = (missed[..., 2] / flux_nei).mean()
    assert abs(bias) < UNBIASED / 2, bias
    by_star = (missed[..., 2] / flux_nei).mean(axis=0)
    assert np.abs(by_star).max() < UNBIASED / 2 + 5 * (bounds[:, 2] / flux_nei).max() / np.sqrt(len(found))
    pulls = missed / bounds
    assert np.abs(pulls[..., :2].mean(axis=(0, 1))).max() < 5 / np.sqrt(n)
    scatter = np.sqrt((pulls**2).mean(axis=(0, 1)))
    sampling = 5 / np.sqrt(2 * n)
    assert sampling < OF_BOUND
    assert (np.abs(scatter - 1) < OF_BOUND).all(), scatter
    return bias, scatter


def measure_gaussian(scene, n_frame, sigma_px):
    wanted = grid_places(280, 300)
    flux = np.full(len(wanted), FLUX_NEI)
    images, labels = rendered_stars(scene, wanted, flux, n_frame, sigma_px)
    np.testing.assert_allclose(labels, wanted, rtol=0, atol=1e-7)
    model = psf_tools.CircularGaussianPRF(fwhm=sigma_px * np.sqrt(8 * np.log(2)))
    bounds = np.array([cramer_rao(lambda at, c: gaussian_shares(at, sigma_px, c), xy, FLUX_NEI) for xy in labels])
    return assert_unbiased_and_at_the_bound(fitted(images, model, labels, flux), labels, flux, bounds)


@pytest.mark.slow
def test_gaussian_stars_of_the_renderer_are_unbiased_and_at_the_bound(scene, record_accuracy):
    bias, scatter = measure_gaussian(scene, 7, sigma_px=0.7)
    record_accuracy("Flux of rendered stars, bias", abs(bias), UNBIASED / 2, "of the flux", "photutils")
    far = np.abs(scatter - 1).max()
    record_accuracy("Scatter of their fluxes and places", far, OF_BOUND, "of the bound", "Cramer and Rao")


@pytest.mark.slow
@pytest.mark.parametrize("sigma_px", [0.5, 1.0, 1.6])
def test_gaussian_stars_in_100_frames(scene, sigma_px):
    """20,000 measurements: the scatter is known to 0.5 %."""
    bias, scatter = measure_gaussian(scene, 100, sigma_px)
    assert abs(bias) < 1e-4
    assert (np.abs(scatter - 1) < 0.03).all(), scatter  # by 5 sigma of the sample, 0.024


def airy_pixel_fractions(radius_px, reach_px, oversampling):
    """Share of a pixel of an Airy pattern, by its centre's place, from the transfer functions of pupil and pixel.

    The pattern is band-limited, so that a sum over its spectrum is exact but for the period of 512 px.
    """
    n, cutoff = 512 * oversampling, 1.219669891266504 / radius_px  # cycles per pixel
    frequency = np.fft.fftfreq(n, 1 / oversampling)
    nu = np.minimum(np.hypot(frequency[:, None], frequency[None]) / cutoff, 1.0)
    pupil = 2 / np.pi * (np.arccos(nu) - nu * np.sqrt(1 - nu * nu))
    spectrum = pupil * np.sinc(frequency)[:, None] * np.sinc(frequency)[None]
    shares = np.fft.fftshift(np.fft.ifft2(spectrum).real) * oversampling**2
    middle, reach = n // 2, reach_px * oversampling
    return shares[middle - reach : middle + reach + 1, middle - reach : middle + reach + 1]


def measure_airy(n_frame, radius_px):
    oversampling, reach = 6, 12
    fractions = airy_pixel_fractions(radius_px, reach, oversampling)
    model = psf_tools.ImagePSF(fractions, oversampling=oversampling)
    xy = grid_places(560, 600, seed=5, spacing_px=2 * SPACING_PX)  # neighbours' wings: 1e-4 of the flux
    flux = np.full(len(xy), FLUX_NEI)
    clean = ws.deposit(xy, flux, ws.PsfAiry(radius_px), (560, 600), device="cpu", flux_error=1e-7)
    rng = np.random.default_rng(9)
    images = np.rint((clean + rng.standard_normal((n_frame, *clean.shape))) * GAIN) / GAIN

    def shares_at(place, centre):
        column, row = np.meshgrid(np.arange(BOX) - BOX // 2, np.arange(BOX) - BOX // 2)
        return model.evaluate(column + centre[0], row + centre[1], 1.0, place[0], place[1])

    bounds = np.array([cramer_rao(shares_at, place, FLUX_NEI) for place in xy])
    return assert_unbiased_and_at_the_bound(fitted(images, model, xy, flux), xy, flux, bounds)


@pytest.mark.slow
def test_airy_stars_are_unbiased_and_at_the_bound():
    """Noise by NumPy; the model that photutils fits is made from the transfer function, not from warpsim's tables."""
    measure_airy(7, radius_px=1.8)


@pytest.mark.slow
@pytest.mark.parametrize("radius_px", [1.0, 2.5, 4.0])
def test_airy_stars_in_60_frames(radius_px):
    """12,600 measurements of a pattern whose wings overlap a little: 1e-4 of the flux at the largest radius."""
    bias, scatter = measure_airy(60, radius_px)
    assert abs(bias) < 5e-4
    assert (np.abs(scatter - 1) < 0.03).all(), scatter


def matched_snr(flux_nei, xy_px, sigma_px):
    """Of the best filter there is, at a star's place."""
    shares = gaussian_shares(xy_px, sigma_px, np.rint(xy_px))
    return flux_nei * np.sqrt((shares**2).sum() / PIXEL_VARIANCE)


@pytest.mark.ci
def test_bright_stars_are_found_where_they_are(scene):
    """By photutils' finder: all of them, none else."""
    finder = pytest.importorskip("photutils.detection").DAOStarFinder(threshold=8.0, fwhm=2.355)
    wanted = grid_places(280, 300)
    images, labels = rendered_stars(scene, wanted, np.full(len(wanted), 300.0), 4, 1.0)
    for image in images:
        found = finder(image)
        names = ("x_centroid", "y_centroid") if "x_centroid" in found.colnames else ("xcentroid", "ycentroid")
        place = np.column_stack([found[name] for name in names])
        nearest = np.linalg.norm(place[:, None] - labels[None], axis=-1)
        assert len(found) == len(labels)
        assert sorted(nearest.argmin(axis=1)) == list(range(len(labels)))
        assert nearest.min(axis=1).max() < 0.15


def test_completeness_of_detection_is_that_of_theory(scene):
    """sep's matched filter at five sigma finds a star of SNR s with probability Phi(s - 5), and little else."""
    sigma_px, threshold = 1.0, 5.0
    wanted = grid_places(280, 300)
    levels = np.array([2.0, 4.0, 5.0, 6.0, 8.0, 12.0])
    per_nei = np.array([matched_snr(1.0, xy, sigma_px) for xy in wanted])
    level = levels[np.arange(len(wanted)) % len(levels)]
    images, labels = rendered_stars(scene, wanted, level / per_nei, 12, sigma_px)
    kernel = gaussian_shares(np.zeros(2), sigma_px, np.zeros(2))
    hits, n_false = np.zeros(len(wanted)), 0
    for image in images:
        found = sep.extract(np.ascontiguousarray(image), threshold, err=np.full(image.shape, np.sqrt(PIXEL_VARIANCE)),
                            minarea=1, filter_kernel=kernel, filter_type="matched")  # fmt: skip
        apart = np.linalg.norm(np.column_stack([found["x"], found["y"]])[:, None] - labels[None], axis=-1)
        hits += apart.min(axis=0) < 2.0
        n_false += np.count_nonzero(apart.min(axis=1) >= 2.0)
    complete = np.array([hits[level == one].mean() / len(images) for one in levels])
    # The largest of some pixels about the star counts, which helps, and stars between pixels lose a little.
    np.testing.assert_allclose(complete, ndtr(levels - threshold), rtol=0, atol=0.12)
    assert complete[0] < 0.05 and complete[-1] == 1.0
    assert (np.diff(complete) >= 0).all()
    assert n_false <= 5  # 0.3 are expected among a million pixels
