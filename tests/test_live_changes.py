"""Controls of the page that change the scene: what can be changed, what is rendered then, and what is refused."""

from __future__ import annotations

import html
import time

import numpy as np
import pytest
from conftest import slow
from waiting import until

import warpsim as ws
from warpsim.errors import InputError
from warpsim.live.scene_controls import changed_scene, changes

SENSORS = ["sat11", "sat27"]
NUMBER = "sensors__0__"


@pytest.fixture(scope="module")
def renderer(scene):
    return ws.Renderer(scene, "cpu")


def labels(scene, kind):
    return [change.label for change in changes(scene.scenario, kind)]


def with_values(scene, kind, **values):
    found = changes(scene.scenario, kind)
    given = {change.path: change.value for change in found} | values
    assert given.keys() == {change.path for change in found}
    return changed_scene(scene.scenario, found, lambda change: given[change.path])


def test_fields_are_those_of_the_sensor(scene):
    of_all = ["aperture [m]", "PSF", "sigma [px]", "smear [urad]"]
    nei = ["field of view [deg]", *of_all, "NEI [W/cm2]", "exposure [s]", "pointed at", "seed"]
    assert labels(scene, "sensor") == nei
    electrons = ["field of view [deg]", *of_all, "read noise [e]", "dark current [e/s]", "exposure [s]", *nei[-2:]]
    three = ws.Scene.load("visible_to_lwir")
    assert [labels(three, kind) for kind in ("visible", "mwir", "lwir")] == [electrons, electrons, nei]


def test_a_camera_of_a_lens_has_its_focal_length(scene):
    lens = scene.replace(camera={"n_row": 128, "n_col": 128, "focal_length_m": 2.0, "pixel_pitch_m": 3e-5})
    assert labels(lens, "sensor")[:2] == ["focal length [m]", "aperture [m]"]
    assert with_values(lens, "sensor", sensors__0__camera__focal_length_m=3.0).camera.focal_length_m == 3.0


def test_an_nei_by_band_has_a_field_for_each(scene):
    by_band = scene.replace(detector__nei_w_cm2={"A": 1e-18, "C": 2e-18, "E": 3e-18})
    assert [label for label in labels(by_band, "sensor") if "NEI" in label] == [f"NEI {band} [W/cm2]" for band in "ACE"]
    changed = with_values(by_band, "sensor", sensors__0__detector__nei_w_cm2__C=5e-18)
    assert dict(changed.detector.nei_w_cm2) == {"A": 1e-18, "C": 5e-18, "E": 3e-18}


def test_a_psf_of_an_image_is_left_alone(scene, tmp_path):
    np.save(tmp_path / "psf.npy", np.exp(-0.5 * (np.indices((31, 31)) - 15) ** 2 / 9).prod(axis=0))
    table = scene.replace(optics__psf="table", optics__psf_file=str(tmp_path / "psf.npy"), optics__psf_oversample=3.0)
    assert not {"PSF", "sigma [px]"} & set(labels(table, "sensor"))


def test_changed_numbers_make_the_scene_that_replace_makes(scene):
    changed = with_values(scene, "sensor", sensors__0__camera__fov_deg=2.0, seed=7)
    assert changed.to_dict() == scene.replace(camera__fov_deg=2.0, seed=7).to_dict()
    with pytest.raises(InputError, match="fov_deg"):
        with_values(scene, "sensor", sensors__0__camera__fov_deg=-1.0)


def test_a_sigma_goes_with_the_gaussian(scene):
    gaussian = with_values(scene, "sensor", sensors__0__optics__psf="gaussian", sensors__0__optics__sigma_px=1.5)
    assert gaussian.to_dict() == scene.replace(optics__psf="gaussian", optics__sigma_px=1.5).to_dict()
    airy = with_values(gaussian, "sensor", sensors__0__optics__psf="airy")
    assert airy.to_dict() == scene.to_dict()
    with pytest.raises(InputError, match="sigma_px"):
        with_values(scene, "sensor", sensors__0__optics__sigma_px=1.5)


def test_pointing_may_be_at_every_group_and_target():
    scene = ws.Scene.load("two_cameras")
    found = [change for change in changes(scene.scenario, "narrow") if change.label.startswith("pointed")]
    assert [change.label for change in found] == [
        "pointed at (sat1?, sat2?, sat3?)",
        "pointed at from 0 s (all)",
        "pointed at from 600 s (all)",
    ]
    for change in found:
        assert {"main", "group", *scene.scenario.group_names, *scene.target_names} == set(change.options)
    assert not [label for label in labels(scene, "wide") if label.startswith("pointed")]
    second = with_values(scene, "narrow", sensors__1__pointing__0__track="second")
    assert second.sensors[1].pointing[0].track == "second"


CHANGED = {
    "fov_deg": ("camera__fov_deg", "2", 2.0),
    "aperture": ("optics__aperture_m", "0.3", 0.3),
    "smear": ("optics__smear_urad", "90", 90.0),
    "nei": ("detector__nei_w_cm2", "4e-18", 4e-18),
    "exposure": ("detector__exposure_s", "0.5", 0.5),
    "pointing": ("pointing__0__track", "cone03", "cone03"),
    "psf": ("optics__psf", "gaussian", "gaussian"),
}


@pytest.mark.parametrize("every", [4, slow(1)])
@pytest.mark.ci
def test_each_control_renders_its_scene_at_once(renderer, scene, every):
    """One after the other, on one page: the counts are those of the scene with all of them."""
    with ws.view(renderer, port=0, sensors=SENSORS, band="A") as page:
        page.show(60)
        controls, wanted = page._scene_controls, {}
        for path, typed, value in [*CHANGED.values(), ("optics__sigma_px", "2.5", 2.5), ("seed", 7, 7)][::every]:
            wanted[path] = value
            controls.fields[path if path == "seed" else NUMBER + path].value = typed
            changed = scene.replace(**wanted)
            assert until(lambda changed=changed: page.scenario.scene.to_dict() == changed.to_dict()), path
            counts = ws.Renderer(changed, "cpu").render([60], SENSORS, "A").counts.numpy()[0, :, 0]
            assert until(lambda counts=counts: np.array_equal([image.counts for image in page.shown], counts)), path
        assert not page.status.notes["scene"]
        assert page._groups._scenario is page.scenario is page._globe.scenario


@pytest.mark.ci
def test_what_the_scene_refuses_is_said_and_the_scene_stays(renderer, scene):
    with ws.view(renderer, port=0, sensors=SENSORS) as page:
        fields, before = page._scene_controls.fields, page.images
        for path, typed, words in (
            ("optics__aperture_m", "1e9", "must"),
            ("camera__fov_deg", "wide", "must be a number"),
            ("detector__nei_w_cm2", "0", "must be > 0"),
        ):
            own = fields[NUMBER + path].value
            fields[NUMBER + path].value = typed
            assert until(lambda: page.status.notes.get("scene"))
            problem = page.status.notes["scene"]
            assert words in problem and "\n" not in problem and problem.endswith("; the scene is as before")
            assert until(lambda problem=problem: problem in html.unescape(page._controls.status.content))
            assert page.images is before and page.scenario.scene is scene
            assert fields[NUMBER + path].value == typed  # letters come one by one: nobody writes between them
            fields[NUMBER + path].value = own
            assert until(lambda: not page.status.notes["scene"])


def test_letters_of_a_number_are_awaited(renderer):
    with ws.view(renderer, port=0, sensors=SENSORS) as page:
        field, before = page._scene_controls.fields[NUMBER + "optics__aperture_m"], page.scenario
        for typed in ("", "0", "0.", "0.2", "0.25"):
            field.value = typed
            time.sleep(0.05)
        assert page.scenario is before
        assert until(lambda: page.scenario.scene.optics.aperture_m == 0.25)


@pytest.mark.ci
def test_a_sigma_is_for_gaussians_alone(renderer, scene):
    with ws.view(renderer, port=0, sensors=SENSORS) as page:
        psf, sigma = (page._scene_controls.fields[NUMBER + path] for path in ("optics__psf", "optics__sigma_px"))
        assert sigma.disabled
        psf.value = "gaussian"
        assert until(lambda: not sigma.disabled)
        sigma.value = "2.0"
        assert until(lambda: page.scenario.scene.optics.sigma_px == 2.0)
        psf.value = "airy"
        assert until(lambda: sigma.disabled and sigma.value == "")
        assert page.scenario.scene.to_dict() == scene.to_dict()


@pytest.mark.ci
def test_each_kind_of_sensors_has_its_fields():
    with ws.view(ws.Renderer(ws.Scene.load("visible_to_lwir"), "cpu"), port=0, sensors=["sat11.visible"]) as page:
        controls = page._scene_controls
        assert controls.kind.visible and controls.kind.value == "visible"
        assert "sensors__0__detector__read_noise_e" in controls.fields
        controls.kind.value = "lwir"
        assert until(lambda: "sensors__2__detector__nei_w_cm2" in controls.fields)
        assert all(path == "seed" or path.startswith("sensors__2__") for path in controls.fields)
        controls.fields["sensors__2__camera__fov_deg"].value = "0.7"
        assert until(lambda: page.scenario.scene.sensors[2].camera.fov_deg == 0.7)


@pytest.mark.ci
def test_what_was_typed_is_told_before_another_kind_is_shown():
    """Nothing is lost, and the fields of the other kind are those of the scene with it."""
    with ws.view(ws.Renderer(ws.Scene.load("visible_to_lwir"), "cpu"), port=0, sensors=["sat11.visible"]) as page:
        controls = page._scene_controls
        controls.fields["sensors__0__camera__fov_deg"].value = "0.9"
        controls.fields["seed"].value = 77
        controls.kind.value = "lwir"
        assert until(lambda: "sensors__2__detector__nei_w_cm2" in controls.fields)
        assert page.scenario.scene.sensors[0].camera.fov_deg == 0.9
        assert (page.scenario.scene.seed, controls.fields["seed"].value) == (77, 77)
        controls.fields["sensors__2__camera__fov_deg"].value = "0.7"
        assert until(lambda: page.scenario.scene.sensors[2].camera.fov_deg == 0.7)
        assert page.scenario.scene.seed == 77
