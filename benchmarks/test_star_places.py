"""Time of each step of a star's apparent position, and the error without it.

    python -m pytest benchmarks/test_star_places.py --benchmark-json=benchmarks/results/star_places.json
    python benchmarks/report.py benchmarks/results/star_places.json

The stage `gather_stars` alone, one thread: index query, apparent places, projection, for views of 1 x 1 degree of
`stss`. The error is that of the stars in view against astropy's apparent place (GCRS of the orbiting observer).
"""

from __future__ import annotations

import itertools
from typing import Any

import numpy as np
import pytest
import warp as wp
from astropy import units as u
from astropy.coordinates import GCRS, CartesianRepresentation, SkyCoord
from astropy.time import TimeDelta

import warpsim as ws
from warpsim.launches import Stage
from warpsim.render.batch import new_columns, new_inputs
from warpsim.render.buffers import new_area_series, new_sources
from warpsim.render.device_scene import DeviceScene
from warpsim.render.device_stars import load_catalog, star_index
from warpsim.render.device_upload import make_device_scene
from warpsim.render.stages import aim, gather_stars, observe_targets

SWITCHES = list(itertools.product([False, True], repeat=3))
SENSORS = ("sat11", "sat12", "sat27", "sat47")


@pytest.mark.parametrize(("aberration", "parallax", "light_deflection"), SWITCHES)
def test_star_places(benchmark, aberration, parallax, light_deflection, device):
    n_view = 2000 if benchmark.enabled else 20
    scene = ws.Scene.load("stss").replace(
        camera__n_row=16,
        camera__n_col=16,
        frames={"count": 100_000, "interval_s": 0.01, "start_s": 600.0},
        sky={"aberration": aberration, "parallax": parallax, "light_deflection": light_deflection},
    )
    device = wp.get_device(device)
    scenario = scene.scenario
    index = star_index(scene.sky, scenario.epoch, load_catalog(scene.sky), device)
    on_device = make_device_scene(scenario, scenario.instrument, ["A"], device, index)
    stage, sources = star_stage(on_device, "sat11", n_view)

    def gather() -> None:
        stage.run()
        wp.synchronize_device(device)

    benchmark.pedantic(gather, rounds=15, warmup_rounds=2)
    if benchmark.stats is None:
        return
    benchmark.extra_info.update(
        device=str(device),
        device_name=device.name,
        switches=" + ".join(
            name
            for name, on in zip(("aberration", "parallax", "deflection"), (aberration, parallax, light_deflection),
                                strict=True)
            if on
        ) or "none",
        us_per_view=benchmark.stats.stats.median / n_view * 1e6,
        stars_per_view=float(sources.n_source.numpy().mean()) - on_device.n_target,
        error_arcsec=place_error_arcsec(scene, device),
        bytes_per_star=on_device.stars.device_bytes / len(on_device.stars.index),
    )  # fmt: skip


def star_stage(scene: DeviceScene, sensor: str, n_view: int) -> tuple[Stage, Any]:
    """The star stage over aimed views of one sensor, with targets observed; and its source lists."""
    frames, instrument = np.arange(n_view), scene.instrument
    rows = np.full(n_view, instrument.index(sensor))
    inputs = new_inputs(scene.device, instrument.frame_time_s(frames), frames, rows)
    columns, sources = new_columns(scene, n_view), new_sources(scene, n_view, scene.n_target + 64)
    aim(scene, inputs, columns.views).run()
    observe_targets(scene, inputs, columns, sources, new_area_series(scene, n_view)).run()
    return gather_stars(scene, inputs, columns.views, sources), sources


def place_error_arcsec(scene: ws.Scene, device: wp.Device) -> float:
    """Largest distance of a star from astropy's apparent place, over some sensors."""
    frames = ws.Renderer(scene, device=device).render([0], SENSORS, ["A"], keep_stars=True)
    catalog = ws.StarCatalog.default().at_epoch(scene.epoch)
    when = scene.epoch + TimeDelta(float(frames.time_s[0]), format="sec")
    worst = 0.0
    for number, sensor in enumerate(SENSORS):
        stars = frames.stars[frames.stars["sensor"] == sensor]
        rows = stars["catalog_row"]
        near = np.maximum(np.nan_to_num(catalog.parallax_mas[rows]), 1e-6)
        position = scene.position_m(sensor, frames.time_s)[0]
        velocity = np.diff(scene.position_m(sensor, frames.time_s[0] + np.array([-0.05, 0.05])), axis=0)[0] / 0.1
        observer = GCRS(
            obstime=when,
            obsgeoloc=CartesianRepresentation(position * u.m),
            obsgeovel=CartesianRepresentation(velocity * u.m / u.s),
        )
        place = SkyCoord(
            catalog.ra_deg[rows] * u.deg,
            catalog.dec_deg[rows] * u.deg,
            distance=(near * u.mas).to(u.pc, equivalencies=u.parallax()),
        )
        seen = place.transform_to(observer).cartesian.xyz.value.T
        seen /= np.linalg.norm(seen, axis=1, keepdims=True)
        xy, _ = scene.camera.project(seen, frames.axes_icrs[0, number])
        apart_px = np.hypot(xy[:, 0] - stars["x_px"], xy[:, 1] - stars["y_px"])
        worst = max(worst, float(apart_px.max(initial=0.0)))
    return worst / scene.camera.focal_px / np.radians(1 / 3600)
