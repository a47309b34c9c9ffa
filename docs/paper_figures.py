#!/usr/bin/env python3
"""Our version of Figs. 5 to 9 of Chen, Roux and Olivier, J. Opt. Soc. Am. A 24, 1994 (2007).

Everything drawn and printed comes out of the program:
    paper_figures.py build/release/curlew docs/paper           all figures and the table, a minute
    paper_figures.py build/release/curlew /tmp/out --quick     without the propagated beams (Fig. 9)
    paper_figures.py build/release/curlew /tmp/out --search 400
                                   how often cases like Fig. 9 come up, over so many seeds
"""
import argparse
import json
import math
import os
import subprocess
import sys
import tempfile

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
PLUS, MINUS, INK, GREY = "#d62728", "#1f5fbf", "#222222", "#8a8a8a"

# Found by --search over seeds 1 to 400: a pair far from all else, and a close one.
ISOLATED_SEED = 223
DIPOLE_SEED = 36

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
        curlew.run("calibrate", f"plane{lenslets}.fits", "--dark", f"dark{lenslets}.fits",
                   "--read-noise-e", 0.01, "--out", f"sensor{lenslets}.fits")

    def simulate(self, preset, options, out):
        self.curlew.run("simulate", "--preset", preset, *self.shape, *options, "--out", out)

    def circulation(self, recording):
        """D [frames, rows − 1, cols − 1] of a recording."""
        out = "results_" + recording
        self.curlew.run("replay", recording, "--sensor", f"sensor{self.lenslets}.fits",
                        "--save", "circulation", "--out", out)
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


def save(figure, folder, name, colours=128):
    """A PNG of few colours, for the repository's sake."""
    path = os.path.join(folder, name)
    figure.savefig(path, dpi=100)
    plt.close(figure)
    few = Image.open(path).convert("RGB").quantize(colours, dither=Image.Dither.NONE)
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
    plane.set(title=f"Uniform average: D(μ, ν), peak {uniform['peak_rad']:.3f} rad",
              xlabel="μ, pitches (x)", ylabel="ν, pitches (y)", xticks=range(-2, 3),
              yticks=range(-2, 3))
    figure.colorbar(picture, ax=plane, shrink=0.85, label="D, rad",
                    ticks=[-0.5, 0, 1, 2, 3, 4, 5])

    middle = len(at) // 2
    sections = [("ν = 0", (1, 0), INK, lambda d: (at, d[middle])),
                ("ν = +μ", (1, 1), PLUS, lambda d: (at * math.sqrt(2), np.diag(d)))]
    if morphology == FIG7:
        sections.insert(1, ("μ = 0", (0, 1), "#2a8f4f", lambda d: (at, d[:, middle])))
    if morphology == FIG8:
        sections.append(("ν = −μ", (1, -1), MINUS,
                         lambda d: (at * math.sqrt(2), np.diag(d[:, ::-1])[::-1])))
    for name, direction, colour, cut in sections:
        distance, d = cut(uniform["circulation_rad"])
        section.plot(distance, d, color=colour)
        distance, d = cut(weighted["circulation_rad"])
        section.plot(distance, d, "--", color=colour, lw=1.1)
        frames = 21
        seen = sensor.node_circulation(morphology, direction, frames)
        steps = 0.1 * math.hypot(*direction) * np.arange(frames)
        section.plot(steps, seen, "o", ms=3, mfc="none", color=colour, mew=0.9)
    section.axhline(0, color=GREY, lw=0.7)
    section.set(title="Sections through the node", xlabel="distance of the vortex from the node, pitches",
                ylabel="D, rad", xlim=(0, 2.2), ylim=(-0.7, 5.7))
    handles = [Line2D([], [], color=colour, label=name) for name, _, colour, _ in sections]
    handles += [Line2D([], [], color=GREY, label="uniform average (the paper)"),
                Line2D([], [], color=GREY, ls="--", lw=1.1, label="weighted by intensity"),
                Line2D([], [], color=GREY, ls="", marker="o", ms=3, mfc="none",
                       label="simulated spots, ±4 λ/w")]
    section.legend(handles=handles, fontsize=8)
    figure.suptitle(f"Fig. {number}: {title}", fontsize=10.5)
    save(figure, folder, f"figure{number}.png")
    return uniform, weighted


def draw_peaks(curlew, sensor, folder, quick):
    """Fig. 6: D on the node against morphology."""
    degrees = np.array([0, 30, 60, 80, 89] if quick else
                       [*range(0, 80, 4), 80, 82, 84, 86, 87, 88, 89, 89.9])
    figure, (uniform, weighted) = plt.subplots(1, 2, figsize=(9, 3.7), constrained_layout=True,
                                               sharex=True)
    for beta, colour in ((0, INK), (45, "#2a8f4f"), (90, PLUS)):
        for axes, weight in ((uniform, "uniform"), (weighted, "intensity")):
            peaks = [curlew.kernel((math.radians(a), math.radians(beta)), weight)["peak_rad"]
                     for a in degrees]
            label = f"β = {beta}°" + (" (and 180°)" if beta == 0 else "")
            axes.plot(degrees, peaks, color=colour, label=label)
        seen_at = [80] if quick else [0, 15, 30, 45, 60, 70, 80, 85]
        seen = [sensor.node_circulation((math.radians(a), math.radians(beta)))[0] for a in seen_at]
        weighted.plot(seen_at, seen, "o", ms=4, mfc="none", color=colour,
                      label="simulated spots" if beta == 90 else None)
    for level, name in ((math.pi, "π"), (math.pi + 2 * math.log(2), "π + 2 ln 2"),
                        (2 * math.pi, "2π")):
        uniform.axhline(level, color=GREY, lw=0.6, ls=":")
        uniform.annotate(name, (1, level), xytext=(0, 2), textcoords="offset points", fontsize=7.5,
                         color=GREY)
    uniform.plot(45, curlew.kernel(FIG7)["peak_rad"], "s", ms=5, color=INK)
    uniform.annotate("Fig. 7", (45, 4.32), xytext=(-8, -13), textcoords="offset points", fontsize=8)
    uniform.plot(80, curlew.kernel(FIG8)["peak_rad"], "s", ms=5, color=PLUS)
    uniform.annotate("Fig. 8", (80, 5.52), xytext=(-33, 2), textcoords="offset points", fontsize=8)
    uniform.set(title="Averaged uniformly, as in the paper", ylabel="D on the node, rad",
                xlabel="α, degrees", xlim=(0, 90), ylim=(2.9, 6.6))
    weighted.set(title="Weighted by intensity, as a centroid sees it", xlabel="α, degrees",
                 ylim=(0, 3.3))
    uniform.legend(loc="lower left", fontsize=8)
    weighted.legend(loc="lower left", fontsize=8)
    figure.suptitle("Fig. 6: peak circulation against morphology (α = 0 round, 90° a line)",
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
    return field, truth, sensor.circulation(name)[0], uniform_circulation(field, samples)


def round_node(d, x, y):
    """D of the cell that holds (x, y), and of the 3 × 3 round it; None at the rim."""
    r, c = math.floor(y), math.floor(x)
    if not (1 <= r < d.shape[0] - 1 and 1 <= c < d.shape[1] - 1):
        return None
    return d[r, c], d[r - 1:r + 2, c - 1:c + 2].sum()


def opposite_pairs(truth):
    """Pairs of opposite sign that are each other's nearest, with how far all else is."""
    place = [complex(v["X"], v["Y"]) for v in truth]
    pairs = []
    for i, a in enumerate(truth):
        for j in range(i + 1, len(truth)):
            if a["CHARGE"] == truth[j]["CHARGE"]:
                continue
            apart = abs(place[i] - place[j])
            rest = min((min(abs(p - place[i]), abs(p - place[j])) for k, p in enumerate(place)
                        if k not in (i, j)), default=math.inf)
            if rest > apart:
                pairs.append((i, j, apart, rest))
    return pairs


def label(axes, vortices, d, lenslets):
    """Writes D and its 3 × 3 sum near each vortex, where there is room."""
    low, high = (f(v["Y"] for v in vortices) for f in (min, max))
    close = high - low < 3
    for k, vortex in enumerate(vortices):
        colour = PLUS if vortex["CHARGE"] > 0 else MINUS
        r, c = math.floor(vortex["Y"]), math.floor(vortex["X"])
        axes.add_patch(plt.Rectangle((c - 1, r - 1), 3, 3, fill=False, ec=colour, lw=1))
        if close:
            y = high + 3.2 + 1.6 * k if high < lenslets / 2 else low - 4.8 + 1.6 * k
        else:
            y = vortex["Y"] + (3.2 if vortex["Y"] < lenslets - 5 else -3.2)
        near, total = round_node(d, vortex["X"], vortex["Y"])
        axes.text(np.clip(vortex["X"], 5, lenslets - 6), y, f"D {near:+.2f}, Σ {total:+.2f}".replace("-", "−"),
                  ha="center", va="center", fontsize=8, color=colour)


def draw_beams(sensor, folder):
    """Fig. 9: an isolated pair and a close dipole in propagated beams."""
    figure, rows = plt.subplots(2, 4, figsize=(9.6, 5.3), constrained_layout=True, sharex=True,
                                sharey=True)
    found = []
    n = sensor.lenslets
    box = (-0.5, n - 0.5, n - 0.5, -0.5)
    for (bright, phase, flat, spots), seed, name in zip(
            rows, (ISOLATED_SEED, DIPOLE_SEED), ("isolated pair", "close dipole")):
        field, truth, d, uniform = propagate(sensor, seed)
        i, j, apart, _ = min(opposite_pairs(truth), key=lambda pair: pair[2])
        pair = [truth[i], truth[j]]
        bright.imshow(np.abs(field) / np.abs(field).max(), cmap="gray", extent=box)
        phase.imshow(np.angle(field), cmap="twilight", vmin=-math.pi, vmax=math.pi, extent=box)
        for axes, circulation in ((flat, uniform), (spots, d)):
            axes.imshow(circulation, cmap="RdBu_r", vmin=-4.5, vmax=4.5,
                        extent=(0, n - 1, n - 1, 0))
            axes.plot(truth["X"], truth["Y"], "x", ms=4, color=INK, mew=1)
            label(axes, pair, circulation, n)
        for vortex in truth:
            phase.plot(vortex["X"], vortex["Y"], "o", ms=5.5, mec="white", mew=1,
                       mfc=PLUS if vortex["CHARGE"] > 0 else MINUS)
        found += [(name, seed, int(v["CHARGE"]), apart, *round_node(d, v["X"], v["Y"]),
                   *round_node(uniform, v["X"], v["Y"])) for v in pair]
        bright.set_ylabel(f"{name}\n(seed {seed}, {apart:.2f} w apart)")
    for axes, title in zip(rows[0], ("amplitude", "phase, true vortices", "D, uniform average (paper)",
                                     "D through spots")):
        axes.set(title=title, xlim=box[:2], ylim=box[2:], xticks=(0, 5, 10, 15),
                 yticks=(0, 5, 10, 15))
    for axes in rows[1]:
        axes.set_xlabel("x, lenslets of 20 mm")
    figure.suptitle("Fig. 9: Gaussian beam after 100 km, Cn² = 4·10⁻¹⁸ m^(−2/3), 10 screens; "
                    "D in rad, Σ the 3×3 sum", fontsize=10.5)
    save(figure, folder, "figure9.png", 256)
    return found


def search(sensor, seeds):
    """Which of many realisations hold an isolated pair or a close dipole, and what D is typical."""
    counts, isolated, close, lone = {}, [], [], []
    for seed in range(1, seeds + 1):
        name = f"beam{seed}.fits"
        sensor.simulate("chen2007", ["--seed", seed], name)
        truth = fits.getdata(sensor.curlew.path(name), "TRUTH")
        counts[len(truth)] = counts.get(len(truth), 0) + 1
        if len(truth) > 0:
            d = sensor.circulation(name)[0]
            place = truth["X"] + 1j * truth["Y"]
            for k, vortex in enumerate(truth):
                others = np.abs(np.delete(place, k) - place[k])
                values = round_node(d, vortex["X"], vortex["Y"])
                if values and vortex["SEPARATION"] >= 2 and others.min(initial=math.inf) >= 2:
                    lone.append([value * vortex["CHARGE"] for value in values])
            for i, j, apart, rest in opposite_pairs(truth):
                values = [round_node(d, truth[k]["X"], truth[k]["Y"]) for k in (i, j)]
                if None in values or rest < 3 or not (apart >= 2 or 0.3 <= apart <= 1):
                    continue
                line = (f"seed {seed}: {apart:.2f} w apart, all else {rest:.2f} w off; D "
                        f"{values[0][0]:+.2f} {values[1][0]:+.2f}, 3×3 sums {values[0][1]:+.2f} "
                        f"{values[1][1]:+.2f}")
                (isolated if apart >= 2 else close).append(line)
        os.remove(sensor.curlew.path(name))
    print(f"{seeds} realisations; vortices on the array: " +
          ", ".join(f"{n} in {counts[n]}" for n in sorted(counts)))
    if lone:
        mean, error = np.mean(lone, 0), np.std(lone, 0) / math.sqrt(len(lone))
        print(f"{len(lone)} vortices 2 w or more from any other, through spots: D on average "
              f"{mean[0]:.2f} ± {error[0]:.2f}, 3×3 sum {mean[1]:.2f} ± {error[1]:.2f}")
    print(f"\nisolated pairs (2 w apart or more, all else 3 w off): {len(isolated)}")
    print("\n".join(isolated))
    print(f"\nclose dipoles (.3 to 1 w apart, all else 3 w off): {len(close)}")
    print("\n".join(close))


# The table ----------------------------------------------------------------------------------------


def print_row(name, paper, known, ours, digits=6):
    known = "-" if known is None else f"{known:.{digits}f}"
    print(f"{name:58} {paper:>12} {known:>12} {ours:12.{digits}f}")


def at(kernel, mu, nu):
    """D at a position that is on the map."""
    positions = kernel["positions"]
    col, row = (int(np.argmin(np.abs(positions - p))) for p in (mu, nu))
    assert abs(positions[col] - mu) < 1e-9 and abs(positions[row] - nu) < 1e-9
    return kernel["circulation_rad"][row, col]


def print_values(curlew, sensor, maps, beams):
    (round_core, weighted), (fig7, _), (fig8, _) = maps
    print(f"{'rad unless said':58} {'paper':>12} {'known':>12} {'curlew':>12}")
    print_row("Fig. 5 round core on the node: pi + 2 ln 2", "-", 4.527887014709684,
              round_core["peak_rad"])
    print_row("Fig. 5 at (1, 1)", "-", -0.3966410308617583, at(round_core, 1, 1))
    print_row("Fig. 5 least D", "-", -0.4107301049, round_core["minimum"]["circulation_rad"])
    for label, key, low, high in (("nearest node", "nearest", 1.487, 4.528),
                                  ("2x2 round the lenslet", "2x2", 5.728, 5.978),
                                  ("3x3 round the node", "3x3", 6.1249, 6.1371)):
        sums = round_core["sums_rad"][key]
        print_row(f"Fig. 5 {label}, least over positions", "-", low, sums["least"], 4)
        print_row(f"Fig. 5 {label}, most over positions", "-", high, sums["most"], 4)
    print_row("Fig. 6 alpha 89, beta 0", "-", 3.233074,
              curlew.kernel((math.radians(89), 0.0))["peak_rad"])
    print_row("Fig. 6 alpha 89, beta 90", "-", 6.130695,
              curlew.kernel((math.radians(89), math.pi / 2))["peak_rad"])
    print_row("Fig. 7 peak", "about 4.5", 4.319620, fig7["peak_rad"])
    print_row("Fig. 7 at (.5, 0)", "-", 2.670063922, at(fig7, 0.5, 0))
    print_row("Fig. 7 at (0, .5)", "-", 3.049048722, at(fig7, 0, 0.5))
    print_row("Fig. 8 peak", "about 5", 5.524402, fig8["peak_rad"])
    print_row("Fig. 8 at (.5, .5)", "-", 2.427911155, at(fig8, 0.5, 0.5))
    print_row("Fig. 8 at (.5, -.5)", "-", 0.523797650, at(fig8, 0.5, -0.5))
    print_row("Fig. 8 slow axis from +mu towards +nu, degrees", "-", 45.0, fig8["slow_axis_deg"], 2)

    def peak(morphology):
        return curlew.kernel(morphology, "intensity")["peak_rad"]

    print_row("intensity-weighted, round core", "-", 3.0, peak(ROUND))
    cell = list(weighted["positions"])
    nodes = [cell.index(min(cell, key=lambda p: abs(p - n))) for n in (-1, 0, 1)]
    print_row("intensity-weighted, round core, 3x3 sum", "-", 5.7857,
              weighted["circulation_rad"][np.ix_(nodes, nodes)].sum(), 4)
    print_row("intensity-weighted, Fig. 7's core", "-", 2.12, peak(FIG7), 2)
    print_row("intensity-weighted, Fig. 8's core", "-", 1.15, peak(FIG8), 2)
    print_row("simulated spots, uniform amplitude", "-", 4.23,
              sensor.node_circulation(ROUND, amplitude="uniform")[0], 2)
    print_row("simulated spots, round core", "-", 3.04, sensor.node_circulation(ROUND)[0], 2)
    print_row("simulated spots, Fig. 7's core", "-", None, sensor.node_circulation(FIG7)[0], 2)
    print_row("simulated spots, Fig. 8's core", "-", None, sensor.node_circulation(FIG8)[0], 2)
    for name, seed, charge, apart, d, total, flat, flat_total in beams:
        print(f"Fig. 9 {name} (seed {seed}), {apart:.2f} w apart, charge {charge:+d}: through spots "
              f"D {d:+.2f}, 3x3 {total:+.2f}; averaged uniformly D {flat:+.2f}, "
              f"3x3 {flat_total:+.2f}")


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("curlew", help="the program")
    parser.add_argument("out", help="folder for the figures")
    parser.add_argument("--quick", action="store_true", help="coarser, and without Fig. 9")
    parser.add_argument("--search", type=int, metavar="N", help="only look through seeds 1 to N")
    arguments = parser.parse_args()
    os.makedirs(arguments.out, exist_ok=True)
    with tempfile.TemporaryDirectory() as folder:
        curlew = Curlew(arguments.curlew, folder)
        if arguments.search:
            search(Sensor(curlew, 16), arguments.search)
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
