"""Gradients of images by their sources: against differences of float64 twins, and of images as they are drawn."""

import numpy as np
import pytest
from conftest import slow
from streak_oracles import axis_fractions

import warpsim as ws
from warpsim.optics.epsf_table import table_fraction
from warpsim.optics.table_upload import axis_table
from warpsim.optics.tables import TableAccuracy, epsf_table, polynomials

SHAPE = (40, 56)
PSFS = {
    "gaussian": ws.PsfGaussian(0.7),
    "narrow gaussian": ws.PsfGaussian(0.3),
    "wide gaussian": ws.PsfGaussian(2.5),
    "airy": ws.PsfAiry(1.2),
    "obscured airy": ws.PsfAiry(2.0, obscuration=0.3, smear_px=0.2),
    "image": ws.PsfTable(np.outer(np.hanning(31), np.hanning(25)) + np.eye(31, 25) / 20, 4.0),
    "sharp airy": ws.PsfAiry(0.05),  # nodes, not polynomials
}


def some_sources(n, seed=0, shape=SHAPE):
    rng = np.random.default_rng(seed)
    return rng.uniform(-2, np.array(shape[::-1]) + 1, (n, 2)), rng.uniform(0.5, 2, n)


def five_point(function, h):
    return (8 * (function(h) - function(-h)) - (function(2 * h) - function(-2 * h))) / (12 * h)


DIFFERENCES = 1e-9
"""Of the largest derivative: rounding of differences in float64."""


def gaussian_twin(sigma_px, xy, column, row):
    """Pixel fractions by the float32 table of edges, cubic interpolation in float64; a plain reading of its layout."""
    table, n_step, per_px, n_pixel = axis_table(sigma_px)

    def along(pixel, centre):
        edge = np.floor(centre + 1.0)
        position = np.clip((edge - 0.5 - centre) * per_px, -n_step, n_step)
        node = int(np.floor(position))
        rows = table[n_step + node : n_step + node + 4, n_pixel // 2 + int(pixel - edge)].astype(np.float64)
        t = position - node
        return np.polynomial.Polynomial.fit([-1, 0, 1, 2], rows, 3, domain=[-1, 1])(t)

    return along(column, xy[0]) * along(row, xy[1])


def cell_twin(table, xy, column, row):
    """Pixel fractions by the polynomials of a table, Chebyshev's series in float64."""
    n_row, n_column = table.n_cell
    own = np.floor(np.asarray(xy) + 0.5)
    dx, dy = own - xy
    step = np.array([column, row]) - own
    if table.nodes.mirrored and dy < 0:
        dy, step[1] = -dy, -step[1]
    x, y = (dx + 0.5) * n_column, (dy + 0.5) * n_row
    i, j = int(x), int(y)
    first = n_row // 2 if table.nodes.mirrored else 0
    pixel = table.zero[1] + int(step[0])
    block = min(pixel // 4, table.coefficient.shape[2] - 1)
    terms = table.coefficient[j - first, i, block, table.zero[0] + int(step[1]), :, pixel - 4 * block]
    series, k = np.zeros((table.degree + 1,) * 2), 0
    for q in range(table.degree + 1):
        for p in range(table.degree + 1 - q):
            series[p, q], k = terms[k], k + 1
    return np.polynomial.chebyshev.chebval2d(2 * (x - i) - 1, 2 * (y - j) - 1, series)


def node_twin(table, xy, column, row):
    return float(table_fraction(table, np.array(column - xy[0]), np.array(row - xy[1])))


def twin_of(psf):
    """Function (xy, column, row) of the fraction of a pixel, and the sizes of its cells along x and y."""
    if isinstance(psf, ws.PsfGaussian):
        per_px = axis_table(psf.sigma_px)[2]
        return lambda xy, c, r: gaussian_twin(psf.sigma_px, xy, c, r), (per_px, per_px)
    accuracy = TableAccuracy(6e-7)
    from warpsim.optics.tables import cheapest_layout

    layout = cheapest_layout([psf], 1.0, accuracy)
    if layout.degree:
        table = polynomials(psf, 1.0, 6e-7, layout.degree)
        return lambda xy, c, r: cell_twin(table, xy, c, r), table.n_cell[::-1]
    table = epsf_table(psf, 1.0, 6e-7, layout.n_point)
    return lambda xy, c, r: node_twin(table, xy, c, r), table.per_px[::-1]


def is_clear(xy, cells, margin):
    """Whether a position lies a margin away from edges of pixels, cells and nodes."""
    for value, per_px in zip(xy, cells, strict=True):
        for kink in ((value + 0.5) * per_px, value * per_px):
            if abs(kink - np.round(kink)) < margin * per_px:
                return False
    return True


@pytest.mark.parametrize("name", [pytest.param(name, marks=pytest.mark.ci if "sharp" in name else ()) for name in PSFS])
def test_derivatives_are_five_point_differences_of_the_same_interpolation(name, record_accuracy):
    record_accuracy("Derivatives of pixels by a source's position", worst_derivative(name, 60), DIFFERENCES, *TWIN)


@pytest.mark.slow
@pytest.mark.parametrize("name", PSFS)
def test_derivatives_of_ten_thousand_sources_are_five_point_differences(name):
    assert worst_derivative(name, 10_000 // len(PSFS) + 1) < DIFFERENCES


TWIN = "of the largest", "five-point differences of a float64 twin"


def worst_derivative(name, n):
    """Largest difference from five-point differences of the twin, over the largest derivative."""
    psf = PSFS[name]
    twin, cells = twin_of(psf)
    rng = np.random.default_rng(5)
    worst = largest = 0.0
    n_seen = 0
    while n_seen < n:
        xy = rng.uniform(12, 26, 2)
        if not is_clear(xy, cells, 1e-4):
            continue
        n_seen += 1
        stamps = ws.deposit_jacobian([xy], [1.0], psf, SHAPE)
        left, _, top, _ = stamps.window[0]
        image = stamps.image(0)
        column, row = np.floor(xy + 0.5).astype(int) + rng.integers(-2, 3, 2)
        light, by_x, by_y, _ = image[:, row - top, column - left]
        h = 4e-5
        expected = [
            five_point(lambda step, at=(xy, axis, column, row): twin(at[0] + step * np.eye(2)[at[1]], *at[2:]), h)
            for axis in range(2)
        ]
        if light == 0.0 == by_x:
            continue  # beyond the stamp
        assert abs(light - twin(xy, column, row)) < 1e-12
        worst = max(worst, abs(by_x - expected[0]), abs(by_y - expected[1]))
        largest = max(largest, abs(by_x), abs(by_y))
    assert largest > 0.001
    return worst / largest


MOVING = {
    "still": {},
    "straight": {"movement_px": [[0.0, 0.0], [3.0, -2.0]]},
    "bent and fading": {
        "movement_px": [[0.1, 0.0], [6.0, 4.0], [0.8, -0.5]], "brightness": [1.0, -0.4, 0.1],
    },
    "hardly moved": {"movement_px": [[0.0, 0.0], [1e-5, 2e-5]], "brightness": [1.0, 0.3]},
}  # fmt: skip


def movement(kind, n):
    return {name: np.tile(values, (n, *[1] * np.ndim(values))) for name, values in MOVING[kind].items()}


ROUNDING = 1e-12


@pytest.mark.ci
@pytest.mark.parametrize("kind", [slow(kind) if kind in ("straight", "hardly moved") else kind for kind in MOVING])
@pytest.mark.parametrize("name", PSFS)
def test_adjoint_and_jacobian_are_each_others_transpose(name, kind, record_accuracy):
    """Two kernels: one sums over rows before it weights, the other weights every pixel; neither calls the other's."""
    n = 40
    xy, flux = some_sources(n)
    flux *= 1e-17
    given = (xy, flux, PSFS[name], SHAPE)
    cotangent = np.random.default_rng(1).normal(size=SHAPE).astype(np.float32)
    found = ws.deposit_gradient(*given, cotangent, **movement(kind, n))
    stamps = ws.deposit_jacobian(*given, **movement(kind, n))
    by = ("x", "y", "light", "sigma")
    products = stamps.matrix(by=by).T @ cotangent.ravel().astype(np.float64)
    by_x, by_y, by_light, by_sigma = products.reshape(4, n)
    size = (abs(stamps.matrix(by=by)).T @ np.abs(cotangent.ravel())).reshape(4, n)
    for mine, theirs, most in ((found.xy_px[:, 0], by_x, size[0]), (found.xy_px[:, 1], by_y, size[1]),
                               (found.flux, by_light, size[2])):  # fmt: skip
        off = np.abs(mine - theirs).max() / most.max()
        record_accuracy("Adjoint against Jacobian", off, ROUNDING, "of the largest", "another kernel, pixel by pixel")
    assert abs(found.sigma_px - by_sigma.sum()) <= ROUNDING * size[3].sum()
    vector = np.random.default_rng(2).normal(size=3 * n)
    wj = np.concatenate([found.xy_px[:, 0], found.xy_px[:, 1], found.flux])
    jv = stamps.matrix(by=by[:3]) @ vector
    assert abs(jv @ cotangent.ravel() - vector @ wj) <= ROUNDING * np.abs(vector * wj).sum()
    assert np.abs(found.xy_px).max() > 0 and size[0].max() > 0


@pytest.mark.ci
@pytest.mark.parametrize("kind", MOVING)
@pytest.mark.parametrize("name", PSFS)
def test_jacobian_holds_the_image_that_is_drawn(name, kind):
    """The light of every source by the Jacobian, summed, is the image: float32 rounding apart."""
    n = 12
    xy, flux = some_sources(n, 3)
    image = ws.deposit(xy, flux, PSFS[name], SHAPE, **movement(kind, n))
    whole = ws.deposit_jacobian(xy, flux, PSFS[name], SHAPE, **movement(kind, n)).matrix(by=["light"]) @ flux
    # A streak of a sharp pattern is a thousand stamps: as many float32 roundings in each pixel.
    atol = 2e-5 if name == "sharp airy" else 3e-7
    np.testing.assert_allclose(whole.reshape(SHAPE), image, rtol=2e-6, atol=atol)


DRAWN = 3e-4
"""Of the largest derivative: float32 images, of which 1e-3 px are a difference, and ends of stamps."""


@pytest.mark.ci
@pytest.mark.parametrize("kind", MOVING)
@pytest.mark.parametrize("name", ["gaussian", "airy", "sharp airy", "image"])
def test_gradients_are_those_of_images_drawn_again(name, kind):
    """Shifts of sources, their light, the coefficients of their paths: central differences of `deposit`."""
    n = 3
    xy, flux = np.array([[20.23, 17.41], [24.9, 19.2], [31.37, 22.11]]), np.array([1.0, 0.7, 1.3])
    moves = movement(kind, n)
    psf = PSFS[name] if name != "sharp airy" else ws.PsfAiry(0.3)
    rng = np.random.default_rng(0)
    cotangent = rng.normal(size=SHAPE).astype(np.float32)
    found = ws.deposit_gradient(xy, flux, psf, SHAPE, cotangent, flux_error=1e-8, **moves)

    def value(xy=xy, flux=flux, moves=moves):
        image = ws.deposit(xy, flux, psf, SHAPE, flux_error=1e-8, **moves)
        return (image.astype(np.float64) * cotangent).sum()

    largest = np.abs(found.xy_px).max()
    h = 2e-3
    for i in range(n):
        for axis in range(2):
            step = np.zeros((n, 2))
            step[i, axis] = h
            assert abs((value(xy + step) - value(xy - step)) / (2 * h) - found.xy_px[i, axis]) < DRAWN * largest
        step = np.zeros(n)
        step[i] = 0.1
        slope = (value(flux=flux + step) - value(flux=flux - step)) / 0.2
        assert abs(slope - found.flux[i]) < DRAWN * np.abs(found.flux).max()
    for k in range(len(MOVING[kind].get("movement_px", []))):
        for axis in range(2):
            up, down = ({**moves, "movement_px": moves["movement_px"].copy()} for _ in range(2))
            up["movement_px"][1, k, axis] += h
            down["movement_px"][1, k, axis] -= h
            slope = (value(moves=up) - value(moves=down)) / (2 * h)
            expected = found.movement_px[1, k, axis]
            assert abs(slope - expected) < (DRAWN if kind != "hardly moved" else 3e-3) * largest


SIGMA = 5e-7
"""Of the derivative: what lies beyond stamps that end at 1e-9 of a source, and tables of fractions in float32."""


def test_derivatives_by_sigma_are_those_of_error_functions():
    xy, flux = np.array([[20.2, 17.4], [10.7, 30.1]]), np.array([1.0, 0.7])
    cotangent = np.random.default_rng(4).normal(size=SHAPE).astype(np.float32)

    def value(sigma):
        rows, columns = axis_fractions(xy[:, 1], SHAPE[0], sigma), axis_fractions(xy[:, 0], SHAPE[1], sigma)
        return (np.einsum("n,nr,nc->rc", flux, rows, columns) * cotangent).sum()

    for sigma in (0.5, 0.9, 1.7):
        found = ws.deposit_gradient(xy, flux, ws.PsfGaussian(sigma), SHAPE, cotangent, flux_error=1e-9).sigma_px
        expected = five_point(lambda step, sigma=sigma: value(sigma + step), 1e-3)
        assert abs(found - expected) < SIGMA * abs(expected)


@pytest.mark.ci
def test_gradients_do_not_depend_on_batch_threads_or_other_sources():
    """Views one by one, in parts by threads, and sources alone: bit for bit."""
    from concurrent.futures import ThreadPoolExecutor

    n = 30
    xy, flux = some_sources(n, 9)
    cotangent = np.random.default_rng(1).normal(size=SHAPE)
    for psf in (PSFS["gaussian"], PSFS["airy"], PSFS["sharp airy"]):
        whole = ws.deposit_gradient(xy, flux, psf, SHAPE, cotangent)
        scaled = flux / flux.max()
        whole_scaled = ws.deposit_gradient(xy, scaled, psf, SHAPE, cotangent)

        def alone(i, psf=psf, scaled=scaled):
            both = [i, int(np.argmax(scaled))]  # the scale is that of the brightest
            return ws.deposit_gradient(xy[both], scaled[both], psf, SHAPE, cotangent)

        with ThreadPoolExecutor(4) as pool:
            for i, one in enumerate(pool.map(alone, range(n))):
                np.testing.assert_array_equal(one.xy_px[0], whole_scaled.xy_px[i])
                assert one.flux[0] == whole.flux[i] == whole_scaled.flux[i]


def test_a_source_without_light_has_a_gradient_by_light_alone():
    cotangent = np.random.default_rng(1).normal(size=SHAPE)
    dark, bright = (ws.deposit_gradient([[20.2, 17.4]], [f], PSFS["airy"], SHAPE, cotangent) for f in (0.0, 1.0))
    assert dark.flux == bright.flux and not dark.xy_px.any()


def test_sources_off_the_image_and_empty_lists_have_none():
    cotangent = np.ones(SHAPE)
    far = ws.deposit_gradient([[-1e9, 3.0]], [1.0], PSFS["gaussian"], SHAPE, cotangent)
    assert not far.xy_px.any() and not far.flux.any()
    none = ws.deposit_gradient(np.zeros((0, 2)), [], PSFS["airy"], SHAPE, cotangent)
    assert none.xy_px.shape == (0, 2) and none.sigma_px == 0.0
    stamps = ws.deposit_jacobian([[-1e9, 3.0], [4.0, 4.0]], [1.0, 1.0], PSFS["gaussian"], SHAPE)
    assert stamps.matrix().shape == (SHAPE[0] * SHAPE[1], 6) and stamps.matrix()[:, [0]].nnz == 0
    tiny = ws.deposit_gradient([[1.0, 1.0]], [1.0], PSFS["gaussian"], (3, 2), np.ones((3, 2)))
    assert np.isfinite(tiny.xy_px).all() and tiny.xy_px.any()


@pytest.mark.parametrize(
    ("cotangent", "text"),
    [
        (np.ones((3, 3)), r"cotangent: must have shape \(40, 56\), got \(3, 3\)"),
        (np.full(SHAPE, np.nan), "cotangent: must be finite"),
        (np.full(SHAPE, 1e300), "cotangent: must be finite"),
        ("light", "cotangent: must have shape|cotangent: must be an array"),
    ],
)
def test_bad_cotangents_are_refused(cotangent, text):
    with pytest.raises(ws.InputError, match=text):
        ws.deposit_gradient([[1.0, 1.0]], [1.0], PSFS["gaussian"], SHAPE, cotangent)


@pytest.mark.ci
@pytest.mark.parametrize("name", PSFS)
def test_windows_hold_the_stamps_of_sources_on_edges_of_pixels(name):
    """Within float64 rounding of an edge, the stamp's float32 ends may be a pixel farther out."""
    xy = np.array([[20.5, 12.5], [20.0, 13.0]])
    for more in (-3e-13, -1e-15, 0.0, 1e-15, 3e-13):
        for flux in ([1.0, 1.0], [1.0, 1e-3]):
            image = ws.deposit(xy + more, flux, PSFS[name], SHAPE)
            whole = ws.deposit_jacobian(xy + more, flux, PSFS[name], SHAPE).matrix(by=["light"]) @ flux
            np.testing.assert_allclose(whole.reshape(SHAPE), image, rtol=2e-6, atol=3e-8)
            touched = whole.reshape(SHAPE) != 0
            np.testing.assert_array_equal(touched, image != 0)
