"""Scenes on devices, without a renderer, for tests of single stages; scenes of one kind of sensor."""

import numpy as np
import warp as wp
from warpsim_kernels.emission import RadianceTable, band_radiance_w_m2_sr

from warpsim.render.batch import new_columns, new_inputs
from warpsim.render.buffers import new_sources
from warpsim.render.device_stars import load_catalog, star_index
from warpsim.render.device_upload import make_device_bodies, make_device_scene
from warpsim.render.target_field import make_target_field


def target_field(scene, bands, device="cpu"):
    """The targets of a scene on a device."""
    scenario = scene.scenario
    return make_target_field(scenario, scenario.instrument, bands, wp.get_device(device))


def device_bodies(scene, bands, device="cpu"):
    """What stages without images read."""
    scenario = scene.scenario
    return make_device_bodies(scenario, scenario.instrument, bands, wp.get_device(device))


def device_scene(scene, bands, device="cpu", catalog=None):
    """What all stages read."""
    scenario, where = scene.scenario, wp.get_device(device)
    index = star_index(scene.sky, scenario.epoch, catalog or load_catalog(scene.sky), where)
    return make_device_scene(scenario, scenario.instrument, bands, where, index)


def arrays_of_views(scene, time_s, sensor=0, n_slot=None):
    """Inputs, columns and source lists for stages over views at given times; frames are numbered from 0."""
    n_view = len(time_s)
    inputs = new_inputs(scene.device, time_s, np.arange(n_view), np.broadcast_to(sensor, n_view))
    return inputs, new_columns(scene, n_view), new_sources(scene, n_view, n_slot or scene.n_target)


@wp.kernel(enable_backward=False)
def radiance_kernel(table: RadianceTable, kelvin: wp.array[wp.float64], radiance: wp.array2d[wp.float64]):
    row, i = wp.tid()
    radiance[row, i] = band_radiance_w_m2_sr(table, row, kelvin[i])


def launched(kernel, n, inputs, kinds, device):
    """Outputs of a kernel, one of each kind, as arrays; arrays among the inputs are float64, or vectors of it."""

    def there(value):
        if not isinstance(value, np.ndarray):
            return value
        return wp.array(value, dtype=wp.vec3d if value.ndim > 1 else wp.float64, device=device)

    outputs = [wp.empty(n, dtype=kind, device=device) for kind in kinds]
    wp.launch(kernel, n, inputs=[there(value) for value in inputs], outputs=outputs, device=device)
    return [array.numpy() for array in outputs]
