"""Figures of the presets can be read: nothing is cut off by a plain savefig, and no word stands upon another."""

import itertools

import numpy as np
import pytest
from conftest import slow
from figures import close_figures  # noqa: F401

import warpsim as ws

WIDE, TIME_S = "sat61.wide", 750.0  # a camera of 12 degrees with a group of 10 pixels
CUT_INCH = 0.005  # less than a pixel of a plain savefig
PRESETS = ("stss", "two_cameras")


@pytest.fixture(scope="module")
def scenarios():
    return {name: ws.Scene.load(name).scenario for name in PRESETS}


@pytest.fixture(scope="module")
def wide(scenarios):
    """A renderer, and the image of the wide camera."""
    renderer = ws.Renderer(scenarios["two_cameras"], device="cpu")
    return renderer, renderer.render([75], sensors=[WIDE], bands=["B2"])


def drawn_axes(found):
    return np.ravel(found)[0]


def check_whole(ax):
    """What is drawn lies within the figure, so a plain savefig keeps it."""
    ax.figure.canvas.draw()
    box = ax.figure.get_tightbbox()
    width, height = ax.figure.get_size_inches()
    assert min(box.x0, box.y0) > -CUT_INCH and box.x1 < width + CUT_INCH and box.y1 < height + CUT_INCH


def overlap(one, other):
    return one.x0 < other.x1 and other.x0 < one.x1 and one.y0 < other.y1 and other.y0 < one.y1


@pytest.mark.ci
@pytest.mark.parametrize("preset", [PRESETS[0], *(slow(name) for name in PRESETS[1:])])
@pytest.mark.parametrize("name", ["scene", "ground_tracks", "bands", "group", "attitudes", "access", "range"])
def test_a_plain_savefig_cuts_nothing_off(scenarios, preset, name):
    arguments = {"scene": (TIME_S,), "group": (TIME_S,), "attitudes": (TIME_S,)}.get(name, ())
    check_whole(drawn_axes(getattr(ws.plot, f"plot_{name}")(scenarios[preset], *arguments)))


@pytest.mark.ci
def test_numbers_of_an_inset_stand_on_paper(scenarios, wide):
    ax = ws.plot.plot_satellite_view(scenarios["two_cameras"], WIDE, TIME_S, renderer=wide[0])
    check_whole(ax)
    (inset,) = ax.child_axes
    (paper,) = (patch for patch in ax.patches if patch.get_facecolor() == (1.0, 1.0, 1.0, 1.0))
    assert paper.get_zorder() < inset.get_zorder()
    labels = [label for axis in (inset.xaxis, inset.yaxis) for label in axis.get_ticklabels()]
    boxes = [label.get_window_extent() for label in labels if label.get_text()]
    room = paper.get_window_extent()
    inside = [box for box in boxes if overlap(box, room)]
    assert len(inside) > 4
    for box in inside:
        assert room.x0 <= box.x0 and box.x1 <= room.x1 + 15 and room.y0 <= box.y0 and box.y1 <= room.y1


@pytest.mark.ci
def test_labels_of_a_wide_image_are_drawn_a_second_time_enlarged(wide):
    ax = ws.plot.plot_labels(wide[1], 75, WIDE, "B2")
    check_whole(ax)
    assert ax.get_xlim() == (-0.5, 2047.5)
    (inset,) = ax.child_axes
    n_box = sum(patch.get_zorder() < 4 for patch in ax.patches)
    assert n_box == 9 and len(inset.patches) == n_box  # the main target, and eight released ones
    (x0, x1), (y1, y0) = inset.get_xlim(), inset.get_ylim()
    for box in inset.patches:
        assert x0 < box.get_x() and box.get_x() + box.get_width() < x1
        assert y0 < box.get_y() and box.get_y() + box.get_height() < y1
    assert 10 < x1 - x0 < 40
    np.testing.assert_array_equal(inset.images[0].get_array(), ax.images[0].get_array())


@pytest.mark.ci
@pytest.mark.parametrize("preset", PRESETS)
def test_the_arrow_to_the_sun_stands_alone(scenarios, preset):
    scenario = scenarios[preset]
    ax = ws.plot.plot_scene(scenario, 0.5 * scenario.scene.duration_s)
    ax.figure.canvas.draw()
    (word,) = (text for text in ax.texts if text.get_text() == "Sun")
    box = word.get_window_extent()
    assert not [
        text for text in ax.texts if text.get_text() not in ("", "Sun") and overlap(text.get_window_extent(), box)
    ]
    points = np.concatenate([ax.transData.transform(line.get_xydata()) for line in ax.lines if len(line.get_xydata())])
    within = (points > [box.x0, box.y0]) & (points < [box.x1, box.y1])
    assert not within.all(axis=1).any()


@pytest.mark.ci
def test_numbers_of_a_group_as_wide_as_the_earth_keep_apart(scenarios):
    axes = ws.plot.plot_group(scenarios["two_cameras"], TIME_S, group="orbiting")
    axes[0].figure.canvas.draw()
    for ax in axes[:3]:
        labels = [label for label in ax.get_xticklabels() if label.get_text()]
        boxes = [label.get_window_extent() for label in labels]
        assert len(boxes) >= 3
        assert not [pair for pair in itertools.combinations(boxes, 2) if overlap(*pair)]


def test_gray_targets_of_one_temperature_are_one_line(scenarios):
    ax = ws.plot.plot_bands(scenarios["stss"])
    (spectra,) = (other for other in ax.figure.axes if other is not ax)
    names = [line.get_label() for line in spectra.lines]
    assert names[-1] == "center, sphere, cylinder, cone, 350 K"
    assert len(names) == 5


@pytest.mark.ci
def test_access_of_milliseconds_is_seen_and_told(scenarios):
    table = scenarios["two_cameras"].access()
    table.add_row({"sensor": "sat13.wide", "target": "any", "start_s": 180.0, "end_s": 180.016, "duration_s": 0.016})
    ax = ws.plot.plot_access(scenarios["two_cameras"], only_with_access=True, access=table, sensors=["wide"])
    words = [text.get_text() for text in ax.texts]
    assert "180.000 to 180.016" in words and "0.016 s" in words and "7.0 min" in words
    assert "0.0 min" not in words
    bars = [patch for container in ax.containers for patch in container]
    shortest = min((bar for bar in bars if bar.get_width() > 0), key=lambda bar: bar.get_width())
    assert shortest.get_width() < 0.02 and shortest.get_linewidth() > 0.5
    assert shortest.get_edgecolor() == shortest.get_facecolor()


def test_words_of_a_sheet_of_one_tile_are_whole(scene, tmp_path):
    import OpenImageIO as oiio

    from warpsim.output.contact_sheet import TOP_PX, draw_contact_sheet
    from warpsim.output.formats import Images

    rows = [Images(scene.scenario, "sat11", "A", [60])]
    draw_contact_sheet(scene, rows, lambda *_: np.full((1, 128, 128), 100, np.uint16), tmp_path / "sheet.png")
    pixels = oiio.ImageBuf(str(tmp_path / "sheet.png")).get_pixels(oiio.UINT8)
    lit = np.flatnonzero((pixels[: TOP_PX - 18, :, 0] > 60).any(axis=0))
    assert 300 < lit.max() < pixels.shape[1] - 8


@pytest.mark.ci
def test_a_sheet_of_targets_of_several_kinds(scenarios, tmp_path):
    """Truth of kinds with different columns, and with targets behind the cameras, which have no place in an image."""
    import OpenImageIO as oiio

    sensors = [WIDE, "sat11.narrow"]
    report = ws.render_to_folder(scenarios["two_cameras"], tmp_path, [75], sensors, device="cpu", sheet="targets")
    pixels = oiio.ImageBuf(str(report.folder / "contact_sheet.png")).get_pixels(oiio.UINT8)
    marks = (pixels == (79, 209, 255)).all(axis=2)
    assert marks[58:186].any() and marks[192:320].any()  # of either sensor
