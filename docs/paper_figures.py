#!/usr/bin/env python3
"""Our version of Figs. 5 to 9 of Chen, Roux and Olivier, J. Opt. Soc. Am. A 24, 1994 (2007).

Everything drawn and printed comes out of the program. Only the paper's appendix, Eq. (A1), is
computed here, to be compared with it.
    paper_figures.py build/release/curlew docs/paper           figures and values, a minute
    paper_figures.py build/release/curlew /tmp/out --quick     without the propagated beams (Fig. 9)
    paper_figures.py build/release/curlew docs/paper --search 1000
                 the numbers the paper reads in its Fig. 9, in so many realisations, 20 minutes
"""
import argparse
import json
import math
import os
import subprocess
import sys
import tempfile
from typing import NamedTuple

try:
    import matplotlib

    matplotlib.use("Agg")
    import matplotlib.pyplot as plt
    import numpy as np
    from astropy.io import fits
    from matplotlib.colors import TwoSlopeNorm
    from matplotlib.lines import Line2D
    from PIL import Image
except ImportError as missing:
    print(f"paper_figures.py: {missing}; install python3-numpy, python3-astropy and "
          "python3-matplotlib", file=sys.stderr)
    sys.exit(77)

FIG7 = (math.pi / 4, math.pi)
FIG8 = (4 * math.pi / 9, math.pi / 2)
ROUND = (0.0, 0.0)
PLUS, MINUS, GREEN, INK, GREY = "#d62728", "#1f5fbf", "#2a8f4f", "#222222", "#8a8a8a"

PEAK_LEVELS = [3.5, 4, 4.4, 4.7, 5, 5.5, 6]

# What the paper reads in its Fig. 9: D of the two vortices of its wide pair and their 3 × 3 sums, and
# D of the positive vortex of its close pair.
PAPER_WIDE_D = (2.95, -3.54)
PAPER_WIDE_SUM = (6.20, -5.86)
PAPER_CLOSE_D = 1.41
# Found by --search: a wide and a close pair and nothing else, as in the paper, and a lone pair whose
# positive vortex reads about 1.41.
BEAM_SEEDS = (188, 502)

plt.rcParams.update({"font.size": 9, "axes.titlesize": 9.5, "axes.edgecolor": GREY,
                     "axes.linewidth": 0.8, "legend.frameon": False, "lines.linewidth": 1.6})


class Curlew:
    """The program, in a scratch folder."""

    def __init__(self, program, folder):
        self.program = os.path.abspath(program)
        self.folder = folder

    def path(self, name):
        return os.path.join(self.folder, name)

    def run(self, *arguments):
        done = subprocess.run([self.program, *map(str, arguments)], cwd=self.folder,
                              capture_output=True, text=True, check=False)
        if done.returncode != 0:
            sys.exit(f"curlew {' '.join(map(str, arguments))}\n{done.stderr}")
        return done.stdout

    def kernel(self, morphology, weight="uniform", extent=1.0, step=0.5):
        """D against the vortex's place, and what `curlew kernel` says of it."""
        said = json.loads(self.run("kernel", "--alpha", repr(morphology[0]), "--beta",
                                   repr(morphology[1]), "--weight", weight, "--extent", extent,
                                   "--step", step, "--json"))
        said["positions"] = np.array(said["positions"])
        said["circulation_rad"] = np.array(said["circulation_rad"])
        return said

    def around_node(self, morphology, extent=1):
        """D of the cells at whole pitches round a vortex on a node."""
        table = self.run("kernel", "--alpha", repr(morphology[0]), "--beta", repr(morphology[1]),
                         "--extent", extent, "--step", 1, "--csv")
        d = [float(line.split(",")[2]) for line in table.splitlines()[1:]]
        return np.array(d).reshape(2 * extent + 1, 2 * extent + 1)

    def peak(self, alpha_deg, beta_deg):
        """D of a vortex on a node, averaged uniformly."""
        return self.around_node((math.radians(alpha_deg), math.radians(beta_deg)))[1, 1]


class Sensor:
    """A sensor without noise, windows of ±4 λ/w in pixels of λ/2w, calibrated on a plane wave."""

    WINDOW, BIAS = 16, 100

    def __init__(self, curlew, lenslets):
        self.curlew, self.lenslets = curlew, lenslets
        self.shape = ["--rows", lenslets, "--cols", lenslets, "--window", self.WINDOW,
                      "--photons", 0, "--bits", 16]
        side = lenslets * self.WINDOW
        fits.PrimaryHDU(np.full((side, side), self.BIAS, np.float32)).writeto(
            curlew.path(f"dark{lenslets}.fits"))
        self.simulate("plane", [], f"plane{lenslets}.fits")
        # Without noise the faintest light between the spots would be taken for the frame's level.
        with open(curlew.path("known_level.toml"), "w") as config:
            config.write("[centroid]\nfollow_level = false\n")
        curlew.run("calibrate", f"plane{lenslets}.fits", "--dark", f"dark{lenslets}.fits",
                   "--read-noise-e", 0.01, "--config", "known_level.toml", "--out", f"sensor{lenslets}.fits")

    def simulate(self, preset, options, out):
        self.curlew.run("simulate", "--preset", preset, *self.shape, *options, "--force", "--out", out)

    def circulation(self, recording):
        """D [frames, rows − 1, cols − 1] of a recording."""
        out = "results_" + recording
        self.curlew.run("replay", recording, "--sensor", f"sensor{self.lenslets}.fits",
                        "--config", "known_level.toml", "--save", "circulation", "--force",
                        "--out", out)
        with fits.open(self.curlew.path(out)) as file:
            return np.asarray(file["CIRCULATION"].data, float)

    def vortex(self, morphology, direction=(0, 0), frames=1, amplitude="linear"):
        """D of the middle cell while the vortex moves off its centre, .1 pitch a frame."""
        node = self.lenslets / 2 - 0.5
        alpha, beta = (math.degrees(angle) for angle in morphology)
        self.simulate("vortex", ["--amplitude", amplitude, "--vortex",
                                 f"{node},{node},1,{alpha!r},{beta!r}", "--velocity",
                                 f"{0.1 * direction[0]},{0.1 * direction[1]}", "--frames", frames],
                      "vortex.fits")
        return self.circulation("vortex.fits")

    def node_circulation(self, *arguments, **options):
        middle = self.lenslets // 2 - 1
        return self.vortex(*arguments, **options)[:, middle, middle]


# Drawing ------------------------------------------------------------------------------------------


def save(figure, folder, name):
    """A PNG of few colours, for the repository's sake."""
    path = os.path.join(folder, name)
    figure.savefig(path, dpi=100)
    plt.close(figure)
    few = Image.open(path).convert("RGB").quantize(256, dither=Image.Dither.NONE)
    few.save(path, optimize=True)


def draw_surface(curlew, sensor, folder, number, morphology, title, step):
    """D over positions, and sections with what the simulated sensor reads."""
    uniform = curlew.kernel(morphology, extent=2, step=step)
    weighted = curlew.kernel(morphology, "intensity", extent=2, step=step)
    at = uniform["positions"]
    figure, (plane, section) = plt.subplots(1, 2, figsize=(9, 3.9), constrained_layout=True,
                                            gridspec_kw={"width_ratios": [1, 1.25]})
    picture = plane.imshow(uniform["circulation_rad"], cmap="RdBu_r", extent=(-2, 2, 2, -2),
                           norm=TwoSlopeNorm(0, -0.6, 5.6), interpolation="bilinear")
    lines = plane.contour(at, at, uniform["circulation_rad"], levels=[-0.2, 0, 1, 2, 3, 4, 5],
                          colors=INK, linewidths=0.7)
    plane.clabel(lines, fmt="%g", fontsize=7)
    plane.set(title=f"(a) D(μ, ν), rad; on the node {uniform['peak_rad']:.3f}",
              xlabel="μ, pitches (x)", ylabel="ν, pitches (y)", xticks=range(-2, 3),
              yticks=range(-2, 3))
    figure.colorbar(picture, ax=plane, shrink=0.85, ticks=[-0.5, 0, 1, 2, 3, 4, 5])

    middle = len(at) // 2
    sections = [("middle line, ν = 0", (1, 0), INK, lambda d: (at, d[middle])),
                ("diagonal, ν = μ", (1, 1), PLUS, lambda d: (at * math.sqrt(2), np.diag(d)))]
    if morphology == FIG7:
        sections = [("μ-line, ν = 0", *sections[0][1:]),
                    ("ν-line, μ = 0", (0, 1), GREEN, lambda d: (at, d[:, middle])), sections[1]]
    if morphology == FIG8:
        sections = [("diagonal I, ν = μ", *sections[1][1:]),
                    ("diagonal II, ν = −μ", (1, -1), MINUS,
                     lambda d: (at * math.sqrt(2), np.diag(d[:, ::-1])[::-1])), sections[0]]
    for _, direction, colour, cut in sections:
        distance, d = cut(uniform["circulation_rad"])
        section.plot(distance, d, color=colour)
        distance, d = cut(weighted["circulation_rad"])
        section.plot(distance, d, "--", color=colour, lw=1.1)
        frames = 21
        seen = sensor.node_circulation(morphology, direction, frames)
        steps = 0.1 * math.hypot(*direction) * np.arange(frames)
        section.plot(steps, seen, "o", ms=3, mfc="none", color=colour, mew=0.9)
    section.axhline(0, color=GREY, lw=0.7)
    section.set(title="(b) D along lines through the node", ylabel="D, rad", ylim=(-0.7, 5.7),
                xlabel="r, distance of the vortex from the node, pitches",
                xlim=(0, 2 * math.sqrt(2)))
    handles = [Line2D([], [], color=colour, label=name) for name, _, colour, _ in sections]
    handles += [Line2D([], [], color=GREY, label="uniform average (the paper)"),
                Line2D([], [], color=GREY, ls="--", lw=1.1, label="weighted by intensity"),
                Line2D([], [], color=GREY, ls="", marker="o", ms=3, mfc="none",
                       label="simulated spots, ±4 λ/w")]
    section.legend(handles=handles, fontsize=8)
    figure.suptitle(f"Fig. {number}: {title}", fontsize=10.5)
    save(figure, folder, f"figure{number}.png")
    return uniform


def draw_peaks(curlew, sensor, folder, quick):
    """Fig. 6: D on the node against morphology, over all of it and along three lines."""
    figure, (plane, uniform, weighted) = plt.subplots(
        1, 3, figsize=(10.8, 3.7), constrained_layout=True,
        gridspec_kw={"width_ratios": [1.15, 1, 1]})
    alphas, betas = (30, 60) if quick else (5, 10)  # steps in degrees
    alphas, betas = (np.arange(step / 2, 180 * k, step) for k, step in ((1, alphas), (2, betas)))
    peaks = np.array([[curlew.peak(alpha, beta) for alpha in alphas] for beta in betas])
    picture = plane.imshow(peaks, cmap="RdBu_r", vmin=-2 * math.pi, vmax=2 * math.pi,
                           extent=(0, 180, 0, 360), origin="lower", aspect="auto")
    for side, levels in ((alphas < 90, PEAK_LEVELS), (alphas > 90, [-d for d in PEAK_LEVELS[::-1]])):
        lines = plane.contour(alphas[side], betas, peaks[:, side], levels=levels, colors=INK,
                              linewidths=0.7, linestyles="-")
        plane.clabel(lines, fmt="%g", fontsize=7)
    plane.set(title="(a) D on the node, rad", xlabel="α, degrees", ylabel="β, degrees",
              xticks=range(0, 181, 45), yticks=range(0, 361, 90))
    figure.colorbar(picture, ax=plane, shrink=0.85, ticks=[-6, -4, -2, 0, 2, 4, 6])

    degrees = np.array([0, 30, 60, 80, 89] if quick else
                       [*range(0, 80, 4), 80, 82, 84, 86, 87, 88, 89, 89.9])
    for beta, colour in ((0, INK), (45, GREEN), (90, PLUS)):
        for side in (degrees, 180 - degrees):
            uniform.plot(side, [curlew.peak(a, beta) for a in side], color=colour,
                         label=f"β = {beta}°" if side is degrees else None)
            weighted.plot(side, [curlew.kernel((math.radians(a), math.radians(beta)),
                                               "intensity")["peak_rad"] for a in side],
                          color=colour)
        seen_at = [80] if quick else [0, 15, 30, 45, 60, 70, 80, 85]
        seen = [sensor.node_circulation((math.radians(a), math.radians(beta)))[0] for a in seen_at]
        weighted.plot(seen_at, seen, "o", ms=4, mfc="none", color=colour,
                      label="simulated spots" if beta == 90 else None)
    for level, name in ((math.pi, "π"), (math.pi + 2 * math.log(2), "π + 2 ln 2"),
                        (2 * math.pi, "2π")):
        for sign in (1, -1):
            uniform.axhline(sign * level, color=GREY, lw=0.6, ls=":")
        uniform.annotate(name, (178, level), xytext=(0, 2), textcoords="offset points",
                         fontsize=7.5, color=GREY, ha="right")
    for name, morphology, colour in (("Fig. 7", FIG7, INK), ("Fig. 8", FIG8, PLUS)):
        alpha, peak = math.degrees(morphology[0]), curlew.around_node(morphology)[1, 1]
        uniform.plot(alpha, peak, "s", ms=5, color=colour)
        uniform.annotate(name, (alpha, peak), xytext=(-34, -8 if colour == INK else 3),
                         textcoords="offset points", fontsize=8)
    uniform.set(title="(b) averaged uniformly, as in the paper", xlabel="α, degrees",
                ylabel="D on the node, rad", xlim=(0, 180), ylim=(-7, 7.2),
                xticks=range(0, 181, 45))
    weighted.set(title="(c) weighted by intensity, as centroids are", xlabel="α, degrees",
                 xlim=(0, 180), ylim=(-3.4, 3.4), xticks=range(0, 181, 45))
    uniform.legend(loc="lower left", fontsize=8)
    weighted.legend(loc="lower left", fontsize=8)
    figure.suptitle("Fig. 6: peak circulation against morphology (α = 0 and 180° round, 90° a line)",
                    fontsize=10.5)
    save(figure, folder, "figure6.png")


# Propagated beams ---------------------------------------------------------------------------------


def uniform_circulation(field, samples):
    """D of the paper's sensor on a sampled field: the mean of its wrapped phase steps."""
    def mean_step(axis):
        last = field.shape[axis] - 1  # the step beyond the rim is taken as that before it
        step = np.angle(np.take(field, range(1, last + 1), axis)
                        * np.conj(np.take(field, range(last), axis)))
        step = np.concatenate([step, np.take(step, [last - 1], axis)], axis)
        rows, cols = (side // samples for side in field.shape)
        return step.reshape(rows, samples, cols, samples).mean((1, 3)) * samples

    sx, sy = mean_step(1), mean_step(0)
    return 0.5 * (sx[:-1, :-1] + sx[:-1, 1:] + sy[:-1, 1:] + sy[1:, 1:] - sx[1:, 1:] - sx[1:, :-1]
                  - sy[1:, :-1] - sy[:-1, :-1])


def propagate(sensor, seed):
    """One realisation: field, truth, D through spots and D averaged uniformly."""
    curlew, name = sensor.curlew, f"beam{seed}.fits"
    sensor.simulate("chen2007", ["--seed", seed, "--field-out", "field.fits"], name)
    with fits.open(curlew.path("field.fits")) as file:
        real, imaginary = file[0].data
        samples = file[0].header["SAMPLES"]
    field = real + 1j * imaginary
    truth = fits.getdata(curlew.path(name), "TRUTH")
    circulation = sensor.circulation(name)[0]
    for file in (name, "results_" + name):
        os.remove(curlew.path(file))
    return field, truth, circulation, uniform_circulation(field, samples)


class Read(NamedTuple):
    """What is read off a map of D round a vortex; the charge's sign is taken out."""
    peak: float  # the most of the cell that holds the vortex and the eight round it
    total: float  # the sum of the nine


def read_vortex(d, vortex):
    """None at the rim, where the nine cells are not all there."""
    r, c = math.floor(vortex["Y"]), math.floor(vortex["X"])
    if not (1 <= r < d.shape[0] - 1 and 1 <= c < d.shape[1] - 1):
        return None
    nine = vortex["CHARGE"] * d[r - 1:r + 2, c - 1:c + 2]
    return Read(float(nine.max()), float(nine.sum()))


def opposite_pairs(truth):
    """Pairs of opposite sign, closest first: the vortices' numbers, how far apart they are, and how
    far all else is."""
    place = truth["X"] + 1j * truth["Y"]
    pairs = []
    for i in range(len(truth)):
        for j in range(i + 1, len(truth)):
            if truth["CHARGE"][i] != truth["CHARGE"][j]:
                others = np.delete(place, [i, j])
                rest = min(np.abs(others - place[k]).min(initial=math.inf) for k in (i, j))
                pairs.append((i, j, abs(place[i] - place[j]), rest))
    return sorted(pairs, key=lambda pair: pair[2])


def wide_and_close(truth):
    """The two pairs of a realisation like the paper's: four vortices, of which two opposite ones are
    less than 2 w apart and all others 2 w or more. None for any other."""
    if len(truth) != 4 or truth["CHARGE"].sum() != 0:
        return None
    i, j, close, rest = opposite_pairs(truth)[0]
    k, m = (n for n in range(4) if n not in (i, j))
    wide = math.hypot(truth["X"][k] - truth["X"][m], truth["Y"][k] - truth["Y"][m])
    return ((k, m, wide), (i, j, close)) if close < 2 <= min(wide, rest) else None


def label(axes, vortex, d, lenslets):
    """Writes D and its 3 × 3 sum near a vortex."""
    colour, sign = (PLUS, 1) if vortex["CHARGE"] > 0 else (MINUS, -1)
    r, c = math.floor(vortex["Y"]), math.floor(vortex["X"])
    axes.add_patch(plt.Rectangle((c - 1, r - 1), 3, 3, fill=False, ec=colour, lw=1))
    read = read_vortex(d, vortex)
    y = r - 1.9 if sign > 0 else r + 2.9
    axes.text(np.clip(vortex["X"], 4, lenslets - 5), y,
              f"{sign * read.peak:+.2f}, Σ {sign * read.total:+.2f}".replace("-", "−"),
              ha="center", va="center", fontsize=7.5, color=colour, clip_on=True,
              bbox={"fc": "white", "ec": "none", "alpha": 0.8, "pad": 0.5})


def draw_beams(sensor, folder):
    """Fig. 9: a beam with a wide and a close pair of vortices, and one with a closer pair."""
    figure, rows = plt.subplots(2, 4, figsize=(10.4, 5.9), constrained_layout=True, sharex=True,
                                sharey=True)
    n = sensor.lenslets
    box = (-0.5, n - 0.5, n - 0.5, -0.5)
    found = []
    for axes, seed in zip(rows, BEAM_SEEDS):
        field, truth, spots, uniform = propagate(sensor, seed)
        axes[0].imshow(np.angle(field), cmap="twilight", vmin=-math.pi, vmax=math.pi, extent=box)
        axes[1].imshow(np.abs(field) / np.abs(field).max(), cmap="gray", extent=box)
        for vortex in truth:
            for picture in axes[:2]:
                picture.plot(vortex["X"], vortex["Y"], "o", ms=5, mec="white", mew=1,
                             mfc=PLUS if vortex["CHARGE"] > 0 else MINUS)
        for picture, d in zip(axes[2:], (uniform, spots)):
            picture.imshow(d, cmap="RdBu_r", vmin=-4.5, vmax=4.5, extent=(0, n - 1, n - 1, 0))
            picture.plot(truth["X"], truth["Y"], "x", ms=3.5, color=INK, mew=0.9)
            for vortex in truth:
                label(picture, vortex, d, n)
        axes[0].set_ylabel(f"seed {seed}")
        pairs = wide_and_close(truth) or [opposite_pairs(truth)[0][:3]]
        for name, (i, j, apart) in zip(("wide", "close")[-len(pairs):], pairs):
            for k in sorted((i, j), key=lambda k: -truth["CHARGE"][k]):
                found.append((f"seed {seed} {name}", apart, int(truth["CHARGE"][k]),
                              read_vortex(uniform, truth[k]), read_vortex(spots, truth[k])))
    for picture, title in zip(rows[0], ("(a) phase", "amplitude", "(b) D, uniform average",
                                        "D through spots")):
        picture.set(title=title, xlim=box[:2], ylim=box[2:], xticks=(0, 5, 10, 15),
                    yticks=(0, 5, 10, 15))
    for picture in rows[1]:
        picture.set_xlabel("x, lenslets of 20 mm")
    figure.suptitle("Fig. 9: Gaussian beam after 100 km, Cn² = 4·10⁻¹⁸ m^(−2/3), 10 screens; "
                    "peak D and 3×3 sum Σ, rad", fontsize=10.5)
    save(figure, folder, "figure9.png")
    return found


def draw_readings(lone, close, seeds, folder):
    """What was read in many realisations, with the paper's readings as lines."""
    figure, (peaks, sums, pairs) = plt.subplots(1, 3, figsize=(10, 3.3), constrained_layout=True)
    for axes, column, paper, bins in ((peaks, 0, PAPER_WIDE_D, np.arange(0, 5.6, 0.25)),
                                      (sums, 1, PAPER_WIDE_SUM, np.arange(0, 8.1, 0.25))):
        axes.hist(lone[:, column], bins, color=PLUS, alpha=0.55, label="uniform average")
        axes.hist(lone[:, 2 + column], bins, color=MINUS, alpha=0.45, label="through spots")
        axes.set_ylim(0, 1.35 * axes.get_ylim()[1])  # room for the legend
        for value in paper:
            axes.axvline(abs(value), color=INK, lw=1)
        axes.legend(fontsize=8, loc="upper left")
        axes.set_ylabel("vortices")
    peaks.set(title="vortices 2 w or more from any other", xlabel="peak |D|, rad; lines: 2.95, 3.54")
    sums.set(title="the same", xlabel="|3×3 sum|, rad; lines: 5.86, 6.20")
    pairs.plot(close[:, 0], close[:, 1], "o", ms=3.5, color=PLUS, label="uniform average")
    pairs.plot(close[:, 0], close[:, 2], "o", ms=3.5, mfc="none", color=MINUS, label="through spots")
    pairs.axhline(PAPER_CLOSE_D, color=INK, lw=1)
    pairs.set(title="close pairs, all else 2 w off or more", ylabel="peak D of the positive vortex, rad",
              xlabel="distance between the two, w; line: D = 1.41", xlim=(0, 2), ylim=(-0.3, 5))
    pairs.legend(fontsize=8, loc="upper left")
    figure.suptitle(f"What is read of vortices in {seeds} beams like that of Fig. 9", fontsize=10.5)
    save(figure, folder, "figure9_readings.png")


def print_distribution(name, values, paper):
    least, low, middle, high, most = np.percentile(values, [0, 10, 50, 90, 100])
    print(f"{name}: mean {np.mean(values):.2f} ± {np.std(values) / math.sqrt(len(values)):.2f}, least "
          f"{least:.2f}, 10 % below {low:.2f}, median {middle:.2f}, 10 % above {high:.2f}, most "
          f"{most:.2f}; " + ", ".join(f"{100 * np.mean(values > abs(value)):.0f} % above "
                                      f"{abs(value):.2f}" for value in paper))


def search(sensor, seeds, folder):
    """What many realisations hold, and what is read of their vortices."""
    counts, lone, close, alike = {}, [], [], []
    for seed in range(1, seeds + 1):
        _, truth, spots, uniform = propagate(sensor, seed)
        counts[len(truth)] = counts.get(len(truth), 0) + 1
        reads = [(read_vortex(uniform, vortex), read_vortex(spots, vortex)) for vortex in truth]
        place = truth["X"] + 1j * truth["Y"]
        for k, vortex in enumerate(truth):
            others = np.abs(np.delete(place, k) - place[k])
            if reads[k][0] and vortex["SEPARATION"] >= 2 and others.min(initial=math.inf) >= 2:
                lone.append([*reads[k][0], *reads[k][1]])
        for i, j, apart, rest in opposite_pairs(truth):
            if apart < 2 and rest >= 2 and reads[i][0] and reads[j][0]:
                plus = i if truth["CHARGE"][i] > 0 else j
                close.append([apart, reads[plus][0].peak, reads[plus][1].peak, seed])
        found = wide_and_close(truth)
        if found and all(read[0] for read in reads):
            alike.append(f"seed {seed}: " + "; ".join(
                f"{apart:.2f} w apart, " + " and ".join(
                    f"{truth['CHARGE'][k] * reads[k][0].peak:+.2f} (sum "
                    f"{truth['CHARGE'][k] * reads[k][0].total:+.2f})" for k in (i, j))
                for i, j, apart in found))
    print(f"{seeds} realisations; vortices on the array: " +
          ", ".join(f"{n} in {counts[n]}" for n in sorted(counts)))
    if not lone or not close:
        return
    lone, close = np.array(lone), np.array(close)
    print(f"\n{len(lone)} vortices 2 w or more from any other, the charge's sign taken out:")
    for column, name, paper in ((0, "peak D, uniform average", PAPER_WIDE_D),
                                (2, "peak D, through spots", PAPER_WIDE_D),
                                (1, "3×3 sum, uniform average", PAPER_WIDE_SUM),
                                (3, "3×3 sum, through spots", PAPER_WIDE_SUM)):
        print_distribution(name, lone[:, column], paper)
    print(f"\n{len(close)} opposite pairs less than 2 w apart, all else 2 w off or more:")
    print_distribution("peak D of the positive one, uniform average", close[:, 1], [PAPER_CLOSE_D])
    print_distribution("peak D of the positive one, through spots", close[:, 2], [PAPER_CLOSE_D])
    for low, high in ((0, 0.5), (0.5, 1), (1, 2)):
        some = close[(low <= close[:, 0]) & (close[:, 0] < high)]
        if len(some) > 0:
            print(f"  {low:g} to {high:g} w apart: {len(some)}, uniform average "
                  f"{some[:, 1].min():.2f} to {some[:, 1].max():.2f}, through spots "
                  f"{some[:, 2].min():.2f} to {some[:, 2].max():.2f}")
    apart, uniform, _, seed = close[np.argmin(np.abs(close[:, 1] - PAPER_CLOSE_D))]
    print(f"  nearest to {PAPER_CLOSE_D}: seed {seed:.0f}, {apart:.2f} w apart, {uniform:.2f}")
    print(f"\nas in the paper's Fig. 9, a wide and a close pair and nothing else: {len(alike)}")
    print("\n".join(alike))
    draw_readings(lone, close, seeds, folder)


# The paper's appendix -----------------------------------------------------------------------------


def appendix(morphology, mu, nu, log, arctan):
    """D of Eq. (A1), term for term. Its second half is the first with x and y exchanged. `arctan`
    is of a numerator and a denominator."""
    alpha, beta = morphology
    b, c = math.sin(alpha) * math.sin(beta), math.cos(alpha)

    def half(m, n, a):
        def q(x, y):  # −|u|²
            return log(2 * x * y * b - x * x * (2 - a) - y * y * a)

        d = m * (arctan(m * b - (n + 1) * a, m * c) - arctan(m * b - (n - 1) * a, m * c))
        for sign in (1, -1):
            x = m + sign
            d = d + x / (2 * a) * ((a - sign * b) * arctan(x * b - (n - 1) * a, x * c)
                                   - (a + sign * b) * arctan(x * b - (n + 1) * a, x * c))
            d = d - sign * x * b / a * arctan(n * a - x * b, x * c)
            d = d + sign * x * c / (4 * a) * (q(x, n - 1) + q(x, n + 1) - 2 * q(x, n))
        return d

    minus = 1 - math.sin(alpha) * math.cos(beta)
    return half(mu, nu, minus) + half(nu, mu, 2 - minus)


def print_appendix(curlew):
    """Eq. (A1) against `curlew kernel`, with the logarithms of magnitudes and as printed."""
    def magnitude(q):
        return np.log(np.abs(q))

    def arctan(numerator, denominator):
        return np.arctan(np.divide(numerator, denominator))

    with np.errstate(all="ignore"):
        worst, undefined, positions = 0.0, 0, 0
        for morphology in (ROUND, FIG7, FIG8, (0.7, 1.0), (2.5, 4.0)):
            ours = curlew.kernel(morphology, extent=2, step=0.07)  # never just ±1
            mu, nu = np.meshgrid(ours["positions"], ours["positions"])
            worst = max(worst, np.abs(appendix(morphology, mu, nu, magnitude, arctan)
                                      - ours["circulation_rad"]).max())
            undefined += np.isnan(appendix(morphology, mu, nu, np.log, arctan)).sum()
            positions += mu.size
        mu, nu = np.array([(x, y) for x in (-1.0, 0.0, 1.0) for y in (-1.0, 0.0, 1.0) if x or y]).T
        corners = np.isnan(appendix(ROUND, mu, nu, magnitude, arctan)).sum()
        print(f"{'Eq. A1 with ln|.|, greatest difference from curlew':62} {'0':>12} {worst:12.1e}")
        print_row("Eq. A1 with ln as printed, % of positions not a number", "0",
                  100 * undefined / positions, 1)
        print_row("Eq. A1 with ln|.|, of 8 corners and middles not a number", "0", corners, 0)
        for name, inverse in (("arctan", arctan), ("atan2", np.arctan2)):
            print_row(f"Eq. A1 with ln|.| and {name} at (.3, .2), alpha .7, beta 1", "-",
                      appendix((0.7, 1.0), 0.3, 0.2, magnitude, inverse))


# The values ---------------------------------------------------------------------------------------


def print_row(name, paper, ours, digits=6):
    print(f"{name:62} {paper:>12} {ours:12.{digits}f}")


def at(kernel, mu, nu):
    """D at a position that is on the map."""
    positions = kernel["positions"]
    col, row = (int(np.argmin(np.abs(positions - p))) for p in (mu, nu))
    assert abs(positions[col] - mu) < 1e-9 and abs(positions[row] - nu) < 1e-9
    return kernel["circulation_rad"][row, col]


def falls_to(kernel, direction, level):
    """How far from the node, in pitches, D has fallen to a level."""
    half = len(kernel["positions"]) // 2
    d = [kernel["circulation_rad"][half + i * direction[1], half + i * direction[0]]
         for i in range(half + 1)]
    i = next(i for i, value in enumerate(d) if value < level)
    steps = i - (level - d[i]) / (d[i - 1] - d[i])
    return steps * kernel["positions"][half + 1] * math.hypot(*direction)


def print_values(curlew, sensor, maps, beams):
    wide = dict(zip(("5", "7", "8"), maps))
    fine = {number: curlew.kernel(morphology, extent=1, step=0.01)
            for number, morphology in (("5", ROUND), ("7", FIG7), ("8", FIG8))}

    def half_width(number, where, direction):
        print_row(f"Fig. {number} distance to half the peak, {where}", "-",
                  falls_to(fine[number], direction, 0.5 * fine[number]["peak_rad"]), 3)

    def least(number, paper):
        minimum = fine[number]["minimum"]
        print_row(f"Fig. {number} least D", paper, minimum["circulation_rad"])
        for axis in ("mu", "nu"):
            print_row(f"Fig. {number} least D, |{axis}|", "1" if number == "5" else "-",
                      abs(minimum[axis]), 4)

    print(f"{'rad, pitches or as said':62} {'paper':>12} {'curlew':>12}")
    print_row("Eq. 8 sum of D over 41 x 41 cells, round core", "6.283185",
              curlew.around_node(ROUND, 20).sum())
    print_row("Eq. 13 w times the mean gradient, D/4", "1.131972", fine["5"]["peak_rad"] / 4)
    print_row("Eq. 14 round core on the node", "4.527887", fine["5"]["peak_rad"])
    print_row("Eq. 16 round core at (1, 1)", "-0.396641", at(fine["5"], 1, 1))
    least("5", "-0.396641")
    for mu, nu in ((1, 0), (1.5, 0), (2, 0), (1.5, 1.5), (2, 2)):
        print_row(f"Fig. 5 at ({mu:g}, {nu:g})", "near 0", at(wide["5"], mu, nu))
    half_width("5", "nu = 0", (1, 0))
    half_width("5", "nu = mu", (1, 1))
    print_row("Fig. 5 mu = nu where D is 0", "never", falls_to(fine["5"], (1, 1), 0) / math.sqrt(2), 4)
    for name, key in (("nearest node", "nearest"), ("2x2 round the lenslet", "2x2"),
                      ("3x3 round the node", "3x3")):
        for end in ("least", "mean", "most"):
            print_row(f"Fig. 5 {name}, {end} over positions",
                      "near 6.28" if key == "2x2" else "-", fine["5"]["sums_rad"][key][end], 4)
    for alpha, sign in ((89.9, ""), (90.1, "-")):
        for beta, paper in ((0, "pi"), (90, "2 pi")):
            print_row(f"Fig. 6 alpha {alpha}, beta {beta}", sign + paper, curlew.peak(alpha, beta))
    print_row("Fig. 6 alpha 180", "4.53", curlew.peak(180, 0))
    for alpha in (15, 45, 80, 89):
        print_row(f"Fig. 6 alpha {alpha}, spread over beta", "-",
                  np.ptp([curlew.peak(alpha, beta) for beta in range(0, 360, 45)]))
    print_row("Fig. 7 peak", "about 4.5", fine["7"]["peak_rad"])
    print_row("Fig. 7 slow axis from +mu towards +nu, degrees", "90", fine["7"]["slow_axis_deg"], 2)
    half_width("7", "nu = 0", (1, 0))
    half_width("7", "mu = 0", (0, 1))
    half_width("7", "nu = mu", (1, 1))
    for mu, nu in ((0.5, 0), (0, 0.5), (1.5, 0), (0, 1.5)):
        print_row(f"Fig. 7 at ({mu:g}, {nu:g})", "-", at(wide["7"], mu, nu))
    least("7", "below 0")
    print_row("Fig. 8 peak", "about 5", fine["8"]["peak_rad"])
    print_row("Fig. 8 slow axis from +mu towards +nu, degrees", "-45", fine["8"]["slow_axis_deg"], 2)
    half_width("8", "nu = 0", (1, 0))
    half_width("8", "nu = mu", (1, 1))
    half_width("8", "nu = -mu", (1, -1))
    for mu, nu in ((0.5, 0.5), (0.5, -0.5)):
        print_row(f"Fig. 8 at ({mu:g}, {nu:g})", "-", at(wide["8"], mu, nu))
    least("8", "-")
    for number in ("7", "8"):
        for end in ("least", "most"):
            print_row(f"Fig. {number} 3x3 round the node, {end} over positions", "-",
                      fine[number]["sums_rad"]["3x3"][end], 4)
    print_appendix(curlew)
    for name, morphology, digits in (("round core", ROUND, 6), ("Fig. 7's core", FIG7, 6),
                                     ("Fig. 8's core", FIG8, 6)):
        print_row(f"intensity-weighted, {name}", "-",
                  curlew.kernel(morphology, "intensity")["peak_rad"], digits)
    nine = curlew.kernel(ROUND, "intensity", extent=1, step=1)["circulation_rad"]
    print_row("intensity-weighted, round core, 3x3 sum", "-", nine.sum(), 4)
    print_row("simulated spots, uniform amplitude", "4.527887",
              sensor.node_circulation(ROUND, amplitude="uniform")[0], 2)
    for name, morphology in (("round core", ROUND), ("Fig. 7's core", FIG7),
                             ("Fig. 8's core", FIG8)):
        print_row(f"simulated spots, {name}", "-", sensor.node_circulation(morphology)[0], 2)
    paper = {("wide", 1): (PAPER_WIDE_D[0], PAPER_WIDE_SUM[0]),
             ("wide", -1): (PAPER_WIDE_D[1], PAPER_WIDE_SUM[1]),
             ("close", 1): (PAPER_CLOSE_D, None)}
    for name, apart, charge, uniform, spots in beams:
        known = paper.get((name.split()[-1], charge), (None, None))
        who = f"Fig. 9 {name}, {apart:.2f} w, {charge:+d}: "
        for what, said, values in (("D", known[0], (uniform.peak, spots.peak)),
                                   ("3x3 sum", known[1], (uniform.total, spots.total))):
            for kind, value in zip(("", ", spots"), values):
                print_row(f"{who}{what}{kind}", "-" if said is None else f"{said:.2f}",
                          charge * value, 2)


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("curlew", help="the program")
    parser.add_argument("out", help="folder for the figures")
    parser.add_argument("--quick", action="store_true", help="coarser, and without Fig. 9")
    parser.add_argument("--search", type=int, metavar="N",
                        help="only look through seeds 1 to N, and draw what is read in them")
    arguments = parser.parse_args()
    os.makedirs(arguments.out, exist_ok=True)
    with tempfile.TemporaryDirectory() as folder:
        curlew = Curlew(arguments.curlew, folder)
        if arguments.search:
            search(Sensor(curlew, 16), arguments.search, arguments.out)
            return
        sensor = Sensor(curlew, 12)
        step = 0.25 if arguments.quick else 0.05
        maps = [draw_surface(curlew, sensor, arguments.out, number, morphology, title, step)
                for number, morphology, title in (
                    (5, ROUND, "round (canonical) vortex"), (7, FIG7, "α = π/4, β = π"),
                    (8, FIG8, "α = 4π/9, β = π/2"))]
        draw_peaks(curlew, sensor, arguments.out, arguments.quick)
        beams = [] if arguments.quick else draw_beams(Sensor(curlew, 16), arguments.out)
        print_values(curlew, sensor, maps, beams)


if __name__ == "__main__":
    main()
