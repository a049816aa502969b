"""Pictures of star catalogs and of the sky; they need matplotlib (the extra `plot`), and draw on axes of your own."""

from warpsim.plot.sky import plot_sky_density as plot_sky_density
from warpsim.plot.sky import plot_sky_partition as plot_sky_partition
from warpsim.plot.sky import plot_star_counts as plot_star_counts
