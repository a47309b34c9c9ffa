#!/usr/bin/python3
"""Reads recording, sensor, results and JSON lines in a folder as somebody who knows only
docs/files.md, and writes theirs.fits: the recording's pixels as a plain cube.
The exit code is 77 if astropy is missing."""

import json
import sys
import warnings

try:
    import numpy as np
    from astropy import units
    from astropy.io import fits
except ImportError:
    sys.exit(77)

warnings.simplefilter("error")
folder = sys.argv[1]
ROWS = COLS = 12
FRAMES = 5


def check_table(hdu, columns):
    for name, (format_, unit) in columns.items():
        column = hdu.columns[name]
        assert column.format == format_, (name, column.format)
        assert (column.unit or "") == unit, (name, column.unit)


with fits.open(f"{folder}/beam.fits") as f:
    f.verify("exception")
    cube = f[0].data
    assert cube.dtype == np.uint16 and cube.shape == (FRAMES, 96, 96), (cube.dtype, cube.shape)
    assert f[0].header["BITPIX"] == 16 and f[0].header["BZERO"] == 32768
    for key in ("PITCH_M FOCAL_M PIXEL_M WAVELEN MAGNIF PARITY EPERADU RDNOISE SATURATE BITDEPTH"
                .split()):
        assert key in f[0].header, key
    check_table(f["FRAMES"], {"SEQUENCE": ("K", ""), "CAMERA_NS": ("K", "ns"),
                              "RECEIVED_NS": ("K", "ns"), "STATUS": ("J", "")})
    check_table(f["TRUTH"], {"FRAME": ("K", ""), "X": ("D", ""), "Y": ("D", ""),
                             "CHARGE": ("J", ""), "SEPARATION": ("D", "")})
    fits.PrimaryHDU(np.array(cube)).writeto(f"{folder}/theirs.fits")

with fits.open(f"{folder}/sensor.fits") as f:
    f.verify("exception")
    header = f[0].header
    assert (header["ROWS"], header["COLS"], header["NX"], header["NY"]) == (ROWS, COLS, 96, 96)
    for key in "ORIGINX ORIGINY P11 P12 P21 P22 PITCHPX ROTDEG LAYOUT PITCH_M WAVELEN".split():
        assert key in header, key
    assert abs(header["PITCHPX"] - 8) < 0.01 and abs(header["ROTDEG"]) < 0.1
    valid = f["VALID"].data
    assert valid.dtype == np.uint8 and valid.shape == (ROWS, COLS)
    for name in ("REFX", "REFY"):
        assert f[name].data.shape == (ROWS, COLS) and f[name].data.dtype.itemsize == 4
        assert f[name].header["BUNIT"] == "pix"
        assert (np.isnan(f[name].data) == (valid == 0)).all()
    assert f["WINDOW"].data.shape == (4, ROWS, COLS)
    assert f["GAIN"].data.shape == (2, ROWS, COLS)

with fits.open(f"{folder}/ours.fits") as f:
    f.verify("exception")
    assert "CREATOR" in f[0].header and "CONFHASH" in f[0].header
    shapes = {"SLOPES": (FRAMES, 2, ROWS, COLS), "SOLENOIDAL": (FRAMES, 2, ROWS, COLS),
              "FLUX": (FRAMES, ROWS, COLS), "PHASE": (FRAMES, ROWS, COLS),
              "CIRCULATION": (FRAMES, ROWS - 1, COLS - 1)}
    for name, shape in shapes.items():
        assert f[name].data.shape == shape, (name, f[name].data.shape)
        units.Unit(f[name].header["BUNIT"])  # Astropy must know the unit.
    assert (np.isnan(f["SLOPES"].data[:, 0]) >= (valid == 0)).all(), "NaN where no lenslet is"
    assert np.isfinite(f["SLOPES"].data[:, :, valid == 1]).mean() > 0.9
    check_table(f["FRAMES"], {"FRAME": ("K", ""), "SEQUENCE": ("K", ""), "CAMERA_NS": ("K", "ns"),
                              "RECEIVED_NS": ("K", "ns"), "STATUS": ("J", ""),
                              "N_VALID": ("J", ""), "N_VORTICES": ("J", ""), "OVERFLOW": ("J", "")})
    check_table(f["VORTICES"], {"FRAME": ("K", ""), "X": ("D", ""), "Y": ("D", ""),
                                "CHARGE": ("J", ""), "CIRCULATION": ("D", "rad"),
                                "SIGNIFICANCE": ("D", ""), "X_PX": ("D", "pix"),
                                "Y_PX": ("D", "pix"), "FLAGS": ("J", ""), "TRACK": ("K", "")})
    check_table(f["HOLES"], {"FRAME": ("K", ""), "HOLE": ("J", ""), "CIRCULATION": ("D", "rad")})
    check_table(f["LATENCY"], {name: ("E", "us") for name in
                               "CENTROID SLOPES SPLIT DETECT PUBLISH TOTAL".split()})
    vortices = f["VORTICES"].data
    assert len(vortices) == FRAMES and (vortices["TRACK"] == -1).all()
    assert len(f["LATENCY"].data) == FRAMES and (f["LATENCY"].data["TOTAL"] > 0).all()
    assert np.allclose(vortices["X_PX"], header["ORIGINX"] + header["P11"] * vortices["X"]
                       + header["P12"] * vortices["Y"])

    def refuse(name):
        raise AssertionError(f"{name} in JSON")

    with open(f"{folder}/ours.jsonl", encoding="utf-8") as lines:
        frames = [json.loads(line, parse_constant=refuse) for line in lines]
    assert [frame["frame"] for frame in frames] == list(range(FRAMES))
    for frame, vortex in zip(frames, vortices):
        assert set(frame) >= {"sequence", "camera_ns", "received_ns", "dropped", "latency_us"}
        assert set(frame["latency_us"]) >= {"centroid", "slopes", "split", "detect", "total"}
        (found,) = frame["vortices"]
        assert abs(found["x"] - vortex["X"]) < 1e-5 and found["charge"] == vortex["CHARGE"]
        assert set(found) >= {"y", "circulation", "significance", "track"}
