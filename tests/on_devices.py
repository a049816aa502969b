"""Scenes on devices, without a renderer, for tests of single stages; scenes of one kind of sensor."""

from __future__ import annotations

import numpy as np
import warp as wp

from warpsim.render.batch import new_columns, new_inputs
from warpsim.render.buffers import new_sources
from warpsim.render.device_upload import make_device_bodies, make_device_scene
from warpsim.render.stars import load_catalog, star_index
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
