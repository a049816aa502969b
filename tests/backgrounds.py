"""Bands, frames and light of tests of what lies behind stars and targets."""

import numpy as np

import warpsim as ws

NEI_W_CM2 = 1e-18


def narrow(wavelength_um):
    return ws.Band("narrow", wavelength_um * np.array([0.99, 1.0, 1.01]), [0.0, 1.0, 0.0])


def rendered(scene, frames=(60,), sensors=None, **background):
    own = scene.replace(**{f"background__{name}": value for name, value in background.items()})
    return ws.Renderer(own, "cpu").render(list(frames), sensors=sensors, keep_signal=True)


def added_w_cm2(scene, frames=(60,), sensors=None, **background):
    """What a background adds to the signal of frames, in float64, and the frames."""
    plain = ws.Renderer(scene, "cpu").render(list(frames), sensors=sensors, keep_signal=True)
    lit = rendered(scene, frames, sensors, **background)
    return lit.signal_w_cm2.numpy().astype(np.float64) - plain.signal_w_cm2.numpy(), lit


def sight_lines(frames, frame=0, sensor=0):
    """Unit vectors of all pixels of a view, (n_row, n_col, 3)."""
    camera = frames.instrument.sensor.camera
    y, x = np.mgrid[: camera.n_row, : camera.n_col].astype(np.float64)
    lines = camera.direction(np.stack([x.ravel(), y.ravel()], axis=1), frames.axes_icrs[frame, sensor])
    return lines.reshape(camera.n_row, camera.n_col, 3)


def at_altitude(scene, altitude_km, off_nadir_deg, raan_deg=200.0):
    """A small camera over the equator's day side, so far off the nadir, along the orbit."""
    orbit = {"kind": "elements", "altitude_km": altitude_km, "inclination_deg": 30.0, "raan_deg": raan_deg}
    return scene.replace(
        constellation={"kind": "listed", "satellites": [{"name": "one", "orbit": orbit}]},
        access_rules={},
        camera={"n_row": 8, "n_col": 8, "fov_deg": 1.0},
        pointing={"kind": "fixed", "azimuth_elevation_deg": [0.0, off_nadir_deg - 90.0]},
        groups=[],
    )
