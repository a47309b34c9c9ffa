#!/usr/bin/python3
"""The package `curlew` against files and streams of the program, which $CURLEW_PROGRAM names. The exit code is 77 if numpy or astropy is missing."""

import json
import os
import pathlib
import signal
import subprocess
import sys
import tempfile
import threading
import time
import unittest

try:
    import numpy as np
    from astropy.io import fits
except ImportError:
    sys.exit(77)

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[2] / "python"))
import curlew  # noqa: E402

PROGRAM = os.environ.get("CURLEW_PROGRAM", "build/release/curlew")
ROWS, COLS, FRAMES = 10, 12, 30


def run(folder, *arguments):
    subprocess.run([PROGRAM, *arguments], cwd=folder, check=True, capture_output=True)


class Folder(unittest.TestCase):
    """A folder with a sensor, a recording and its results, made once."""

    @classmethod
    def setUpClass(cls):
        cls.scratch = tempfile.TemporaryDirectory()
        cls.folder = pathlib.Path(cls.scratch.name)
        size = ["--rows", str(ROWS), "--cols", str(COLS), "--window", "8"]
        run(cls.folder, "simulate", "--preset", "plane", *size, "--frames", "10", "--photons", "20000",
            "--bits", "14", "--out", "ref.fits")
        run(cls.folder, "calibrate", "ref.fits", "--out", "sensor.fits")
        run(cls.folder, "simulate", "--preset", "vortex", *size, "--amplitude", "linear",
            "--core-radius", "1.5", "--vortex", "3.4,2.6,+1", "--vortex", "8.7,6.2,-1", "--velocity",
            "0.02,0.01", "--photons", "1500", "--frames", str(FRAMES), "--out", "beam.fits")
        run(cls.folder, "replay", "beam.fits", "--sensor", "sensor.fits", "--track", "--save",
            "slopes,flux,phase,whole_phase,solenoidal,circulation", "--out", "results.fits", "--jsonl",
            "lines.jsonl")

    @classmethod
    def tearDownClass(cls):
        cls.scratch.cleanup()

    def path(self, name):
        return str(self.folder / name)


class Files(Folder):
    def test_a_recording_is_its_frames_and_headers(self):
        recording = curlew.read_recording(self.path("beam.fits"))
        self.assertEqual(len(recording), FRAMES)
        self.assertEqual(recording.frames.dtype, np.dtype("uint16"))
        self.assertTrue(recording.frames.dtype.isnative)
        self.assertEqual(recording.frames.shape[0], FRAMES)
        with fits.open(self.path("beam.fits")) as file:
            np.testing.assert_array_equal(recording.frames, file[0].data)
            np.testing.assert_array_equal(recording.camera_ns, file["FRAMES"].data["CAMERA_NS"])
        np.testing.assert_array_equal(recording.sequence, np.arange(FRAMES))
        self.assertEqual(len(recording.truth), 2 * FRAMES)
        self.assertGreater(recording.optics["PITCH_M"], 0)

    def test_a_recording_without_its_table_is_counted_on(self):
        with fits.open(self.path("beam.fits")) as file:
            file[0].writeto(self.path("bare.fits"), overwrite=True)
            file["FRAMES"].data = file["FRAMES"].data[:3]
            file["FRAMES"].data["SEQUENCE"] = [5, 7, 8]
            file.writeto(self.path("short.fits"), overwrite=True)
        bare = curlew.read_recording(self.path("bare.fits"))
        np.testing.assert_array_equal(bare.sequence, np.arange(FRAMES))
        self.assertFalse(bare.received_ns.any())
        short = curlew.read_recording(self.path("short.fits"))
        np.testing.assert_array_equal(short.sequence[:5], [5, 7, 8, 9, 10])

    def test_a_sensor_says_where_spots_are_and_what_a_pixel_is(self):
        sensor = curlew.read_sensor(self.path("sensor.fits"))
        self.assertEqual(sensor.shape, (ROWS, COLS))
        rows, cols = np.nonzero(sensor.valid)
        spots = sensor.pixel_from_lenslet(cols, rows)
        np.testing.assert_allclose(spots[0], sensor.ref_x_px[rows, cols], atol=0.2)
        np.testing.assert_allclose(spots[1], sensor.ref_y_px[rows, cols], atol=0.2)
        o = sensor.optics
        self.assertAlmostEqual(
            sensor.slope_rad_per_px,
            2 * np.pi * o["PITCH_M"] * o["PIXEL_M"] / (o["WAVELEN"] * o["FOCAL_M"]), places=12)
        self.assertEqual(sensor.window_px.shape, (4, ROWS, COLS))

    def test_results_are_those_of_the_json_lines(self):
        results = curlew.read_results(self.path("results.fits"))
        with open(self.path("lines.jsonl"), encoding="utf-8") as file:
            lines = [json.loads(line) for line in file]
        self.assertEqual(len(results), len(lines))
        self.assertGreater(len(results.vortices), FRAMES)
        for line in lines:
            found = results.vortices_of(line["frame"])
            self.assertEqual(found["X"].astype("f4").tolist(),
                             [np.float32(v["x"]) for v in line["vortices"]])
            self.assertEqual(found["TRACK"].tolist(), [v["track"] for v in line["vortices"]])
        self.assertEqual(results.images["SLOPES"].shape, (FRAMES, 2, ROWS, COLS))
        self.assertEqual(results.images["CIRCULATION"].shape, (FRAMES, ROWS - 1, COLS - 1))
        self.assertEqual(results.units["SLOPES"], "rad")
        self.assertEqual(results.units["VORTICES.CIRCULATION"], "rad")
        self.assertEqual(results.units["LATENCY.TOTAL"], "us")

    def test_tracks_are_vortices_in_the_order_of_frames(self):
        results = curlew.read_results(self.path("results.fits"))
        tracks = results.tracks()
        self.assertGreaterEqual(len(tracks), 2)
        self.assertEqual(sum(map(len, tracks.values())), int((results.vortices["TRACK"] >= 0).sum()))
        for number, track in tracks.items():
            self.assertTrue((track["TRACK"] == number).all())
            self.assertTrue((np.diff(track["FRAME"]) > 0).all())
        longest = max(tracks.values(), key=len)
        self.assertGreater(len(longest), FRAMES // 2)
        self.assertEqual(len(set(longest["CHARGE"])), 1)

    def test_the_example_of_the_documents_runs(self):
        root = pathlib.Path(__file__).resolve().parents[2]
        done = subprocess.run(
            [sys.executable, str(root / "docs" / "python_example.py"), self.path("results.fits"),
             self.path("beam.fits"), self.path("sensor.fits")],
            env=dict(os.environ, PYTHONPATH=str(root / "python")), capture_output=True, text=True)
        self.assertEqual(done.returncode, 0, done.stderr)
        self.assertIn(f"{FRAMES} frames of {COLS} x {ROWS} lenslets", done.stdout)
        self.assertRegex(done.stdout, r"track \d+: charge [+-]1 in")

    def test_what_is_no_such_file_is_said(self):
        with self.assertRaisesRegex(ValueError, "beam.fits is no curlew results file"):
            curlew.read_results(self.path("beam.fits"))
        with self.assertRaisesRegex(ValueError, "beam.fits is no curlew sensor file"):
            curlew.read_sensor(self.path("beam.fits"))
        with self.assertRaisesRegex(ValueError, "holds no frames"):
            curlew.read_recording(self.path("results.fits"))
        with self.assertRaises(OSError):
            curlew.read_results(self.path("missing.fits"))


class Telemetry(Folder):
    """`curlew export --aot`, checked against the table of the format."""

    MANDATORY = ("AOT_TIME", "AOT_ATMOSPHERIC_PARAMETERS", "AOT_ABERRATIONS", "AOT_TELESCOPES",
                 "AOT_SOURCES", "AOT_DETECTORS", "AOT_SCORING_CAMERAS", "AOT_WAVEFRONT_SENSORS",
                 "AOT_WAVEFRONT_CORRECTORS", "AOT_LOOPS")

    def export(self, recording="beam.fits", out="aot.fits", code=0):
        done = subprocess.run(
            [PROGRAM, "export", "--force", "--aot", "results.fits", "--recording", recording, "--sensor",
             "sensor.fits", "--out", out], cwd=self.folder, capture_output=True,
            text=True)
        self.assertEqual(done.returncode, code, done.stderr)
        return done.stderr

    def test_every_hdu_column_reference_and_unit(self):
        self.export()
        with fits.open(self.path("aot.fits")) as file:
            file.verify("exception")
            primary = file[0]
            self.assertIsNone(primary.data)
            self.assertEqual([primary.header[key] for key in ("AOT-VERS", "TIMESYS", "AO-MODE")],
                             ["2.0.0", "UTC", "SCAO"])
            for name in self.MANDATORY:
                self.assertEqual(file[name].columns[0].name, "UID", name)
                for column in file[name].columns:
                    self.assertRegex(column.format, r"^(\d*A|D|K|QD\(\d+\))$", column.name)
            for name in ("AOT_ATMOSPHERIC_PARAMETERS", "AOT_ABERRATIONS", "AOT_SCORING_CAMERAS",
                         "AOT_WAVEFRONT_CORRECTORS", "AOT_LOOPS"):
                self.assertEqual(file[name].header["NAXIS2"], 0, name)
            for table in file:
                if table.name.startswith("AOT_") and table.header["NAXIS2"]:
                    self.check_references(file, table)
            sensor = file["AOT_WAVEFRONT_SENSORS"].data[0]
            lit = curlew.read_sensor(self.path("sensor.fits")).valid
            n = int(lit.sum())
            self.assertEqual((sensor["TYPE"], sensor["DIMENSIONS"], sensor["N_VALID_SUBAPERTURES"]),
                             ("Shack-Hartmann", 2, n))
            self.assertEqual(file["AOT_WAVEFRONT_SENSORS_SHACK_HARTMANN"].data["UID"][0],
                             sensor["UID"])
            self.assertEqual(file["AOT_TELESCOPES"].data["SEGMENT_TYPE"][0], "Monolithic")
            units = {c.name: c.unit for c in file["AOT_WAVEFRONT_SENSORS"].columns}
            self.assertEqual((units["MASK_X_OFFSETS"], units["WAVELENGTH"], units["TYPE"]),
                             ("pix", "m", None))
            self.assertEqual(file["AOT_WAVEFRONT_SENSORS"].columns["DIMENSIONS"].null, -32768)

            slopes = curlew.read_results(self.path("results.fits")).images["SLOPES"]
            np.testing.assert_array_equal(file["MEASUREMENTS"].data, slopes[:, :, lit])
            self.assertEqual(file["MEASUREMENTS"].header["BUNIT"], "rad")
            self.assertEqual(file["REF_MEASUREMENTS"].data.shape, (2, n))
            self.assertLess(np.abs(file["REF_MEASUREMENTS"].data).max(), 0.5)
            self.assertEqual(file["SUBAPERTURE_INTENSITIES"].data.shape, (FRAMES, n))
            mask = file["SUBAPERTURE_MASK"].data
            np.testing.assert_array_equal(mask[lit], np.arange(n))
            self.assertTrue((mask[~lit] == -1).all())
            recording = curlew.read_recording(self.path("beam.fits"))
            np.testing.assert_array_equal(file["PIXEL_INTENSITIES"].data, recording.frames)
            time_row = file["AOT_TIME"].data[0]
            np.testing.assert_array_equal(time_row["FRAME_NUMBERS"], recording.sequence)
            self.assertIn(len(time_row["TIMESTAMPS"]), (0, FRAMES))
            self.assertEqual(len(file["CURLEW_VORTICES"].data),
                             len(curlew.read_results(self.path("results.fits")).vortices))

    def check_references(self, file, table):
        """Everything that is referred to is there."""
        for column in table.columns:
            value = table.data[column.name][0]
            if isinstance(value, str) and value.startswith("INTREF<"):
                image = file[value[len("INTREF<"):-1]]
                self.assertTrue(image.is_image, value)
                reference = image.header.get("TIME_UID")
                if reference is not None:
                    self.assertEqual(reference, f"ROWREF<{file['AOT_TIME'].data['UID'][0]}>")
            elif isinstance(value, str) and value.startswith("ROWREF<"):
                uids = {row["UID"] for other in file if other.name.startswith("AOT_")
                        and other.header["NAXIS2"] for row in other.data}
                self.assertIn(value[len("ROWREF<"):-1], uids)

    def test_files_that_do_not_belong_together_are_refused(self):
        self.assertIn("name the recording that was replayed", self.export(
            recording="ref.fits", code=1))
        self.assertIn("is an input of this run", self.export(
            out="sensor.fits", code=2))


class Streams(Folder):
    """The daemon on a recording, with its streams."""

    def setUp(self):
        config = "[camera]\nframe_rate_hz = 100\n[publish]\nprefix = \"t_\"\nstreams = [" + ", ".join(
            f'"{name}"' for name in ("slopes", "mask", "vortices", "frame")) + "]\n"
        (self.folder / "c.toml").write_text(config, encoding="utf-8")
        own = tempfile.TemporaryDirectory()
        self.addCleanup(own.cleanup)
        self.shm = pathlib.Path(own.name)
        self.environment = dict(os.environ, MILK_SHM_DIR=own.name)
        self.daemon = None

    def tearDown(self):
        if self.daemon is not None:
            self.daemon.kill()
            self.daemon.wait()

    def start(self, camera, *more):
        self.daemon = subprocess.Popen(
            [PROGRAM, "run", "--config", "c.toml", "--camera", camera, *more],
            cwd=self.folder, env=self.environment, stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL)

    def open(self, name):
        for _ in range(500):
            try:
                return curlew.Stream(name, str(self.shm))
            except curlew.StreamError:
                time.sleep(0.02)
        return curlew.Stream(name, str(self.shm))

    def test_live_slopes_are_those_of_replay(self):
        slopes = curlew.read_results(self.path("results.fits")).images["SLOPES"]
        recording = curlew.read_recording(self.path("beam.fits"))
        frames = recording.frames
        # FRAME counts results; on a busy machine they are fewer than the recording's frames.
        row_of = {int(sequence): row for row, sequence in enumerate(recording.sequence)}
        self.start("file:beam.fits", "--sensor", "sensor.fits")
        seen = set()
        # The streams may be a frame apart, so each is compared with the frame that it says it is.
        with self.open("t_slopes") as stream, self.open("t_mask") as masks, self.open(
                "t_frame") as pictures:
            self.assertEqual(stream.data.shape, (ROWS, 2 * COLS))
            while stream.wait(timeout_s=2.0):
                image = stream.read()
                frame = row_of[image.keywords["SEQUENCE"]]
                valid = np.isfinite(slopes[frame])
                x, y = curlew.side_by_side(image.data)
                np.testing.assert_array_equal(x, np.where(valid[0], slopes[frame, 0], 0))
                np.testing.assert_array_equal(y, np.where(valid[1], slopes[frame, 1], 0))
                mask = masks.read()
                np.testing.assert_array_equal(
                    mask.data, np.isfinite(slopes[row_of[mask.keywords["SEQUENCE"]]]).reshape(
                        2, ROWS, COLS).transpose(1, 0, 2).reshape(ROWS, 2 * COLS))
                picture = pictures.read()
                if picture.count:
                    np.testing.assert_array_equal(picture.data, frames[row_of[picture.keywords["SEQUENCE"]]])
                self.assertLess(abs(image.acquired_ns - time.time_ns()), 5e9)
                self.assertGreaterEqual(image.written_ns, image.acquired_ns)
                self.assertEqual(image.keywords["UNIT"], "rad/pitch")
                seen.add(frame)
        self.assertGreater(len(seen), FRAMES // 2)

    def test_vortices_and_threads(self):
        self.start("sim:dipole")
        counts = []

        def follow():
            with self.open("t_vortices") as stream:
                for _ in range(20):
                    self.assertTrue(stream.wait(timeout_s=5.0))
                    image = stream.read()
                    found = curlew.vortices_of(image)
                    counts.append((image.count, len(found), set(found["CHARGE"])))

        threads = [threading.Thread(target=follow) for _ in range(3)]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()
        self.assertEqual(len(counts), 60, "every thread must have had its semaphore")
        self.assertTrue(all(n >= 1 for _, n, _ in counts))
        self.assertTrue(any({1.0, -1.0} <= charges for _, _, charges in counts))

    def test_a_reader_that_dies_leaves_its_semaphore(self):
        self.start("sim:dipole")
        with self.open("t_slopes") as stream:
            self.assertTrue(stream.wait(timeout_s=5.0))
            for _ in range(12):  # more than there are semaphores
                child = os.fork()
                if child == 0:
                    other = curlew.Stream("t_slopes", str(self.shm))
                    other.wait(timeout_s=5.0)
                    os.kill(os.getpid(), signal.SIGKILL)
                os.waitpid(child, 0)
            self.assertTrue(stream.wait(timeout_s=5.0))

    def test_nothing_comes_and_nothing_is_there(self):
        self.start("file:beam.fits", "--sensor", "sensor.fits")
        self.daemon.wait()
        with self.open("t_slopes") as stream:
            begin = time.monotonic()
            self.assertFalse(stream.wait(timeout_s=0.2))
            self.assertLess(time.monotonic() - begin, 5.0)
            with self.assertRaises(ValueError):
                stream.data[0, 0] = 1.0
        with self.assertRaisesRegex(curlew.StreamError, "is its writer running"):
            curlew.Stream("missing", str(self.shm))
        (self.shm / "bad.im.shm").write_bytes(b"1.00" + bytes(2000))
        with self.assertRaisesRegex(curlew.StreamError, "only b'2.00' is read"):
            curlew.Stream("bad", str(self.shm))


if __name__ == "__main__":
    unittest.main()
