"""Figures of scenarios, star catalogs and the sky, with matplotlib (the extra `plot`), on your axes or new ones."""

from warpsim.plot.access_figure import plot_access as plot_access
from warpsim.plot.access_figure import plot_range as plot_range
from warpsim.plot.group_figure import plot_attitudes as plot_attitudes
from warpsim.plot.group_figure import plot_group as plot_group
from warpsim.plot.image_figure import plot_satellite_view as plot_satellite_view
from warpsim.plot.label_figure import plot_labels as plot_labels
from warpsim.plot.partition_figure import plot_sky_partition as plot_sky_partition
from warpsim.plot.scene_figure import plot_ground_tracks as plot_ground_tracks
from warpsim.plot.scene_figure import plot_scene as plot_scene
from warpsim.plot.sky_figure import plot_bands as plot_bands
from warpsim.plot.sky_figure import plot_sky_density as plot_sky_density
from warpsim.plot.sky_figure import plot_star_counts as plot_star_counts
