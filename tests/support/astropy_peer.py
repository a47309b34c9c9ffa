#!/usr/bin/python3
"""Shows what another FITS program makes of our files, and writes files for us to read.

astropy_peer.py describe FILE   one line per HDU, per column and per key of interest
astropy_peer.py recordings DIR  one line per recording in it and below, of the numbered frames of
                                tests/support/numbered_frames.h: what was found in it
astropy_peer.py write DIR       cubes of every type, [3, 5, 7], by the formulas in `cubes`
The exit code is 77 if astropy is missing.
"""

import glob
import sys
import warnings

try:
    import numpy as np
    from astropy.io import fits
except ImportError:
    sys.exit(77)

warnings.simplefilter("error")  # A file that astropy warns of is not a good one.


def describe(path):
    with fits.open(path) as hdus:
        hdus.verify("exception")
        for index, hdu in enumerate(hdus):
            if hdu.is_image:
                shape = "x".join(str(n) for n in hdu.shape)
                stored = hdu._orig_bitpix if hasattr(hdu, "_orig_bitpix") else ""
                kind = hdu.data.dtype.newbyteorder("=").name if hdu.data is not None else "none"
                print(f"hdu {index} {hdu.name} image {kind} [{shape}] bitpix {stored}")
                if hdu.data is not None:
                    print(f"sum {index} {np.nansum(hdu.data.astype(float)):.6f}"
                          f" nan {np.count_nonzero(np.isnan(hdu.data.astype(float)))}")
            else:
                print(f"hdu {index} {hdu.name} table {len(hdu.data)}")
                for column in hdu.columns:
                    values = " ".join(str(v) for v in hdu.data[column.name])
                    print(f"column {column.name} {column.format} {column.unit or '-'}: {values}")
            for card in hdu.header.cards:
                print(f"key {index} {card.keyword} {card.value!r} / {card.comment}")


def recordings(folder):
    for path in sorted(glob.glob(f"{folder}/**/*.fits*", recursive=True)):
        if path.endswith(".partial"):
            continue
        with warnings.catch_warnings(record=True) as caught, fits.open(path) as hdus:
            warnings.simplefilter("always")
            cube = hdus[0].data if hdus[0].data is not None else hdus[1].data
            try:
                table = hdus["FRAMES"]
            except (KeyError, OSError):
                table = None
            if isinstance(table, fits.BinTableHDU):
                rows, sequence = len(table.data), table.data["SEQUENCE"].astype(np.int64)
                hdus.verify("exception")
                assert (table.data["RECEIVED_NS"][:len(cube)] > 0).all()
            else:
                rows, sequence = -1, np.arange(len(cube))
            k = np.arange(cube.shape[1] * cube.shape[2]).reshape(cube.shape[1:])
            wrong = 0
            for n, frame in zip(sequence, cube):
                expected = (n * 7919 + k * 31) % 65536
                wrong += (frame != (expected if frame.dtype == np.uint16 else expected >> 8)).any()
            print(f"recording {path[len(folder) + 1:]} frames {len(cube)} rows {rows}"
                  f" first {sequence[0]} last {sequence[len(cube) - 1]} wrong {wrong}"
                  f" warnings {len(caught) if rows >= 0 else 0}")


def write(folder):
    i = np.arange(3 * 5 * 7).reshape(3, 5, 7)
    cubes = {
        "u8": (i * 2).astype(np.uint8),
        "u16": (65535 - i * 600).astype(np.uint16),
        "i16": (-32768 + i * 600).astype(np.int16),
        "i32": (100000 + i * 7).astype(np.int32),
        "u32": (4000000000 + i * 1000000).astype(np.uint32),
        "i64": (5000000000 + i * 3).astype(np.int64),
        "f32": (0.25 * i - 3).astype(np.float32),
        "f64": i * 100.5,
    }
    for name, cube in cubes.items():
        fits.PrimaryHDU(cube).writeto(f"{folder}/{name}.fits")
        fits.HDUList([
            fits.PrimaryHDU(),
            fits.BinTableHDU.from_columns([fits.Column("A", "K", array=[1, 2])]),
            fits.ImageHDU(cube, name="SCIENCE"),
            fits.ImageHDU(cube[:, :2], name="OTHER"),
        ]).writeto(f"{folder}/{name}_extension.fits")
        if cube.dtype.kind != "f" and name not in ("i64", "u32"):
            fits.HDUList([fits.PrimaryHDU(), fits.CompImageHDU(cube, compression_type="RICE_1")
                          ]).writeto(f"{folder}/{name}_compressed.fits")
    holes = cubes["f32"].copy()
    holes[1, 2, 3] = np.nan
    holes[2, 0, 0] = np.inf
    fits.PrimaryHDU(holes).writeto(f"{folder}/holes.fits")
    fits.HDUList([fits.PrimaryHDU(), fits.CompImageHDU(
        holes, compression_type="GZIP_1", quantize_level=0)]).writeto(
            f"{folder}/holes_compressed.fits")
    scaled = fits.PrimaryHDU(cubes["i16"])
    scaled.header["BSCALE"] = 0.5
    scaled.header["BZERO"] = 100.0
    scaled.writeto(f"{folder}/scaled.fits")
    blank = fits.PrimaryHDU(cubes["i32"])
    blank.header["BLANK"] = 100000
    blank.writeto(f"{folder}/blank.fits")
    fits.PrimaryHDU(cubes["u8"][0]).writeto(f"{folder}/single.fits")
    fits.PrimaryHDU(cubes["u8"].reshape(1, 3, 1, 5, 7)).writeto(f"{folder}/degenerate.fits")


if __name__ == "__main__":
    {"describe": describe, "recordings": recordings, "write": write}[sys.argv[1]](sys.argv[2])
