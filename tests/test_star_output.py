"""Stars on their way out: texts that FITS cannot hold, what a run hangs on, memory of long source lists."""

import numpy as np
import pytest
from astropy.table import Table
from on_devices import device_scene

import warpsim as ws
from warpsim.render.batch import new_columns
from warpsim.render.buffers import bytes_of, new_sources
from warpsim.render.schedule import BYTES_PER_PASS, most_views


def greek_csv(folder):
    """Two stars with names beyond ASCII, one of them where sat11 looks in frame 60."""
    path = folder / "größe.csv"
    path.write_text("ra_deg,dec_deg,flux_A_jy,id\n10.0,20.0,5.0,β Boo\n11.0,21.0,4.0,ξ\n", encoding="utf-8")
    return path


def test_names_beyond_ascii_are_written_as_escapes(scene, tmp_path):
    catalog = ws.StarCatalog.read(greek_csv(tmp_path))
    assert catalog.id.tolist() == ["β Boo", "ξ"]
    ws.write_catalog(catalog, tmp_path / "out.fits")
    assert ws.StarCatalog.read(tmp_path / "out.fits").id.tolist() == ["\\u03b2 Boo", "\\u03be"]
    ws.write_catalog(catalog, tmp_path / "out.ecsv")
    assert ws.StarCatalog.read(tmp_path / "out.ecsv").id.tolist() == ["β Boo", "ξ"]


def test_a_run_with_such_stars(scene, tmp_path):
    axes = ws.Renderer(scene, device="cpu").render([60], ["sat11"], ["A"]).axes_icrs[0, 0]
    ra, dec = np.degrees(np.arctan2(axes[2, 1], axes[2, 0])), np.degrees(np.arcsin(axes[2, 2]))
    path = tmp_path / "größe.csv"
    path.write_text(f"ra_deg,dec_deg,flux_A_jy,id\n{ra},{dec},5.0,β Boo\n", encoding="utf-8")
    described = scene.replace(sky__catalog=str(path))
    ws.render_to_folder(described, tmp_path / "out", [60], ["sat11"], ["A"], device="cpu", stars=True)
    written = Table.read(tmp_path / "out" / "stars.fits")
    assert written["id"].tolist() == ["\\u03b2 Boo"]
    assert written.meta["CATALOG"] == "gr\\xf6\\xdfe.csv"


def test_a_run_hangs_on_the_stars_themselves():
    """Not on the file's name or format: equal stars have equal checksums, whatever epoch they are looked at."""
    columns = {"ra_deg": [1.0, 2.0], "dec_deg": [3.0, 4.0], "flux_jy": {"A": [5.0, np.nan]}}
    one, same = ws.StarCatalog.from_arrays(**columns), ws.StarCatalog.from_arrays(**columns, name="other")
    assert one.checksum == same.checksum == one.at_epoch(2030.0).checksum
    changed = [
        {"ra_deg": [1.0, 2.0 + 1e-12]},
        {"dec_deg": [3.0, 4.1]},
        {"flux_jy": {"A": [5.0, 0.0]}},
        {"flux_jy": {"C": [5.0, np.nan]}},
        {"pm_ra_mas_yr": [0.0, 1.0]},
        {"pm_dec_mas_yr": [0.0, 1.0]},
        {"parallax_mas": [0.0, 1.0]},
        {"id": ["1", "3"]},
        {"flux_jy": {"A": [5.0, np.nan], "W1": [2.0, 3.0]}},
        {"temperature_k": [4000.0, np.nan]},
        {"luminosity": [1, 0]},
        {"epoch_jyear": 2001.0},
    ]
    sums = {ws.StarCatalog.from_arrays(**columns | change).checksum for change in changed}
    assert len(sums | {one.checksum}) == len(changed) + 1


def test_the_renderer_shows_its_stars(scene):
    renderer = ws.Renderer(scene, device="cpu")
    assert renderer.catalog.checksum == ws.StarCatalog.default().checksum
    assert renderer.catalog.epoch_jyear == pytest.approx(scene.epoch.tt.jyear, abs=1e-9)
    with pytest.raises(ws.InputError, match=r"^catalog: must be a StarCatalog, got str; files are for sky\.catalog$"):
        ws.Renderer(scene, device="cpu", catalog="union")


@pytest.mark.parametrize("n_pixel", [32, 128])
@pytest.mark.parametrize("n_slot", [100, 10_000, 1_000_000])
@pytest.mark.ci
def test_long_source_lists_count_in_the_memory_budget(scene, n_slot, n_pixel):
    world = device_scene(scene.replace(camera__n_row=n_pixel, camera__n_col=n_pixel), ("A", "C"))
    camera = world.instrument.sensor.camera
    sources = new_sources(world, 1, n_slot)
    held = bytes_of([sources.xy_px, sources.irradiance_w_cm2, sources.star, *new_columns(world, 1).arrays])
    signal = 2 * 4 * camera.n_row * camera.n_col
    for chunk_bytes in (None, 2**20):
        n_view, room = most_views(world, n_slot, chunk_bytes), chunk_bytes or BYTES_PER_PASS
        assert n_view == 1 or n_view * max(held, signal) <= room
        assert (n_view + 1) * max(held, signal) > room
