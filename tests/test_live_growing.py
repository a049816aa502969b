"""Runs that are still being rendered, or were killed: the page shows what is whole, and writes nothing."""

from __future__ import annotations

import shutil

import numpy as np
import pytest
from waiting import until

import warpsim as ws
from warpsim.errors import InputError
from warpsim.live.run_images import FolderImages, GrowingImages
from warpsim.live.sources import images_from
from warpsim.output.growing import GrowingFiles

pytestmark = pytest.mark.ci

FRAMES, SENSORS, BANDS = list(range(60, 66)), ["sat11", "sat47"], ["A", "E"]


def run(scene, path, n_step=None):
    """Render one frame a call; end, as a kill would, when so many are complete and the next is half written."""
    done, real = [], GrowingFiles.end_step

    def end_step(self, facts):
        if len(done) == n_step:
            raise KeyboardInterrupt
        done.append(facts)
        real(self, facts)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("warpsim.output.run.COUNTS_BYTES_PER_CALL", 1)
        patch.setattr(GrowingFiles, "end_step", end_step)
        if n_step is None:
            ws.render_to_folder(scene, path, FRAMES, SENSORS, BANDS, device="cpu")
            return
        with pytest.raises(KeyboardInterrupt):
            ws.render_to_folder(scene, path, FRAMES, SENSORS, BANDS, device="cpu")


@pytest.fixture(scope="module")
def small():
    """The preset `stss` with cameras of 32 x 32 pixels."""
    scene = ws.Scene.load("stss").to_dict()
    scene["sensors"][0]["camera"] |= {"n_row": 32, "n_col": 32}
    return ws.Scene.from_dict(scene)


@pytest.fixture(scope="module")
def expected(small):
    """Counts, shape (frame, sensor, band, row, column)."""
    return ws.Renderer(small, "cpu").render(FRAMES, SENSORS, BANDS).counts.numpy()


@pytest.fixture(scope="module")
def broken(small, tmp_path_factory):
    """A run that was killed in the second sensor: 2 of its 6 frames are whole, a third is not."""
    path = tmp_path_factory.mktemp("growing") / "run"
    run(small, path, 8)
    return path


@pytest.fixture
def folder(broken, tmp_path):
    """A copy of it, to go on with."""
    return shutil.copytree(broken, tmp_path / "run")


def files_of(path):
    found = (item for item in path.rglob("*") if item.is_file())
    return {str(item.relative_to(path)): (item.read_bytes(), item.stat().st_mtime_ns) for item in found}


def check(images, expected, n_whole):
    """The images are those rendered, with their targets, as many as are whole and no more."""
    for sensor in SENSORS:
        assert list(images.frames(sensor)) == FRAMES[: n_whole[sensor]]
    for i, frame in enumerate(FRAMES):
        for j, band in enumerate(BANDS):
            shown = images.at(frame, SENSORS, band)
            assert [image.sensor for image in shown] == [name for name in SENSORS if i < n_whole[name]]
            for image in shown:
                np.testing.assert_array_equal(image.counts, expected[i, SENSORS.index(image.sensor), j])


def test_whole_frames_of_a_killed_run_are_shown_and_no_others(broken, expected):
    before = files_of(broken)
    (cube,) = broken.glob(".warpsim-parts/growing/*/sat47/files/sat47_A.fits")
    assert cube.stat().st_size % 2880 == 3 * 2 * 32 * 32 % 2880  # the third frame is in it, its step is not complete
    images = images_from(broken)
    assert isinstance(images, GrowingImages) and images.sensors == SENSORS and not images.is_finished
    check(images, expected, {"sat11": 6, "sat47": 2})
    assert (images.n_image_there, images.n_image, images.newest(SENSORS)) == (16, 24, 61)
    assert images.at(70, SENSORS, "A") == images.at(60, SENSORS, "C") == [] and images.frames("sat27") == []
    assert images.at(60, ["sat47"], None)[0].band == "A"
    assert files_of(broken) == before


def test_a_run_that_goes_on_and_ends_is_followed(small, folder, expected):
    images = images_from(folder)
    marks = {frame: [image.marks for image in images.at(frame, SENSORS, "E")] for frame in FRAMES[:2]}
    check(images, expected, {"sat11": 6, "sat47": 2})
    run(small, folder, 2)
    check(images, expected, {"sat11": 6, "sat47": 4})
    run(small, folder)
    check(images, expected, {"sat11": 6, "sat47": 6})
    assert images.is_finished and images.n_image_there == images.n_image == 24
    finished = images_from(folder)
    assert isinstance(finished, FolderImages)
    check(finished, expected, {"sat11": 6, "sat47": 6})
    assert any(any(of) for of in marks.values())
    for frame in FRAMES[:2]:
        assert [image.marks for image in finished.at(frame, SENSORS, "E")] == marks[frame]


def test_files_that_move_between_two_looks_are_found(folder, expected, monkeypatch):
    """A sensor gets its final names after its path was looked up."""
    images = images_from(folder)
    real, moved = GrowingImages._path, []

    def path(self, sensor, name):
        found = real(self, sensor, name)
        if sensor == "sat47" and not moved:
            moved.append(found.replace(folder / name))
        return found

    monkeypatch.setattr(GrowingImages, "_path", path)
    (image,) = images.at(61, ["sat47"], "A")
    np.testing.assert_array_equal(image.counts, expected[1, 1, 0])
    assert moved == [folder / "sat47_A.fits"]
    moved[0].unlink()
    with pytest.raises(FileNotFoundError, match="sat47_A"):
        images.at(61, ["sat47"], "A")


def test_a_journal_counts_as_far_as_it_is_whole(folder, expected):
    (journal,) = folder.glob(".warpsim-parts/growing/*/sat47/journal")
    whole = journal.read_bytes()
    images = images_from(folder)
    journal.write_bytes(whole[:-20])  # a line that is being written
    check(images, expected, {"sat11": 6, "sat47": 1})
    journal.write_bytes(whole)
    check(images, expected, {"sat11": 6, "sat47": 2})
    journal.write_bytes(whole.replace(b'"frames"', b'"Frames"'))
    check(images_from(folder), expected, {"sat11": 6, "sat47": 0})
    journal.write_bytes(b"")
    check(images, expected, {"sat11": 6, "sat47": 0})


def test_another_run_in_the_folder_is_not_taken_for_it(small, folder):
    images = images_from(folder)
    with ws.view(folder, port=0, band="A") as page:
        assert until(lambda: "16 of 24" in page._controls.status.content)
        ws.render_to_folder(small, folder, FRAMES[:1], SENSORS, BANDS, device="cpu", overwrite=True)
        assert until(lambda: "does not hold this run any more" in page._controls.status.content)
    for look in (lambda: images.frames("sat11"), lambda: images.at(60, SENSORS, "A")):
        with pytest.raises(InputError, match="does not hold this run any more"):
            look()


def test_unfinished_folders_of_others_are_refused(small, folder, tmp_path):
    with pytest.raises(InputError, match="holds no unfinished run"):
        GrowingImages(tmp_path)
    record = folder / ".warpsim-parts" / "run.json"
    text = record.read_text()
    record.write_text(text.replace('"fits"', '"png"'))
    with pytest.raises(InputError, match="formats: must have fits to be shown"):
        images_from(folder)
    record.write_text(text.replace('"scene"', '"recipe"', 1))
    with pytest.raises(InputError, match="holds a data set that is unfinished"):
        images_from(folder)


def test_the_page_grows_with_the_run(small, folder, expected):
    with ws.view(folder, port=0, band="A") as page:
        slider = page._controls.slider
        assert until(lambda: page.frame == 61 and "16 of 24 images are there" in page._controls.status.content)
        run(small, folder, 2)
        assert until(lambda: page.frame == slider.value == 63)
        np.testing.assert_array_equal([image.counts for image in page.shown], expected[3, :, 0])
        assert "20 of 24 images are there" in page._controls.status.content
        page.show(60)  # somebody looks at another one
        run(small, folder)
        assert until(lambda: "the run is done, 24 of 24 images are there" in page._controls.status.content)
        assert page.frame == 60 and page.frames == FRAMES
        page.show(65)
        np.testing.assert_array_equal([image.counts for image in page.shown], expected[5, :, 0])


def test_the_page_of_a_run_without_an_image_waits_for_the_first(small, folder, expected):
    for path in [*folder.glob("*.fits"), *folder.glob(".warpsim-parts/checkpoints/*")]:
        path.unlink()
    shutil.rmtree(folder / ".warpsim-parts" / "growing")
    with ws.view(folder, port=0, band="A") as page:
        assert until(lambda: "0 of 24 images are there" in page._controls.status.content) and page.shown == []
        run(small, folder, 1)
        assert until(lambda: page.frame == 60)
        np.testing.assert_array_equal([image.counts for image in page.shown], expected[0, :1, 0])
        assert until(lambda: "2 of 24 images are there" in page._controls.status.content)
        assert (page._controls.slider.min, page._controls.slider.max) == (60, 61)  # a slider has a length
