#!/usr/bin/python3
"""The air that `curlew replay --air` measures against the truth of `curlew simulate`, which
$CURLEW_PROGRAM names. The exit code is 77 if numpy or astropy is missing."""

import os
import pathlib
import subprocess
import sys
import tempfile
import unittest

try:
    import numpy as np
    from astropy.io import fits
except ImportError:
    sys.exit(77)

PROGRAM = os.environ.get("CURLEW_PROGRAM", "build/release/curlew")
LENSLETS = 8
FRESNEL = 1.0  # √(λL) in pitches
SIZE = ["--rows", str(LENSLETS), "--cols", str(LENSLETS)]
PATH = ["--preset", "turbulence", "--lenslet", str(1.0 / FRESNEL), "--grid-samples", "16", "--screens", "3",
        "--outer-scale", "1000", "--stray", "neighbours", "--photons", "4000", "--bits", "14", *SIZE]


class AirTest(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.scratch = tempfile.TemporaryDirectory()
        cls.folder = pathlib.Path(cls.scratch.name)
        cls.curlew("simulate", "--preset", "plane", "--frames", "20", "--photons", "20000", "--bits", "14",
                   *SIZE, "--out", "ref.fits")
        cls.curlew("calibrate", "ref.fits", "--out", "sensor.fits")

    @classmethod
    def tearDownClass(cls):
        cls.scratch.cleanup()

    @classmethod
    def curlew(cls, *words):
        subprocess.run([PROGRAM, *words], cwd=cls.folder, check=True, capture_output=True)

    def measured(self, *options):
        """Simulates 100 frames behind turbulent air. Returns the table's only row."""
        self.curlew("simulate", *PATH, "--frames", "100", *options, "--out", "air.fits", "--force")
        self.curlew("replay", "air.fits", "--sensor", "sensor.fits", "--air", "10", "--fresnel", str(FRESNEL),
                    "--out", "results.fits", "--force")
        with fits.open(self.folder / "results.fits") as file:
            rows = file["AIR"].data
            self.assertEqual(len(rows), 1)
            return {name: float(rows[name][0]) for name in rows.names}

    def hold(self, row, name, truth, within):
        """Within the share of the truth that is promised for 500 frames, and four standard errors."""
        value, error = row[name], row["ERR_" + name]
        print(f"{name}: {value:.4g} ± {error:.2g}, in truth {truth:.4g}", flush=True)
        self.assertGreater(error, 0.0)
        self.assertLess(error, 0.1 * abs(truth))
        self.assertLess(abs(value - truth), within * abs(truth) + 4.0 * error)

    def test_frieds_parameter_at_three_strengths_and_scintillation(self):
        for r0 in (1.5, 3.0, 6.0):
            row = self.measured("--r0", str(r0), "--fields-out", "fields.fits")
            self.hold(row, "R0_PITCHES", r0, 0.05)
            with fits.open(self.folder / "fields.fits") as file:
                field = next(hdu.data for hdu in file if hdu.data is not None)
            # [frames, lenslets' rows, points, lenslets' cols, points]
            points = field.shape[2] // LENSLETS
            power = (field.astype(float)**2).sum(axis=1)
            light = power.reshape(len(power), LENSLETS, points, LENSLETS, points).sum(axis=(2, 4))
            index = (light.var(axis=0) / light.mean(axis=0)**2).mean()
            self.hold(row, "SCINTILLATION_INDEX", index, 0.1)
            # Every frame is a realisation of its own.
            self.assertTrue(np.isnan(row["WIND_X_PITCHES_PER_S"]))

    def test_wind(self):
        row = self.measured("--r0", "3", "--wind", "0.25,-0.1")  # pitches a frame, at 1 kHz
        self.hold(row, "WIND_X_PITCHES_PER_S", 250.0, 0.1)
        self.hold(row, "WIND_Y_PITCHES_PER_S", -100.0, 0.1)


if __name__ == "__main__":
    unittest.main(verbosity=1)
