// The texts that `bench detect --export` writes beside the frames.
#include "service/bench/detection_export.h"

namespace curlew {

const char* const kExportedScorer = R"PY(#!/usr/bin/env python3
"""score.py ENTRY [CELL...]: scores an entry of the benchmark; plain Python, nothing to install.

ENTRY is a folder with two files for each cell: CELL_validation.csv and CELL_test.csv, with the
columns frame,x,y,charge,score. x (column) and y (row) are in lenslets: the centre of lenslet (0,0)
is (0,0). charge is +1 or -1; a larger score means more certainty. See README.md.
"""
import csv
import math
import os
import sys

HERE = os.path.dirname(os.path.abspath(__file__))
HIT_RADIUS = 0.75  # pitches
FALSE_ALARMS = 0.05  # a frame, at which the recall is stated


def read(path):
    with open(path, newline="") as file:
        return list(csv.DictReader(file))


def read_cells():
    cells = {}
    for row in read(os.path.join(HERE, "cells.csv")):
        cells[row["cell"]] = {key: int(row[key]) for key in ("rows", "cols", "validation", "test")}
    return cells


def by_frame(rows, frames):
    lists = [[] for _ in range(frames)]
    for row in rows:
        lists[int(row["frame"])].append(
            {"x": float(row["x"]), "y": float(row["y"]), "charge": int(row["charge"]), **row_extra(row)})
    return lists


def row_extra(row):
    if "score" in row:
        return {"score": float(row["score"])}
    return {"required": row["required"] == "1", "interior": row["interior"] == "1"}


def inside(cell, at):
    return 0.5 <= at["x"] <= cell["cols"] - 1.5 and 0.5 <= at["y"] <= cell["rows"] - 1.5


def judge(cell, candidates, truth):
    """Matches candidates, the surest first, to required vortices of their sign."""
    wanted = [v for v in truth if v["required"] and v["interior"]]
    others = [v for v in truth if not (v["required"] and v["interior"])]
    taken = set()
    verdicts = []
    for c in sorted(candidates, key=lambda c: -c["score"]):
        def apart(v):
            return math.hypot(v["x"] - c["x"], v["y"] - c["y"])
        near = [i for i, v in enumerate(wanted)
                if i not in taken and v["charge"] == c["charge"] and apart(v) <= HIT_RADIUS]
        if near:
            best = min(near, key=lambda i: apart(wanted[i]))
            taken.add(best)
            verdicts.append((c["score"], True, apart(wanted[best])))
        elif inside(cell, c) and not any(
                v["charge"] == c["charge"] and apart(v) <= HIT_RADIUS for v in others):
            verdicts.append((c["score"], False, 0.0))
    return len(wanted), verdicts


def curve(frames):
    """Yields (score, hits, false alarms, squared errors) at every score, from the largest down."""
    verdicts = sorted((v for _, of_frame in frames for v in of_frame), key=lambda v: -v[0])
    hits = alarms = 0
    squares = 0.0
    for i, (score, hit, error) in enumerate(verdicts):
        hits += hit
        alarms += not hit
        squares += error * error
        if i + 1 == len(verdicts) or verdicts[i + 1][0] != score:
            yield score, hits, alarms, squares


def f1(hits, alarms, required):
    return 2.0 * hits / (hits + alarms + required) if hits + alarms + required else 0.0


def score(validation, test):
    required = sum(n for n, _ in validation)
    threshold, best = math.inf, 0.0
    for s, hits, alarms, _ in curve(validation):
        here = f1(hits, alarms, required)
        if here > best:
            threshold, best = s, here
    required = sum(n for n, _ in test)
    figures = {"f1": 0.0, "average_precision": 0.0, "recall": 0.0, "rms": math.nan}
    before = 0
    for s, hits, alarms, squares in curve(test):
        if s >= threshold:
            figures["f1"] = f1(hits, alarms, required)
            figures["rms"] = math.sqrt(squares / hits) if hits else math.nan
        if alarms <= FALSE_ALARMS * len(test) + 1e-9:
            figures["recall"] = hits / required if required else math.nan
        if hits > before:
            figures["average_precision"] += (hits - before) / required * hits / (hits + alarms)
            before = hits
    return required, figures


def main():
    if len(sys.argv) < 2:
        sys.exit(__doc__)
    entry, cells = sys.argv[1], read_cells()
    for name in sys.argv[2:] or cells:
        cell = cells[name]
        judged = {}
        for subset in ("validation", "test"):
            frames = cell[subset]
            truth = by_frame(read(os.path.join(HERE, f"{name}_{subset}_truth.csv")), frames)
            found = by_frame(read(os.path.join(entry, f"{name}_{subset}.csv")), frames)
            judged[subset] = [judge(cell, c, t) for c, t in zip(found, truth)]
        required, figures = score(judged["validation"], judged["test"])
        print(f"{name}: {required} vortices,", ", ".join(f"{k} {v:.4f}" for k, v in figures.items()))


if __name__ == "__main__":
    main()
)PY";

const char* const kExportedReadme = R"(# Optical vortices in Shack-Hartmann frames: a benchmark

These are simulated frames of a Shack-Hartmann sensor behind turbulence, with the true vortices of
each. `score.py` tells how many a method of yours finds, and how many it invents.

| file | holds |
| --- | --- |
| `cells.csv` | the cells: Rytov variance, photons a lenslet (0: no noise), lenslets, numbers of frames |
| `CELL_validation.fits`, `CELL_test.fits` | the frames, 16 bits (BZERO 32768); without noise a cube of floats: the light |
| `CELL_SUBSET_truth.csv` | frame,x,y,charge,required,interior of every vortex |
| `CELL_reference.fits`, `CELL_dark.fits` | frames of a plane wave, and of nothing |
| `whitened/`, `classifier/` | two entries, as examples |
| `score.py` | `python3 score.py whitened` prints the figures of that entry |

**The frames.** Lenslets lie side by side and begin at pixel (0,0): lenslet (row, col) has the
pixels from row·w and col·w on, where w is the number of pixels of a frame over that of lenslets.
The header gives pitch, focal length, pixel and wavelength, the gain EPERADU and the read noise
RDNOISE. The level is 100 ADU. x is the column and grows to the right; y is the row. In lenslet
units the centre of lenslet (0,0) is (0,0), and one pitch is 1. The charge is positive where the
phase grows from +x towards +y. A phase slope of s radians a pitch moves a spot by +s/2π λ/w.

**The rules.** Train on nothing that is here. Choose what is to be chosen on the validation frames.
The scorer takes the threshold that is best for them and applies it to the test frames.
The closest opposite pair under 1 pitch is taken away, again and again; the vortices that remain
are *required*, where they lie at least one pitch from the array's rim (*interior*). A candidate
hits a required vortex of its sign within .75 pitch. One near another true vortex of its sign does
not count, and neither does one at the rim; all others are false alarms.

**The figures.** F1 at the threshold; average precision; recall at .05 false alarms a frame; rms
distance of the hits, in pitches.
)";

}  // namespace curlew
