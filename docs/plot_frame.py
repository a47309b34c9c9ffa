#!/usr/bin/env python3
"""Draws one frame: spots, phase, circulation, with the vortices found and the truth.

An example, too, of reading Curlew's files with astropy:
    plot_frame.py RECORDING.fits RESULTS.fits SENSOR.fits --frame 0 --out frame.png
RESULTS.fits must hold the images PHASE, SOLENOIDAL and CIRCULATION (replay --save).
"""
import argparse

import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt
import numpy as np
from astropy.io import fits

PLUS, MINUS = "#d62728", "#1f5fbf"


def mark(axes, vortices, to_axes=lambda x, y: (x, y)):
    for vortex in vortices:
        x, y = to_axes(vortex["X"], vortex["Y"])
        positive = vortex["CHARGE"] > 0
        axes.plot(x, y, "o", ms=15, mfc="none", mec="white", mew=4.0)
        axes.plot(x, y, "o", ms=15, mfc="none", mec=PLUS if positive else MINUS, mew=2.0)
        axes.annotate("+" if positive else "−", (x, y), xytext=(8, 7), textcoords="offset points",
                      color=PLUS if positive else MINUS, fontsize=15, weight="bold",
                      bbox={"boxstyle": "circle,pad=0.05", "fc": "white", "ec": "none", "alpha": 0.85})


def mark_truth(axes, truth, to_axes=lambda x, y: (x, y)):
    for vortex in truth:
        x, y = to_axes(vortex["X"], vortex["Y"])
        axes.plot(x, y, "x", color="black", ms=8, mew=3.0)
        axes.plot(x, y, "x", color="white", ms=7, mew=1.4)


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("recording")
    parser.add_argument("results")
    parser.add_argument("sensor")
    parser.add_argument("--frame", type=int, default=0)
    parser.add_argument("--out", default="frame.png")
    arguments = parser.parse_args()
    n = arguments.frame

    with fits.open(arguments.recording) as file:
        pixels = np.asarray(file[0].data[n], dtype=float)
        truth = [row for row in file["TRUTH"].data if row["FRAME"] == n] if "TRUTH" in file else []
    with fits.open(arguments.results) as file:
        phase = file["PHASE"].data[n]
        solenoidal = file["SOLENOIDAL"].data[n]
        circulation = file["CIRCULATION"].data[n]
        vortices = [row for row in file["VORTICES"].data if row["FRAME"] == n]
    with fits.open(arguments.sensor) as file:
        header = file[0].header

    def to_pixels(x, y):
        return (header["ORIGINX"] + header["P11"] * x + header["P12"] * y,
                header["ORIGINY"] + header["P21"] * x + header["P22"] * y)

    rows, cols = phase.shape
    lenslets = (-0.5, cols - 0.5, rows - 0.5, -0.5)
    figure, (spots, waves, turns) = plt.subplots(1, 3, figsize=(16.5, 5.9), constrained_layout=True)

    low, high = np.percentile(pixels, [1, 99.7])
    spots.imshow(np.sqrt(np.clip(pixels - low, 0, high - low)), cmap="inferno")
    mark_truth(spots, truth, to_pixels)
    mark(spots, vortices, to_pixels)
    spots.set(title="Spots (square root)", xlabel="x, px", ylabel="y, px")

    # cells lie between the lenslets: cell (r, c) is centred at (c + ½, r + ½)
    limit = np.nanmax(np.abs(phase))
    picture = waves.imshow(phase, cmap="RdYlBu_r", vmin=-limit, vmax=limit, extent=lenslets)
    y, x = np.mgrid[0:rows, 0:cols]
    waves.quiver(x, y, solenoidal[0], solenoidal[1], angles="xy", scale_units="xy", scale=1.4,
                 width=0.004, color="black")
    figure.colorbar(picture, ax=waves, shrink=0.82, label="rad")
    mark(waves, vortices)
    waves.set(title="Least-squares phase and what it leaves out", xlabel="x, lenslets",
              xlim=lenslets[:2], ylim=lenslets[2:])

    limit = np.nanmax(np.abs(circulation))
    picture = turns.imshow(circulation, cmap="RdBu_r", vmin=-limit, vmax=limit,
                           extent=(0, cols - 1, rows - 1, 0))
    figure.colorbar(picture, ax=turns, shrink=0.82, label="D, rad")
    mark_truth(turns, truth)
    mark(turns, vortices)
    turns.set(title="Circulation: ○ found, × truth", xlabel="x, lenslets",
              xlim=lenslets[:2], ylim=lenslets[2:])
    for axes in (spots, waves, turns):
        axes.set_aspect("equal")

    positive = sum(v["CHARGE"] > 0 for v in vortices)
    figure.suptitle(f"Frame {n}: {positive} positive and {len(vortices) - positive} negative vortices",
                    fontsize=15)
    figure.savefig(arguments.out, dpi=80)


if __name__ == "__main__":
    main()
