"""Images as CCDData: their light, their errors against draws, and what stands beside them."""

import numpy as np
import pytest

import warpsim as ws

NEI = {"kind": "nei", "nei_w_cm2": 1e-18, "sei_w_cm2": 3e-15, "counts_per_nei": 0.7}
ELECTRONS = {
    "kind": "electron", "exposure_s": 0.1, "full_well_e": 1e6, "gain_e_per_count": 16.0, "bits": 16, "dark_e_s": 1e4,
    "read_noise_e": 60.0,
}  # fmt: skip


@pytest.mark.parametrize("detector", [NEI, ELECTRONS], ids=["nei", "electrons"])
def test_errors_are_those_of_the_noise(detector):
    """Light less the noiseless signal, over the stated errors, is unit normal; bright pixels have their shot noise."""
    scene = ws.Scene.load("stss").replace(detector=detector, bands=["A"])
    frames = ws.Renderer(scene).render(range(60, 100), sensors=["sat21"], keep_signal=True)
    ratios, bright = [], []
    for index, frame in enumerate(frames.frames):
        image = ws.ccddata(frames, frame, "sat21", "A")
        signal = frames.signal_w_cm2.numpy()[index, 0, 0].astype(float)
        free = ~image.mask
        error = (image.data - signal) / image.uncertainty.array
        ratios.append(error[free])
        bright.append(error[free & (signal > 30 * scene.scenario.instrument.nei_w_cm2("A"))])
    ratios, bright = np.concatenate(ratios), np.concatenate(bright)
    assert ratios.std() == pytest.approx(1.0, abs=5 / np.sqrt(2 * len(ratios)) + 0.003)
    assert len(bright) > 50 and bright.std() == pytest.approx(1.0, abs=5 / np.sqrt(2 * len(bright)))
    assert abs(ratios.mean()) < 5 / np.sqrt(len(ratios)) + 2e-3


def test_what_stands_beside_an_image():
    scene = ws.Scene.load("stss").replace(bands=["A", "C"])
    frames = ws.Renderer(scene).render([60, 61], sensors=["sat11", "sat21"])
    image = ws.ccddata(frames, 61, "sat21", "C")
    assert image.unit == "W / cm2" and image.meta["SENSOR"] == "sat21" and image.meta["FRAME"] == 61
    assert image.meta["FILTER"] == "C" and image.meta["DATE-OBS"].startswith("2025-01-01T14:10:10")
    assert not image.mask.any()
    sky, own = image.wcs.pixel_to_world(3.0, 90.0), frames.wcs(61, "sat21").pixel_to_world(3.0, 90.0)
    assert sky.separation(own).arcsec == 0.0
    counts = frames.counts.numpy()[1, 1, 1]
    np.testing.assert_allclose(image.data, (counts - 100.0) / 5.0 * 1e-18, atol=1e-32)
    with pytest.raises(ws.InputError, match="ccddata: frame 7"):
        ws.ccddata(frames, 7, "sat21", "C")


def test_full_pixels_are_masked():
    scene = ws.Scene.load("stss").replace(detector=NEI | {"sei_w_cm2": 2e-17, "hot_fraction": 0.01}, bands=["A"])
    frames = ws.Renderer(scene).render([60], sensors=["sat21"])
    image = ws.ccddata(frames, 60, "sat21", "A")
    assert image.mask.mean() == pytest.approx(0.01, abs=0.005)
    assert (frames.counts.numpy()[0, 0, 0][image.mask] == frames.counts.numpy().max()).all()
