"""What does a wide camera find, and what does the narrow one beside it make of that?

    python examples/11_two_cameras.py

Each of 48 satellites (preset `two_cameras`) carries a wide camera of 12 degrees, which looks ahead just above the limb,
and a narrow one of half a degree, which tracks a target. Finds when the wide camera of a satellite sees both groups of
targets while its narrow one tracks, renders all cameras that have access then, and draws what these two see. In the
wide image a group is a spot of a few pixels; in the narrow one it opens as time runs, and it wanders, as the pointing
drifts between updates by the star tracker. With --quick: fewer cameras and images.
"""

import argparse
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

import warpsim as ws

COLOURS = {"first": "#0072B2", "second": "#D55E00"}  # groups
NARROW_S = (-100.0, 0.0, 300.0, 900.0)  # narrow images, after the wide one
DRIFT_STEP_S, N_DRIFT = 0.25, 168
BIN_PX, SPOT_PX, NARROW_PX = 4, 20, 80


def seen_by(scenario: ws.Scenario, kind: str, target: str | None, time_s: np.ndarray) -> np.ndarray:
    """Whether the sensors of a kind can observe a group, or what they track where it is None: (sensor, time)."""
    names = scenario.instruments[kind].names
    seen = np.zeros((len(names), len(time_s)), dtype=bool)
    for row in scenario.access(target, kind):
        seen[names.index(row["sensor"])] |= (time_s >= row["start_s"]) & (time_s <= row["end_s"])
    return seen


def level_nei(frames: ws.FrameSet, frame: int, sensor: str) -> np.ndarray:
    """The image of a sensor in its first band, as signal over the NEI."""
    level = frames.instrument.levels[frames.bands[0]]
    counts = frames.counts.numpy()[frames.frames.index(frame), frames.sensors.index(sensor), 0]
    return (counts.astype(np.float32) - level.blank_counts) / level.counts_per_nei


def show(axes, level: np.ndarray, middle_px, side_px: int, limits_nei: tuple[float, float]):
    """Draw a square part of an image."""
    image = axes.imshow(level, cmap="gray_r", vmin=limits_nei[0], vmax=limits_nei[1], interpolation="nearest")
    (x_px, y_px), half_px = np.rint(middle_px), side_px / 2
    axes.set(xlim=(x_px - half_px, x_px + half_px), ylim=(y_px + half_px, y_px - half_px), xticks=[], yticks=[])
    return image


def main(output: Path, quick: bool = False) -> None:
    """Draw a wide image, narrow ones and the drift of the pointing to `output`."""
    scenario = ws.Scenario(scene := ws.Scene.load("two_cameras"))
    time_s = scenario.instruments["wide"].frame_time_s(np.arange(scene.frames.count))
    both = seen_by(scenario, "narrow", None, time_s)
    for group in COLOURS:
        both &= seen_by(scenario, "wide", group, time_s)
    best = both.sum(axis=1).argmax()
    frame = int(np.median(np.flatnonzero(both[best])))
    wide, narrow = (f"{scenario.satellite_names[best]}.{kind}" for kind in ("wide", "narrow"))
    print(f"{wide} sees both groups while {narrow} tracks in {both[best].sum()} frames; shown: {time_s[frame]:g} s")
    renderer = ws.Renderer(scenario)
    some = [wide, narrow] if quick else scenario.sensor_names
    now = [name for name in some if scenario.has_access(name, time_s[[frame]])[0]]
    for kind in scenario.instruments:
        images = renderer.render([frame], [name for name in now if name.endswith(kind)])
        seen = images.truth[images.truth["access"] & (images.truth["snr"] > 0) & images.truth["in_fov"]]
        for rows in seen.group_by(["sensor", "band"]).groups:
            low, high = np.percentile(rows["snr"], (0, 100))
            print(f"  {rows['sensor'][0]:12} {rows['band'][0]:2} {len(rows):2} targets, SNR {low:.0f} to {high:.0f}")

    wides = renderer.render(range(frame - 8, frame + 9, 8 if quick else 2), [wide])
    later = [frame + round(after_s / scene.frames.interval_s) for after_s in NARROW_S]
    close = renderer.render(later, [narrow], ["A"])
    fast = scene.replace(sensors__1__frames={"start_s": time_s[frame], "interval_s": DRIFT_STEP_S, "count": N_DRIFT})
    drift = ws.Renderer(fast).render(range(N_DRIFT), [narrow], ["A"]).truth
    drift = drift[drift["target"] == "center"]

    figure = plt.figure(figsize=(15, 8.2), layout="constrained")
    left, right = figure.subfigures(1, 2, width_ratios=[1.15, 1])
    axes, level = left.subplots(), level_nei(wides, frame, wide)
    coarse = level.reshape(len(level) // BIN_PX, BIN_PX, -1, BIN_PX).max(axis=(1, 3))
    edges = (-0.5, len(level) - 0.5, len(level) - 0.5, -0.5)
    axes.imshow(coarse, cmap="gray_r", vmin=2.5, vmax=12, interpolation="nearest", extent=edges)
    for (group, colour), at in zip(COLOURS.items(), (0.56, 0.08), strict=True):
        names = next(each.names for each in scene.groups if each.name == group)
        rows = wides.truth[np.isin(wides.truth["target"], names) & wides.truth["access"]]
        track, rows = rows[rows["target"] == names[0]], rows[rows["frame"] == frame]
        axes.plot(track["x_px"], track["y_px"], ".-", color=colour, lw=0.8, ms=4)
        for end in track[[0, -1]]:
            axes.text(end["x_px"], end["y_px"] - 25, f"{end['time_s']:g} s", color=colour, ha="center")
        inset = axes.inset_axes((at, 0.52, 0.36, 0.36))
        show(inset, level, [rows["x_px"].mean(), rows["y_px"].mean()], SPOT_PX, (0.0, 12.0))
        inset.plot(rows["x_px"], rows["y_px"], ".", color=colour, ms=3)
        inset.set_title(f"{group} group: {len(rows)} targets, SNR up to {rows['snr'].max():.0f}", color=colour)
        axes.indicate_inset_zoom(inset, edgecolor=colour, alpha=1)
    axes.set(xlabel="column [px]", ylabel="row [px]")
    axes.set_title(f"{wide}, {time_s[frame]:g} s, B2: brightest of {BIN_PX} x {BIN_PX} px; insets of {SPOT_PX} px")
    grid = right.add_gridspec(3, 2, height_ratios=[1, 1, 0.5])
    panels = [right.add_subplot(grid[number // 2, number % 2]) for number in range(len(later))]
    for axes, number in zip(panels, later, strict=True):
        rows = close.truth[(close.truth["frame"] == number) & close.truth["access"]]
        image = show(axes, level_nei(close, number, narrow), [128, 128], NARROW_PX, (0.0, 30.0))
        axes.scatter(rows["x_px"], rows["y_px"], s=90, facecolors="none", edgecolors=COLOURS["first"], linewidths=0.8)
        axes.plot(127.5, 127.5, "+", color=COLOURS["second"], ms=9)
        axes.set_title(f"{narrow}, {time_s[number]:g} s, {rows['range_km'][0]:.0f} km", fontsize=10)
    right.colorbar(image, ax=panels, shrink=0.8, label=f"signal, band A [NEI]; {NARROW_PX} of 256 px")
    axes = right.add_subplot(grid[2, :])
    for name, style in (("x_px", "k-"), ("y_px", "k:")):
        axes.plot(drift["time_s"], drift[name] - 127.5, style, label=name[0])
    axes.set(xlabel="time [s]", ylabel="offset [px]", title="tracked target from the middle (+) of the narrow image")
    axes.legend(loc="lower right", ncols=2)
    figure.savefig(output, dpi=60 if quick else 110)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("-o", "--output", type=Path, default=Path("11_two_cameras.png"))
    parser.add_argument("--quick", action="store_true", help="small and fast")
    options = parser.parse_args()
    main(options.output, options.quick)
