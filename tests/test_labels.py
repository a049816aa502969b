"""Boxes, centres and masks: where they are, against the light itself, pycocotools and plain integrals."""

import re
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis.extra import numpy as arrays

import warpsim as ws
from warpsim.labels.boxes import box_around, masks_to_rle, rle_area
from warpsim.optics.enclosed import box_half_width_px
from warpsim.render.resolution import BOX_FRACTION, blur_half_px

SENSOR = "sat11"
FRAME = 60
BOX_PX = 1e-9
"""Boxes are sums of a few float64 numbers."""
PATH_PX = 0.02
"""Extremes of paths: jitter is not smooth enough for the series of a path to be better than some 0.01 px."""
SHARE_ATOL = 3e-3
"""Of light in a box: the mean over a grid of places, and half-widths are rounded up to 1e-3 px."""

masks = arrays.arrays(np.bool_, arrays.array_shapes(min_dims=2, max_dims=2, max_side=24))


# --- run lengths -----------------------------------------------------------------------------------------------------


@settings(max_examples=300, deadline=None)
@given(masks)
def test_codes_come_back(mask):
    code = ws.labels.mask_to_rle(mask)
    np.testing.assert_array_equal(ws.labels.rle_to_mask(code, mask.shape), mask)
    assert rle_area(code, mask.shape) == mask.sum()


def test_codes_are_coco_s():
    """One of COCO's format by hand: runs outside and inside, from the fourth on less the one before the last."""
    mask = np.zeros((5, 4), dtype=bool)
    mask[1:3, 0], mask[4, 1], mask[:, 3] = True, True, True
    assert ws.labels.mask_to_rle(mask) == "126OO4"


def test_codes_of_patches_are_those_of_whole_images():
    rng = np.random.default_rng(2)
    patches, origin_px = rng.random((20, 8, 16)) < 0.4, rng.integers(0, 20, (20, 2))
    patches[3] = False
    patches[4], origin_px[4] = True, (24, 32)  # up to the image's last pixel
    whole = np.zeros((20, 40, 40), dtype=bool)
    for image, patch, (column, row) in zip(whole, patches, origin_px, strict=True):
        image[row : row + 8, column : column + 16] = patch
    assert masks_to_rle(patches, origin_px, (40, 40)) == [ws.labels.mask_to_rle(image) for image in whole]
    assert masks_to_rle(patches[:0], origin_px[:0], (40, 40)) == []


@pytest.mark.parametrize("code", ["P", "12p", "0 1", "O"])
def test_wrong_codes(code):
    with pytest.raises(ws.InputError, match="mask_rle: must be"):
        ws.labels.rle_to_mask(code, (4, 4))


def test_masks_of_other_shapes():
    for mask in (np.zeros(3, bool), np.zeros((0, 4), bool), np.zeros((2, 2, 2), bool)):
        with pytest.raises(ws.InputError, match=r"mask: must have shape \(row, column\)"):
            ws.labels.mask_to_rle(mask)
    with pytest.raises(ws.InputError, match=r"must be .* run lengths of 4 x 5 pixels"):
        ws.labels.rle_to_mask(ws.labels.mask_to_rle(np.eye(4, dtype=bool)), (4, 5))
    assert not ws.labels.rle_to_mask("", (4, 5)).any()


# --- how large the image of a point is -------------------------------------------------------------------------------


def held(psf, half_px, n_place=12):
    """Light of a point in the pixels whose centres lie in the box about it, mean over its places in a pixel."""
    n = 2 * int(half_px + 4) + 1
    steps = (np.arange(n_place) + 0.5) / n_place - 0.5
    pixels = np.arange(n)
    total = 0.0
    for y in steps:
        for x in steps:
            place = np.array([x, y]) + n // 2
            image = ws.deposit([place], [1.0], psf, (n, n), device="cpu").astype(np.float64)
            # The part of the places near this one from which a pixel's centre lies in the box.
            ends = [pixels - place[:, None] + side / n_place for side in (-0.5, 0.5)]
            low, high = (np.clip(end, -half_px, half_px) for end in ends)
            columns, rows = (high - low) * n_place
            total += rows @ image @ columns
    return total / n_place**2


PSFS = {
    "sharp": ws.PsfGaussian(0.2),
    "gaussian": ws.PsfGaussian(0.8),
    "wide gaussian": ws.PsfGaussian(5.0),
    "airy": ws.PsfAiry(1.22),
    "obscured": ws.PsfAiry(2.0, obscuration=0.5, smear_px=0.3),
    "image": ws.PsfTable(np.pad(np.ones((9, 3)), 4), 3.0),
}


@pytest.mark.parametrize("psf", PSFS.values(), ids=PSFS)
@pytest.mark.ci
def test_box_holds_its_share(psf):
    half_px = box_half_width_px(psf, BOX_FRACTION)
    assert abs(held(psf, half_px) - BOX_FRACTION) < SHARE_ATOL


def test_boxes_of_limits():
    """Without any blur light fills a pixel; of a wide Gaussian pixels do not matter; wings go on beyond a table."""
    width_px = 2 * box_half_width_px(ws.PsfGaussian(1e-4), 0.84)
    assert abs(width_px - np.sqrt(0.84)) < 3e-3  # a grid of places, and half-widths are rounded up to 1e-3 px
    from scipy.special import ndtri

    wide_px = 50 * ndtri((1 + np.sqrt(0.84)) / 2)
    assert box_half_width_px(ws.PsfGaussian(50.0), 0.84) == pytest.approx(wide_px, rel=1e-3)
    # A round pattern's box of 84 % is smaller than the square about the circle of 84 %, its first dark ring.
    assert 0.75 < box_half_width_px(ws.PsfAiry(20.0), 0.84) / 20 < 0.95
    most = box_half_width_px(ws.PsfAiry(0.5), 0.9999)
    lamf_px = 0.5 / 1.2196698912665045
    square = 8 * np.sin(np.pi / 4) * lamf_px / np.pi**3 / (1 - 0.9999)  # of the mean wing lamF / (pi^3 r^3)
    assert most == pytest.approx(square, rel=1e-2)


def test_boxes_of_pixels_that_are_not_square(scene):
    flat = scene.replace(camera__pixel_aspect=0.5, optics={"aperture_m": 0.4, "psf": "gaussian", "sigma_px": 3.0})
    half_x_px, half_y_px = blur_half_px(flat.scenario.instrument, "A")
    assert half_y_px == 2 * half_x_px
    assert half_x_px == pytest.approx(box_half_width_px(ws.PsfGaussian(3.0), 0.84), rel=2e-2)


# --- label tables ----------------------------------------------------------------------------------------------------


def light_boxes(frames):
    """Labels whose boxes are as narrow as the light."""
    return ws.labels.label_table(frames, least_box_px=1e-3)


def rows_of(table, frame, band="A"):
    return table[(table["frame"] == frame) & (table["band"] == band)]


@pytest.fixture(scope="module")
def blurred(scene):
    return scene.replace(optics={"aperture_m": 0.4, "psf": "gaussian", "sigma_px": 1.1, "stamp_cut_nei": 0.001})


@pytest.fixture(scope="module")
def still(blurred):
    return ws.Renderer(blurred, device="cpu").render([FRAME, 100], [SENSOR], ["A", "C"])


@pytest.fixture(scope="module")
def streaked(blurred):
    """Shaken so that paths of some pixels bend."""
    z = blurred.scenario.view_axes(SENSOR, blurred.scenario.instrument.frame_time_s([FRAME]))[0, 2]
    place = [float(np.degrees(np.arctan2(z[1], z[0])) % 360), float(np.degrees(np.arcsin(z[2])))]
    pointing = {"kind": "fixed", "ra_dec_deg": place, "jitter": {"rms_urad": 800.0, "correlation_s": 0.3}}
    shaken = blurred.replace(detector__exposure_s=0.15, pointing=pointing, seed=6)
    return ws.Renderer(shaken, device="cpu").render([FRAME], [SENSOR], ["A"])


def test_boxes_of_still_targets(still):
    """The box's middle is the target's place, our pixel centre 0 being COCO's 0.5, and its size that of the blur."""
    table = light_boxes(still)
    assert table.colnames[: len(still.truth.colnames)] == still.truth.colnames
    assert len(table) == len(still.truth) and table["visible"].all()
    half_px = np.array([blur_half_px(still.instrument, band)[0] for band in table["band"]])
    for axis, size in (("x", "w"), ("y", "h")):
        np.testing.assert_allclose(table[f"box_{axis}_px"] + half_px, table[f"{axis}_px"] + 0.5, rtol=0, atol=BOX_PX)
        np.testing.assert_allclose(table[f"box_{size}_px"], 2 * half_px, rtol=0, atol=BOX_PX)
        assert table[f"box_{axis}_px"].unit == "pix"


@pytest.mark.parametrize("which", ["still", "streaked"])
@pytest.mark.ci
def test_boxes_hold_the_light(which, request):
    """Most of each target's light is in its box, and little of it in a row or column of pixels beside."""
    frames = request.getfixturevalue(which)
    table = rows_of(light_boxes(frames), FRAME)
    planes = frames.contributions_w_cm2(FRAME, SENSOR, "A").astype(np.float64)
    column_edge, row_edge = np.arange(129.0), np.arange(129.0)
    shares = []
    for row, plane in zip(table, planes, strict=True):
        x, y, width, height = (row[name] for name in ("box_x_px", "box_y_px", "box_w_px", "box_h_px"))
        columns = np.diff(np.clip(column_edge, x, x + width))
        rows = np.diff(np.clip(row_edge, y, y + height))
        shares.append(rows @ plane @ columns / plane.sum())
        centroid = plane.sum(axis=0) @ (np.arange(128) + 0.5) / plane.sum()
        assert x < centroid < x + width
    if which == "still":
        assert abs(np.mean(shares) - BOX_FRACTION) < 0.04  # pixels that the box cuts count in part: 0.018
    assert min(shares) > BOX_FRACTION - 0.05


@pytest.mark.ci
def test_boxes_of_streaks_follow_the_path(streaked):
    """A bent path reaches farther than its ends."""
    table = light_boxes(streaked)
    half_px = blur_half_px(streaked.instrument, "A")[0]
    instants = streaked.scene.replace(
        frames={"count": 601, "interval_s": 0.15 / 600, "start_s": 600.0 - 0.075}, detector__exposure_s=0.0
    )
    truth = ws.Renderer(instants, device="cpu").render(range(601), [SENSOR], ["A"]).truth
    x_px = np.asarray(truth["x_px"]).reshape(601, -1)
    y_px = np.asarray(truth["y_px"]).reshape(601, -1)
    for path_px, axis, size, moved in ((x_px, "x", "w", "dx_px"), (y_px, "y", "h", "dy_px")):
        low = table[f"box_{axis}_px"] + half_px - 0.5
        np.testing.assert_allclose(low, path_px.min(axis=0), rtol=0, atol=PATH_PX)
        high = low + table[f"box_{size}_px"] - 2 * half_px
        np.testing.assert_allclose(high, path_px.max(axis=0), rtol=0, atol=PATH_PX)
        assert (np.ptp(path_px, axis=0) > 1.4 * np.abs(table[moved])).all()


def test_boxes_end_with_the_array(blurred):
    aside = blurred.replace(pointing__offset_px=[63.0, -60.0])
    frames = ws.Renderer(aside, device="cpu").render([100], [SENSOR], ["A"])
    table = ws.labels.label_table(frames)
    shown = table[table["visible"]]
    assert 0 < len(shown) < len(table)
    np.testing.assert_array_equal(table["visible"], table["in_fov"])  # nothing moves
    for axis, size in (("x", "w"), ("y", "h")):
        low, high = shown[f"box_{axis}_px"], shown[f"box_{axis}_px"] + shown[f"box_{size}_px"]
        assert low.min() >= 0 and high.max() <= 128 and (shown[f"box_{size}_px"] > 0).all()
    assert (shown["box_x_px"] + shown["box_w_px"] == 128).any() and (shown["box_y_px"] == 0).any()
    hidden = table[~table["visible"]]
    assert np.isnan(hidden["box_x_px"]).all() and (hidden["keypoint_visibility"] == 0).all()


@pytest.mark.parametrize("least_px", [0.5, 3.0, 7.0])
def test_boxes_have_a_least_size(least_px):
    """By hand, on an array of 20 x 10 pixels: still points, one on the array's corner, and a streak that comes in."""
    low_px = np.array([[5.0, 4.0], [-0.5, 9.49], [-9.0, 3.0]])
    high_px = np.array([[5.0, 4.0], [-0.5, 9.49], [-0.45, 3.0]])
    half_px, size_px = np.array([0.4, 0.6]), np.array([20, 10])
    x, y, w, h = box_around(low_px, high_px, half_px, size_px, least_px).T
    wide, high = max(least_px, 0.8), max(least_px, 1.2)
    np.testing.assert_allclose([x[0], y[0], w[0], h[0]], [5.5 - wide / 2, 4.5 - high / 2, wide, high], atol=1e-12)
    least_cut_px = min(least_px, 1.0)
    corner = [max(wide / 2, least_cut_px), max(0.01 + high / 2, least_cut_px)]
    np.testing.assert_allclose([x[1], w[1], h[1]], [0.0, *corner], atol=1e-12)
    assert y[1] + h[1] == 10.0
    np.testing.assert_allclose([x[2], w[2]], [0.0, max(0.45, least_cut_px)], atol=1e-12)


@pytest.mark.parametrize("offset_px", [[0.0, 0.0], [63.0, -60.0], [-63.5, 63.4]])
def test_no_reader_drops_a_box(scene, offset_px):
    """MMDetection skips boxes with w < 1 or h < 1; those of narrow bands are 0.9 px wide where the light is."""
    sharp = scene.replace(pointing__offset_px=offset_px, optics__aperture_m=1.5)
    frames = ws.Renderer(sharp, "cpu").render(range(90, 102), "sat11")
    table = ws.labels.label_table(frames)
    shown = table[table["visible"]]
    assert len(shown) > 50
    for axis, size in (("x", "w"), ("y", "h")):
        low, wide = np.asarray(shown[f"box_{axis}_px"]), np.asarray(shown[f"box_{size}_px"])
        whole = (low > 0) & (low + wide < 128)
        assert wide.min() >= 1.0 and wide[whole].min() >= 3.0 - BOX_PX
        assert low.min() >= 0.0 and (low + wide).max() <= 128.0
        inside = (shown[f"{axis}_px"] + 0.5 >= low) & (shown[f"{axis}_px"] + 0.5 <= low + wide)
        assert inside.all()
    assert min(light_boxes(frames)["box_w_px"]) < 1.0


@pytest.mark.ci
def test_targets_whose_streaks_reach_in_are_visible(blurred):
    """Their place in the middle of the exposure is off the array; the box is what is left of the path."""
    time_s = blurred.scenario.instrument.frame_time_s([FRAME])
    z = blurred.scenario.view_axes(SENSOR, time_s)[0]
    seen = z[2] + np.radians(0.503) * z[0]
    dec_deg = np.degrees(np.arctan2(seen[2], np.hypot(*seen[:2])))
    place = [float(np.degrees(np.arctan2(seen[1], seen[0])) % 360), float(dec_deg)]
    pointing = {"kind": "fixed", "ra_dec_deg": place}
    moving = blurred.replace(detector__exposure_s=1.0, pointing=pointing)
    table = ws.labels.label_table(ws.Renderer(moving, device="cpu").render([FRAME], [SENSOR], ["A"]))
    assert time_s[0] == 600.0
    late = table[table["visible"] & ~table["in_fov"]]
    assert len(late) and (late["keypoint_visibility"] == 1).all()
    assert (late["box_w_px"] > 0).all() and (late["box_h_px"] > 0).all()


def test_centres_are_bright_or_faint(still):
    table = ws.labels.label_table(still, least_nei=5.0)
    bright = table["snr_peak"] >= 5.0
    assert bright.any() and not bright.all()
    np.testing.assert_array_equal(table["keypoint_visibility"], np.where(bright, 2, 1))
    own = {"LEAST_NEI": 5.0, "LEAST_BOX_PX": 3.0}
    assert table.meta == still.truth.meta | own and table.meta["SCENE"] == "stss"


def test_hidden_targets_have_no_labels(scene):
    frames = ws.Renderer(scene, device="cpu").render(range(0, 162, 20), bands=["A"])
    table = ws.labels.label_table(frames, with_masks=True)
    hidden = table["occulted"] & table["in_fov"]
    assert hidden.any() and not table["visible"][hidden].any()
    assert not table["keypoint_visibility"][hidden].any() and (table["mask_rle"][hidden] == "").all()


@pytest.mark.ci
@pytest.mark.parametrize("which", ["still", "streaked"])
@pytest.mark.parametrize("least_nei", [0.05, 2.0])
def test_masks_are_those_of_the_planes(which, least_nei, request):
    frames = request.getfixturevalue(which)
    least_w_cm2 = least_nei * frames.scene.scenario.instrument.nei_w_cm2("A")
    table = ws.labels.label_table(frames, least_nei, with_masks=True)
    for frame in frames.frames:
        planes = frames.contributions_w_cm2(frame, SENSOR, "A").astype(np.float64)
        for row, plane in zip(rows_of(table, frame), planes, strict=True):
            mask = ws.labels.rle_to_mask(row["mask_rle"], (128, 128))
            unclear = np.abs(plane / least_w_cm2 - 1) < 1e-5  # rounding may bring it to either side
            assert row["visible"] or not mask.any()
            if row["visible"]:
                np.testing.assert_array_equal(mask[~unclear], (plane >= least_w_cm2)[~unclear])
                assert (row["keypoint_visibility"] == 2) <= mask.any()


def test_no_frames_have_empty_tables(scene):
    frames = ws.Renderer(scene, device="cpu").render([], [SENSOR], ["A"])
    table = ws.labels.label_table(frames, with_masks=True)
    assert len(table) == 0 and "mask_rle" in table.colnames


def test_the_page_lists_every_column(still):
    table = ws.labels.label_table(still, with_masks=True)
    text = (Path(__file__).parents[1] / "docs" / "labels.md").read_text()
    cells = re.findall(r"^\|([^|]*)\|", text[text.index("## Label table") : text.index("**Boxes**")], re.MULTILINE)
    listed = [name for cell in cells for name in re.findall(r"`([^`]+)`", cell)]
    assert listed == table.colnames[len(still.truth.colnames) :]


@pytest.mark.ci
def test_every_column_of_a_table_has_a_meaning(scene):
    full = scene.replace(background__zodiacal=True, detector__line_time_s=1e-5)
    table = ws.labels.label_table(ws.Renderer(full, "cpu").render([60], ["sat11"], ["A"]))
    assert {"row_time_s", "noise_nei"} < set(table.colnames)
    assert all(table[name].info.description for name in table.colnames)


def test_least_nei_is_checked(still):
    with pytest.raises(ws.InputError, match="least_nei: must be a number above 0, got 0"):
        ws.labels.label_table(still, 0)
    with pytest.raises(ws.InputError, match="least_box_px: must be a number above 0, got -1"):
        ws.labels.label_table(still, least_box_px=-1)


def test_frames_are_labelled_alone_as_together(still):
    """The same rows, whichever frames are asked for at once."""
    together = ws.labels.label_table(still, with_masks=True)
    alone = ws.labels.label_table(still.one_frame(1), with_masks=True)
    second = together[together["frame"] == 100]
    for name in together.colnames:
        np.testing.assert_array_equal(np.asarray(alone[name]), np.asarray(second[name]))


# --- pictures --------------------------------------------------------------------------------------------------------


def test_plot_labels(still, tmp_path):
    matplotlib = pytest.importorskip("matplotlib")
    matplotlib.use("Agg")
    from matplotlib import pyplot as plt
    from matplotlib.patches import Rectangle

    ax = ws.plot.plot_labels(still, FRAME, SENSOR, "A", least_nei=3.0)
    ax.figure.savefig(tmp_path / "labels.png")
    boxes = [patch for patch in ax.patches if isinstance(patch, Rectangle)]
    table = rows_of(ws.labels.label_table(still), FRAME)
    corners = sorted((box.get_x() + 0.5, box.get_y() + 0.5) for box in boxes)
    np.testing.assert_allclose(corners, sorted(zip(table["box_x_px"], table["box_y_px"], strict=True)), atol=1e-12)
    assert ax.get_xlim() == (-0.5, 127.5) and ax.get_ylim() == (127.5, -0.5)
    plt.close(ax.figure)
    with pytest.raises(ws.InputError, match="was not rendered"):
        ws.plot.plot_labels(still, 3, SENSOR, "A")


def test_mask_edges():
    from warpsim.plot.label_figure import mask_edges

    mask = np.zeros((4, 5), dtype=bool)
    mask[0, 2:4] = True  # at the image's edge
    edges = {tuple(map(tuple, edge)) for edge in mask_edges(mask).tolist()}
    around = {((1.5, -0.5), (1.5, 0.5)), ((3.5, -0.5), (3.5, 0.5))}
    around |= {((x, y), (x + 1, y)) for x in (1.5, 2.5) for y in (-0.5, 0.5)}
    assert edges == around
