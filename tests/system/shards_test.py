#!/usr/bin/python3
"""A night in shards is the night in one run, bit for bit, whoever starts the workers and whenever one dies.
$CURLEW_PROGRAM names the program. The exit code is 77 if numpy or astropy is missing. mpirun, Dask and Slurm
are used where they are installed; what is skipped says why. CURLEW_NIGHT_FRAMES=20000 makes the night longer,
CURLEW_NIGHT_LENSLETS=16 its frames larger, CURLEW_NIGHT_KILLS=10 kills a worker as often under each of mpirun,
Dask and Slurm, at moments that follow CURLEW_NIGHT_SEED, and CURLEW_NIGHT_FOLDER says where the night is put."""

import json
import os
import pathlib
import random
import shutil
import signal
import socket
import subprocess
import sys
import tempfile
import time
import unittest

try:
    import numpy as np
    from astropy.io import fits
except ImportError:
    sys.exit(77)

PROGRAM = os.path.abspath(os.environ.get("CURLEW_PROGRAM", "build/release/curlew"))
TREE = pathlib.Path(__file__).resolve().parents[2]
SLOW = os.environ.get("CURLEW_SLOW") == "1"  # under a sanitizer
COUNT = int(os.environ.get("CURLEW_NIGHT_LENSLETS", "10"))
PITCH, MARGIN, SIGMA = 10, 10, 1.3
SIDE = COUNT * PITCH + 2 * MARGIN
RAD_PER_PX = 1.98  # of the optics below
FRAMES = int(os.environ.get("CURLEW_NIGHT_FRAMES", "400" if SLOW else "1500"))
KILLS = int(os.environ.get("CURLEW_NIGHT_KILLS", "1"))
SEED = int(os.environ.get("CURLEW_NIGHT_SEED", "11"))
SETTINGS = ["--track", "--method", "whitened", "--save", "slopes,phase,solenoidal,zernike"]


def draw(rng, shift, flux, level, vortices):
    """One frame: round spots on the corners of the grid, moved by a drift and by vortices."""
    row, col = np.mgrid[0:COUNT, 0:COUNT].astype(float)
    dx, dy = np.full_like(row, shift[0]), np.full_like(row, shift[1])
    for x, y, charge in vortices:
        square = (col - x) ** 2 + (row - y) ** 2 + 0.05
        dx -= charge * (row - y) / square / RAD_PER_PX
        dy += charge * (col - x) / square / RAD_PER_PX
    at_x, at_y = MARGIN + 4.5 + PITCH * col + dx, MARGIN + 4.5 + PITCH * row + dy
    axis = np.arange(SIDE)
    along_x = np.exp(-((axis - at_x.reshape(-1, 1)) ** 2) / (2 * SIGMA**2))
    along_y = np.exp(-((axis - at_y.reshape(-1, 1)) ** 2) / (2 * SIGMA**2))
    mean = flux / (2 * np.pi * SIGMA**2) * (along_y.T @ along_x) + level
    noise = rng.standard_normal((SIDE, SIDE)) * np.sqrt(np.maximum(mean, 0) + 4)
    return np.clip(100 + mean + noise, 0, 4095).astype(np.uint16)


def night(frames, seed):
    """Drift over half a pitch, two vortices that wander, light that goes and comes, levels that jump."""
    rng = np.random.default_rng(seed)
    for n in range(frames):
        part = n / frames
        shift = (6.0 * part, -3.0 * np.sin(3 * part))
        flux = 0.0 if 0.40 < part < 0.43 else 3000.0 if part < 0.7 else 900.0
        level = 40.0 if 0.2 < part < 0.35 else 0.0
        x = 2.3 + 3.0 * part
        yield draw(rng, shift, flux, level, [(x, 3.2, 1), (7.4 - x / 3, 6.6, -1)])


def bytes_but_latency(path):
    """All bytes of a results file, with zeros for the latencies."""
    data = bytearray(pathlib.Path(path).read_bytes())
    with fits.open(path) as hdus:
        place = hdus["LATENCY"].fileinfo()
    data[place["datLoc"]:place["datLoc"] + place["datSpan"]] = bytes(place["datSpan"])
    return bytes(data)


class Night(unittest.TestCase):
    """A folder with a sensor, a night of three recordings, and what one run makes of it. Made once."""

    @classmethod
    def setUpClass(cls):
        if hasattr(Night, "scratch"):
            return
        Night.scratch = tempfile.TemporaryDirectory(dir=os.environ.get("CURLEW_NIGHT_FOLDER"))
        Night.folder = pathlib.Path(Night.scratch.name)
        rng = np.random.default_rng(1)
        reference = np.array([draw(rng, (0, 0), 20000.0 / 6, 0.0, []) for _ in range(30)])
        fits.PrimaryHDU(reference).writeto(Night.folder / "ref.fits")
        cls.curlew("calibrate", "ref.fits", "--pitch-um", "100", "--focal-mm", "5", "--pixel-um", "10",
                   "--wavelength-nm", "633", "--e-per-adu", "1", "--read-noise-e", "2", "--saturation-adu",
                   "4095", "--out", "sensor.fits")
        frames = night(FRAMES, 2)
        cuts = [FRAMES // 3, FRAMES // 5, FRAMES - FRAMES // 3 - FRAMES // 5]
        Night.names = []
        for i, n in enumerate(cuts):
            name = f"night{i}.fits"
            fits.PrimaryHDU(np.array([next(frames) for _ in range(n)])).writeto(Night.folder / name)
            Night.names.append(name)
        begin = time.monotonic()
        cls.curlew("replay", *Night.names, "--sensor", "sensor.fits", *SETTINGS, "--out", "one.fits")
        Night.one_run_s = time.monotonic() - begin
        Night.one = bytes_but_latency(Night.folder / "one.fits")

    @classmethod
    def curlew(cls, *arguments, fails=None):
        run = subprocess.run([PROGRAM, *arguments], cwd=Night.folder, capture_output=True, text=True)
        if fails is None and run.returncode != 0:
            raise AssertionError(f"{arguments}: {run.returncode} {run.stderr}")
        if fails is not None:
            if run.returncode == 0 or fails not in run.stderr or run.stderr.count("\n") != 1:
                raise AssertionError(f"{arguments} must fail with '{fails}': {run.returncode} {run.stderr}")
        return run.stdout

    def setUp(self):
        self.out = f"{self.id().rsplit('.', 1)[1]}.fits"
        self.tag = self.out.removesuffix(".fits")

    def command(self, shard, out=None, settings=SETTINGS):
        return ["replay", *self.names, "--sensor", "sensor.fits", *settings, "--out", out or self.out, "--shard",
                shard]

    def shards(self):
        return sorted(str(p) for p in self.folder.glob(f"{self.tag}.shard-*.fits"))

    def done(self, out):
        """The shards that are there, with the times at which they were written."""
        pattern = pathlib.Path(out).with_suffix(".shard-*.fits")
        return {p: p.stat().st_mtime_ns for p in (self.folder / pattern.parent).glob(pattern.name)}

    def kill_a_worker(self, out, chance, seconds=30):
        """Kills one of the processes that work on this night, at a random moment. Returns whether there was one."""
        def workers():
            for process in pathlib.Path("/proc").glob("[0-9]*"):
                try:
                    words = (process / "cmdline").read_bytes().split(b"\0")
                except OSError:
                    continue
                if words[0] == PROGRAM.encode() and out.encode() in words and b"--shard" in words:
                    yield int(process.name)

        until = time.monotonic() + seconds
        while not list(workers()) and time.monotonic() < until:
            time.sleep(0.01)
        time.sleep(chance.uniform(0, 0.7 * Night.one_run_s))  # Two workers take about half as long as one.
        try:
            os.kill(chance.choice(list(workers())), signal.SIGKILL)
        except (IndexError, ProcessLookupError):
            return False
        return True

    def expect_end_by_the_same_command(self, start, wait):
        """However a worker dies, the same command again ends the night, and does no shard that is there again."""
        chance = random.Random(SEED)
        killed = again = kept = 0
        for n in range(3 * KILLS):  # Some moments come when all is done.
            with self.subTest(night=n, seed=SEED):
                out = f"{self.tag}{n}.fits"
                run = start(out)
                killed += self.kill_a_worker(out, chance)
                wait(run)
                before = self.done(out)
                if not (self.folder / out).exists():
                    again += 1
                    kept += len(before)
                    run = start(out)
                    said = wait(run)
                    self.assertTrue((self.folder / out).exists(), said)
                self.assertEqual({p: t for p, t in self.done(out).items() if p in before}, before)
                self.expect_one_run(out)
                for path in [*self.done(out), self.folder / out]:
                    path.unlink()
            if killed == KILLS:
                break
        print(f"{self.tag}, seed {SEED}: {killed} workers killed in {n + 1} nights; {again} nights took the command "
              f"again and kept {kept} shards", file=sys.stderr)

    def expect_one_run(self, out=None):
        self.assertTrue(bytes_but_latency(self.folder / (out or self.out)) == self.one,
                        "the merge must be the bytes of one run")
        self.assertEqual(list(self.folder.glob("*.partial")), [])


class Shards(Night):
    def test_the_night_has_what_it_should(self):
        with fits.open(self.folder / "one.fits") as hdus:
            frames, vortices = hdus["FRAMES"].data, hdus["VORTICES"].data
            self.assertEqual(len(frames), FRAMES)
            self.assertTrue((frames["N_VALID"] == 0).any(), "light is lost")
            self.assertGreater(len(vortices), FRAMES // 2)
            self.assertGreater(len(set(vortices["TRACK"])), 1)

    def test_any_number_of_shards_is_one_run(self):
        for n in (1, 2, 3, 7) if SLOW else (1, 2, 3, 7, 64):
            with self.subTest(shards=n):
                out = f"{self.tag}{n}.fits"
                # The last come first, so that none finds the one before it done.
                for shard in range(n, 0, -1):
                    self.curlew(*self.command(f"{shard}/{n}", out))
                self.curlew(*self.command(f"all/{n}", out))
                self.expect_one_run(out)

    def test_merge_takes_any_order_and_replays_nothing(self):
        for shard in (1, 2, 3):
            self.curlew(*self.command(f"{shard}/3"))
        first, second, third = self.shards()
        self.curlew("merge", third, first, second, "--out", self.out)
        self.expect_one_run()

    def test_without_tracks_too(self):
        settings = ["--method", "circulation"]
        self.curlew(*self.command("all/5", settings=settings))
        self.curlew("replay", *self.names, "--sensor", "sensor.fits", *settings, "--out", "plain.fits")
        self.assertTrue(bytes_but_latency(self.folder / self.out) ==
                        bytes_but_latency(self.folder / "plain.fits"))

    def test_what_is_done_is_not_done_again(self):
        self.curlew(*self.command("2/3"))
        shard = pathlib.Path(self.shards()[0])
        before = shard.stat()
        self.assertIn("is done already", self.curlew(*self.command("2/3")))
        self.assertEqual(shard.stat().st_mtime_ns, before.st_mtime_ns)

    def test_a_killed_worker_leaves_nothing(self):
        chance = random.Random(7)
        for _ in range(3 if SLOW else max(KILLS, 5)):
            worker = subprocess.Popen([PROGRAM, *self.command("2/2")], cwd=self.folder,
                                      stdout=subprocess.DEVNULL)
            time.sleep(chance.uniform(0.02, 0.4))
            worker.kill()
            worker.wait()
        self.curlew(*self.command("all/2"))
        self.expect_one_run()

    def test_bad_shards_are_refused_in_a_sentence_each(self):
        for shard in (1, 2, 3):
            self.curlew(*self.command(f"{shard}/3"))
        first, second, third = self.shards()
        refused = self.folder / "refused.fits"

        def refuses(sentence, *shards):
            self.curlew("merge", *shards, "--out", str(refused), fails=sentence)
            self.assertFalse(refused.exists())

        refuses("shard 2 of 3 is missing", first, third)
        copy = str(self.folder / "copy.fits")
        shutil.copy(second, copy)
        refuses("are both shard 2 of 3", first, second, third, copy)
        data = pathlib.Path(second).read_bytes()
        for bad in (data[:len(data) // 2], data[:-2880], data[:5000]):
            pathlib.Path(copy).write_bytes(bad)
            refuses("copy.fits", first, copy, third)
        for place in (len(data) // 2, 9000, data.rindex(b";1;") + 3):
            pathlib.Path(copy).write_bytes(data[:place] + bytes([data[place] ^ 1]) + data[place + 1:])
            refuses("copy.fits", first, copy, third)
        refuses("is no shard", first, str(self.folder / "one.fits"), third)
        other = ["--false-alarms", "0.5", *SETTINGS]
        self.curlew(*self.command("2/3", "other.fits", other))
        refuses("another configuration", first, str(self.folder / "other.shard-0002-of-0003.fits"), third)
        self.curlew("replay", self.names[0], "--sensor", "sensor.fits", *SETTINGS, "--out", "short.fits",
                    "--shard", "2/3")
        refuses("other recordings", first, str(self.folder / "short.shard-0002-of-0003.fits"), third)
        self.curlew(*self.command("1/2", "halves.fits"))
        refuses("another number of shards", first, second, third,
                str(self.folder / "halves.shard-0001-of-0002.fits"))
        # What is another night's is not replaced unless that is said.
        shutil.move(self.folder / "other.shard-0002-of-0003.fits", second)
        self.curlew(*self.command("2/3"), fails="another configuration")
        self.curlew(*self.command("2/3"), "--force")
        pathlib.Path(second).write_bytes(data[:len(data) // 2])  # What is damaged is done again.
        self.curlew(*self.command("all/3"))
        self.expect_one_run()

    def test_wrong_words_are_refused(self):
        for word, sentence in (("0/3", "count from 1"), ("4/3", "count from 1"), ("3", "must be I/N"),
                               ("x/3", "must be I/N"), ("auto", "needs mpirun or a Slurm array"),
                               (f"1/{FRAMES + 1}", "cannot be cut")):
            self.curlew(*self.command(word), fails=sentence)
        self.curlew(*self.command("1/2"), "--jsonl", "x.jsonl", fails="go with one run")

    def test_an_array_says_which_shard(self):
        def task(number, first, last, count):
            environment = dict(os.environ, SLURM_ARRAY_TASK_ID=str(number), SLURM_ARRAY_TASK_MIN=str(first),
                               SLURM_ARRAY_TASK_MAX=str(last), SLURM_ARRAY_TASK_COUNT=str(count))
            return subprocess.run([PROGRAM, *self.command("auto")], cwd=self.folder, env=environment,
                                  capture_output=True, text=True)

        self.assertIn("shard-0003-of-0003", task(2, 0, 2, 3).stdout)
        self.assertIn("shard-0002-of-0003", task(2, 1, 3, 3).stdout)
        self.assertIn("may be a part of a larger one", task(7, 7, 7, 1).stderr)

    def test_a_full_disk_leaves_nothing_and_the_command_again_ends_the_night(self):
        if os.geteuid() != 0:
            self.skipTest("a small disk is mounted by root")
        disk = self.folder / "disk"
        disk.mkdir()
        if subprocess.run(["mount", "-t", "tmpfs", "none", str(disk)], capture_output=True).returncode != 0:
            self.skipTest("this machine mounts no disk")
        out = str(disk / "full.fits")
        results_kB = (self.folder / "one.fits").stat().st_size // 1024
        there = {}
        try:
            # The first shard, the second and the merge find the disk full. Either shard is half of the results.
            for part, shards_done in ((0.2, 0), (0.8, 1), (1.5, 2)):
                with self.subTest(results_that_fit=part):
                    size = f"remount,size={int(part * results_kB)}k"
                    subprocess.run(["mount", "-o", size, str(disk)], check=True)
                    self.curlew(*self.command("all/2", out), fails="cannot be written")
                    done = self.done(out)
                    self.assertEqual(sorted(disk.iterdir()), sorted(done))
                    self.assertEqual(len(done), shards_done)
                    self.assertEqual({p: t for p, t in done.items() if p in there}, there)
                    there = done
            subprocess.run(["mount", "-o", f"remount,size={4 * results_kB}k", str(disk)], check=True)
            self.curlew(*self.command("all/2", out))
            self.assertEqual(self.done(out), there)
            self.expect_one_run(out)
        finally:
            subprocess.run(["umount", str(disk)], check=True)

    @unittest.skipIf(SLOW, "a sanitizer's memory is not the program's")
    def test_memory_does_not_grow_with_the_night(self):
        # A process that comes of this one would begin with this one's memory, so a small one starts it.
        start = ("import os, sys; process = os.posix_spawn(sys.argv[1], sys.argv[1:], os.environ); "
                 "_, status, used = os.wait4(process, 0); print('kB', used.ru_maxrss); sys.exit(status != 0)")

        def most_memory_kB(*arguments):
            run = subprocess.run([sys.executable, "-S", "-c", start, PROGRAM, *arguments], cwd=self.folder,
                                 capture_output=True, text=True)
            self.assertEqual(run.returncode, 0, run.stderr)
            return int(run.stdout.split()[-1])

        memory = {}
        for times in (2, 16):
            out = f"{self.tag}{times}.fits"
            night = [*(self.names * times), "--sensor", "sensor.fits", *SETTINGS, "--out", out]
            worker = most_memory_kB("replay", *night, "--shard", "1/2")
            self.curlew("replay", *night, "--shard", "2/2")
            shards = [f"{self.tag}{times}.shard-000{i}-of-0002.fits" for i in (1, 2)]
            memory[times] = np.array([worker, most_memory_kB("merge", *shards, "--out", out)])
            size_kB = (self.folder / out).stat().st_size / 1000
        # Tables have up to 1 MB each in memory before they go to disk.
        self.assertGreater(size_kB, 40_000)
        self.assertTrue((memory[16] - memory[2] < 6_000).all(), memory)

    def test_progress_is_told_in_json(self):
        for shard, what, total in ((None, "replay", FRAMES), ("2/3", "shard 2 of 3", FRAMES // 3)):
            command = self.command(shard)[: None if shard else -2]
            run = subprocess.run([PROGRAM, *command, "--progress", "json"], cwd=self.folder,
                                 capture_output=True, text=True, check=True)
            last = json.loads(run.stderr.splitlines()[-1])
            self.assertEqual(last["progress"], what)
            self.assertEqual(last["done"], last["total"])
            self.assertAlmostEqual(last["total"], total, delta=1)
            self.assertGreater(last["seconds"], 0)


class Sweep(Night):
    """Several configurations over one night are the runs that each would be alone, bit for bit."""

    RUNS = {
        "first": "[detect]\nfalse_alarms_per_frame = 0.01\n",
        "rare": "[detect]\nfalse_alarms_per_frame = 0.0001\n",
        "circulation": "[detect]\nmethod = 'circulation'\n[track]\nmin_probability = 0.9\n",
        "higher": "[centroid]\nthreshold_noise = 6\n",
        "higher_too": "[centroid]\nthreshold_noise = 6\n[detect]\nfalse_alarms_per_frame = 1\n",
        "weighted": "[split]\nweighted = true\n",
        "weighted_too": "[split]\nweighted = true\n[detect]\nfalse_alarms_per_frame = 1\n",
        "fixed": "[centroid]\nfollow_windows = false\n",
        "whole": "[split]\nhidden_phase = true\n[detect]\nfalse_alarms_per_frame = 0.1\n",
    }
    SAVED = ["--track", "--save", "slopes,flux,phase,whole_phase,solenoidal,zernike"]

    def write(self, name, runs):
        text = "".join(settings.replace("[", f"[{run}.") for run, settings in runs.items())
        (self.folder / name).write_text(text)

    def alone(self, name, out, saved):
        (self.folder / "alone.toml").write_text(self.RUNS[name])
        self.curlew("replay", *self.names, "--sensor", "sensor.fits", "--config", "alone.toml", *saved,
                    "--out", out)

    def test_every_run_is_what_it_is_alone(self):
        self.write("sweep.toml", self.RUNS)
        said = self.curlew("replay", *self.names, "--sensor", "sensor.fits", *self.SAVED, "--out", self.out,
                           "--sweep", "sweep.toml")
        for name in self.RUNS:
            with self.subTest(run=name):
                self.assertIn(f"{self.tag}.{name}.fits", said)
                self.alone(name, "alone.fits", [*self.SAVED, "--force"])
                self.assertTrue(bytes_but_latency(self.folder / f"{self.tag}.{name}.fits") ==
                                bytes_but_latency(self.folder / "alone.fits"))

    def test_what_is_no_sweep_is_refused(self):
        replay = ["replay", *self.names, "--sensor", "sensor.fits", "--sweep", "bad.toml"]
        for text, said in (("[only.detect]\nfalse_alarms_per_frame = 0.1\n", "from 2 to 100"),
                           ("[a.detect]\n[b.detekt]\n", "unknown section 'detekt'"),
                           ("[a.detect]\n[b.pipeline]\nslots = 3\n", "and not [pipeline]"),
                           ("[a.detect]\n['../b'.detect]\n", "letters, digits, - and _"),
                           ("a = 1\nb = 2\n", "must be a table of sections"),
                           ("[a.detect]\nfalse_alarms_per_frame = 'x'\n[b.detect]\n", "must be a number")):
            with self.subTest(said=said):
                (self.folder / "bad.toml").write_text(text)
                self.curlew(*replay, "--out", self.out, fails=said)
        (self.folder / "bad.toml").write_text("[a.detect]\n[b.detect]\n")
        self.curlew(*replay, fails="--sweep needs --out")
        self.curlew(*replay, "--out", self.out, "--jsonl", "lines", fails="--sweep needs --out")
        self.curlew(*replay, "--out", self.out, "--shard", "1/2", fails="not --shard")
        self.assertEqual(sorted(self.folder.glob(f"{self.tag}*")), [])
        shutil.copy(self.folder / "sensor.fits", self.folder / "own.b.fits")
        self.curlew("replay", *self.names, "--sensor", "own.b.fits", "--sweep", "bad.toml", "--out", "own.fits",
                    "--force", fails="own.b.fits is an input of this run")
        (self.folder / f"{self.tag}.b.fits").write_text("mine")
        self.curlew(*replay, "--out", self.out, fails="--force")
        self.assertEqual((self.folder / f"{self.tag}.b.fits").read_text(), "mine")


@unittest.skipUnless(shutil.which("mpirun"), "openmpi-bin is not installed")
class Mpi(Night):
    def mpirun(self, ranks, out=None):
        environment = dict(os.environ, OMPI_ALLOW_RUN_AS_ROOT="1", OMPI_ALLOW_RUN_AS_ROOT_CONFIRM="1")
        return subprocess.Popen(["mpirun", "--oversubscribe", "-np", str(ranks), PROGRAM,
                                 *self.command("auto", out)],
                                cwd=self.folder, env=environment, stdout=subprocess.PIPE,
                                stderr=subprocess.STDOUT, text=True)

    def test_ranks_do_the_night_and_the_first_merges(self):
        run = self.mpirun(3)
        said, _ = run.communicate(timeout=120)
        self.assertEqual(run.returncode, 0, said)
        self.expect_one_run()

    def test_a_killed_rank_is_made_good_by_the_same_command(self):
        self.expect_end_by_the_same_command(lambda out: self.mpirun(2, out),
                                            lambda run: run.communicate(timeout=120)[0])


try:
    import distributed
except ImportError:
    distributed = None


@unittest.skipUnless(distributed, "python3-distributed is not installed")
class Dask(Night):
    def start(self, out):
        return subprocess.Popen([sys.executable, str(TREE / "docs" / "dask_replay.py"), "--local", "2", "5", out,
                                 PROGRAM, "replay", *self.names, "--sensor", "sensor.fits", *SETTINGS],
                                cwd=self.folder, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True)

    def test_dask_submits_gathers_and_merges(self):
        run = self.start(self.out)
        said, _ = run.communicate(timeout=180)
        self.assertEqual(run.returncode, 0, said)
        self.expect_one_run()

    @unittest.skipIf(KILLS < 2, "CURLEW_NIGHT_KILLS kills workers of Dask; CI kills those of the others")
    def test_killed_workers_are_made_good(self):
        self.expect_end_by_the_same_command(self.start, lambda run: run.communicate(timeout=180)[0])


def free_port():
    with socket.socket() as s:
        s.bind(("127.0.0.1", 0))
        return s.getsockname()[1]


@unittest.skipUnless(all(map(shutil.which, ("slurmctld", "slurmd", "munged", "sbatch"))) and os.geteuid() == 0,
                     "slurmctld, slurmd, slurm-client and munge are not installed, or this is not root")
class Slurm(Night):
    """A cluster of one machine: munged, slurmctld and slurmd of the test's own."""

    def start(self, *command):
        self.daemons.append(subprocess.Popen(command, env=self.environment, stdout=self.log, stderr=self.log))

    def setUp(self):
        super().setUp()
        self.daemons = []
        # Munge wants folders that nobody else can write to.
        self.state = pathlib.Path(tempfile.mkdtemp(prefix="curlew-slurm-", dir="/var/lib"))
        self.log = open(self.state / "log", "w")
        os.chmod(self.state, 0o755)
        host = socket.gethostname().split(".")[0]
        config = self.state / "slurm.conf"
        config.write_text(f"""ClusterName=test
SlurmctldHost={host}(127.0.0.1)
SlurmctldPort={free_port()}
SlurmdPort={free_port()}
SlurmUser=root
AuthType=auth/munge
AuthInfo=socket={self.state}/munge.socket
CryptoType=crypto/munge
StateSaveLocation={self.state}/ctld
SlurmdSpoolDir={self.state}/d
SlurmctldPidFile={self.state}/ctld.pid
SlurmdPidFile={self.state}/d.pid
ProctrackType=proctrack/linuxproc
TaskPlugin=task/none
MpiDefault=none
ReturnToService=2
SchedulerType=sched/backfill
SchedulerParameters=batch_sched_delay=0,sched_interval=1,sched_min_interval=0
SelectType=select/cons_tres
SelectTypeParameters=CR_Core
MinJobAge=30
NodeName={host} NodeAddr=127.0.0.1 CPUs={os.cpu_count()} State=UNKNOWN
PartitionName=all Nodes={host} Default=YES MaxTime=INFINITE State=UP OverSubscribe=YES
""")
        (self.state / "ctld").mkdir()
        (self.state / "d").mkdir()
        key = self.state / "key"
        key.write_bytes(os.urandom(1024))
        os.chmod(key, 0o400)
        self.environment = dict(os.environ, SLURM_CONF=str(config), CURLEW=PROGRAM)
        socket_path = f"{self.state}/munge.socket"
        self.start("munged", "--foreground", "--force", f"--key-file={key}", f"--socket={socket_path}",
                   f"--pid-file={self.state}/munge.pid", f"--log-file={self.state}/munge.log",
                   f"--seed-file={self.state}/munge.seed")
        self.wait_until(lambda: os.path.exists(socket_path), "munged")
        self.start("slurmctld", "-D", "-c", "-f", str(config))
        self.start("slurmd", "-D", "-f", str(config))
        self.wait_until(lambda: "idle" in self.run_tool("sinfo", "-h", "-o", "%T"), "slurmd")

    def tearDown(self):
        for daemon in reversed(self.daemons):
            daemon.terminate()
            try:
                daemon.wait(timeout=10)
            except subprocess.TimeoutExpired:
                daemon.kill()
                daemon.wait()
        self.log.close()
        shutil.rmtree(self.state, ignore_errors=True)

    def run_tool(self, *command):
        return subprocess.run(command, cwd=self.folder, env=self.environment, capture_output=True,
                              text=True).stdout

    def wait_until(self, condition, what, seconds=60):
        until = time.monotonic() + seconds
        while not condition():
            if time.monotonic() > until:
                self.fail(f"{what} does not come: " + (self.state / "log").read_text()[-2000:])
            time.sleep(0.2)

    def submit(self, out=None):
        script = TREE / "packaging" / "slurm" / "curlew-replay.sbatch"
        said = subprocess.run(["bash", str(script), "4", out or self.out, *self.names, "--sensor", "sensor.fits",
                               *SETTINGS], cwd=self.folder, env=self.environment, capture_output=True, text=True)
        self.assertEqual(said.returncode, 0, said.stderr)

    def wait_for_jobs(self, _=None):
        """Waits until no task is left, and drops a merge that waits for one that failed."""
        self.wait_until(lambda: not self.run_tool("squeue", "-h", "-n", "curlew"), "the end of the tasks")
        time.sleep(1)
        for line in self.run_tool("squeue", "-h", "-n", "curlew-merge", "-o", "%i %r").splitlines():
            if "DependencyNeverSatisfied" in line:
                self.run_tool("scancel", line.split()[0])
        self.wait_until(lambda: not self.run_tool("squeue", "-h"), "the end of the jobs")

    def test_an_array_and_its_merge(self):
        self.submit()
        self.wait_for_jobs()
        self.expect_one_run()

    def test_a_lost_task_is_made_good_by_the_same_command(self):
        self.expect_end_by_the_same_command(self.submit, self.wait_for_jobs)

    def test_a_drained_node_only_delays_the_night(self):
        node = self.run_tool("sinfo", "-h", "-o", "%n").strip()
        self.submit()
        self.wait_until(lambda: "R" in self.run_tool("squeue", "-h", "-o", "%t"), "a running task")
        self.run_tool("scontrol", "update", f"NodeName={node}", "State=DRAIN", "Reason=test")
        self.wait_until(lambda: "R" not in self.run_tool("squeue", "-h", "-o", "%t"), "the end of what runs")
        self.assertFalse((self.folder / self.out).exists())
        self.assertIn("PD", self.run_tool("squeue", "-h", "-o", "%t"))
        self.run_tool("scontrol", "update", f"NodeName={node}", "State=RESUME")
        self.wait_for_jobs()
        self.expect_one_run()


if __name__ == "__main__":
    program = unittest.main(verbosity=2, exit=False)
    # CTest takes 77 for skipped, where nothing else was done either.
    result = program.result
    all_skipped = result.testsRun <= len(result.skipped)
    sys.exit(1 if not result.wasSuccessful() else 77 if all_skipped else 0)
