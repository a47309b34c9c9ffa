#!/usr/bin/python3
"""The live page in a headless Chromium, against JSON lines and results of the same frames.

The program is the one that $CURLEW_PROGRAM names. The exit code is 77 if Chromium, its driver, numpy
or astropy is missing. With $CURLEW_SCREENSHOTS pictures of the page are written into that folder.
"""

import base64
import http.client
import io
import json
import os
import pathlib
import re
import shutil
import signal
import subprocess
import sys
import tempfile
import time
import unittest

try:
    import numpy as np
    from astropy.io import fits

    from browser import Browser, wait_for
except ImportError as missing:
    print(missing)
    sys.exit(77)
if shutil.which("chromium") is None:
    print("chromium is not installed")
    sys.exit(77)

PROGRAM = os.environ.get("CURLEW_PROGRAM", "build/release/curlew")
PICTURES = os.environ.get("CURLEW_SCREENSHOTS", "")
ROWS, COLS, WINDOW, FRAMES = 10, 12, 8, 30
STATES = ["valid", "unlit", "faint", "saturated", "at its window’s edge", "bad pixels", "lost"]


def run(folder, *arguments):
    subprocess.run([PROGRAM, *arguments], cwd=folder, check=True, capture_output=True)


class Served:
    """A curlew that serves a page."""

    def __init__(self, folder, *arguments, says):
        self.log = open(folder / "log", "w+b")
        self.process = subprocess.Popen([PROGRAM, *arguments], cwd=folder, stdout=self.log,
                                        stderr=subprocess.STDOUT)
        wait_for(lambda: says in self.text() or self.process.poll() is not None, 20, says)
        if says not in self.text():
            raise AssertionError(self.text())
        self.url = "http" + self.text().split("http", 1)[1].split()[0]

    def text(self):
        self.log.seek(0)
        return self.log.read().decode()

    def post(self, path, body, **headers):
        host = self.url.split("/")[2]
        connection = http.client.HTTPConnection(host, timeout=10)
        connection.request("POST", path, body, {"Origin": f"http://{host}", **headers})
        answer = connection.getresponse()
        result = answer.status, answer.read().decode()
        connection.close()
        return result

    def close(self):
        self.process.send_signal(signal.SIGINT)
        code = self.process.wait(20)
        self.log.close()
        return code


def signed(value, digits=3):
    return ("−" if value < 0 else "+") + f"{abs(value):.{digits}f}"


def vortex_rows(line):
    """The table of vortices as the page has to show it."""
    return [[signed(v["charge"], 0), f"{v['x']:.3f}", f"{v['y']:.3f}", signed(v["circulation"]),
             f"{v['significance']:.1f}", "–" if v["probability"] is None else f"{v['probability']:.3f}",
             "–" if v["track"] < 0 else str(v["track"])] for v in line["vortices"]]


TABLE = "[...document.querySelectorAll('#vortex-table tr')].slice(1).map(r => [...r.cells].map(c => c.textContent))"


def shown_us(us):
    """Returns a pattern of the time with one decimal. Half a tenth, which the results file holds as a
    rounded number, may be rounded up or down."""
    return "|".join(re.escape(f"{us + by:.1f}") for by in (-0.001, 0.001))


class Page(unittest.TestCase):
    """Brings the browser and finds places on the page."""

    @classmethod
    def setUpClass(cls):
        cls.scratch = tempfile.TemporaryDirectory()
        cls.folder = pathlib.Path(cls.scratch.name)
        cls.browser = Browser()

    @classmethod
    def tearDownClass(cls):
        cls.browser.close()
        cls.scratch.cleanup()

    def place(self, panel, x, y):
        """Where (x, y) of a map is in the window; the map is scrolled into sight."""
        return self.browser.run(f"""(() => {{
            const panel = curlew.panels.find((p) => p.section.id === '{panel}');
            panel.canvas.scrollIntoView({{block: 'center'}});
            const box = panel.canvas.getBoundingClientRect();
            panel.view.place();
            const [sx, sy] = panel.view.toScreen({x}, {y});
            return [box.x + sx, box.y + sy]; }})()""")

    def hovered(self, panel, x, y):
        self.browser.hover(*self.place(panel, x, y))
        return self.browser.text(f"{panel}-readout")

    def picture(self, name, width, height, dark):
        if not PICTURES:
            return
        self.browser.size(width, height)
        self.browser.dark(dark)
        self.browser.run("scrollTo(0, 0)")
        time.sleep(0.4)
        self.browser.picture(os.path.join(PICTURES, name))
        self.browser.size(1280, 800)
        self.browser.dark(False)


class Live(Page):
    def test_the_daemon_shows_its_frames(self):
        (self.folder / "c.toml").write_text(
            '[page]\nlisten = "127.0.0.1:0"\n[camera]\nframe_rate_hz = 200\n'
            '[track]\nenabled = true\n[split]\nhidden_phase = true\n')
        served = Served(self.folder, "run", "--camera", "sim:dipole", "--config", "c.toml", "--jsonl",
                        "lines.jsonl", says="state=streaming")
        browser = self.browser
        browser.open(served.url)
        browser.wait("curlew?.scene.frame?.result.frame > 20 && ['streaming', 'degraded']"
                     ".includes(document.getElementById('state').textContent)")
        first = int(browser.text("frame-number"))
        browser.wait(f"Number(document.getElementById('frame-number').textContent) > {first + 20}")
        k = browser.run("curlew.scene.frame.maps.slope_valid.values.indexOf(1, 100)")
        cols = browser.run("curlew.scene.sensor.cols")
        browser.click(*self.place("phase", k % cols, k // cols))
        self.assertIn(f"row {k // cols}, col {k % cols}", browser.text("lenslet-facts"))
        self.picture("page-dark.png", 1280, 800, True)
        browser.run("curlew.play(false)")
        time.sleep(0.3)
        frame = int(browser.text("frame-number"))
        time.sleep(0.3)
        self.assertEqual(int(browser.text("frame-number")), frame, "paused")
        browser.key(".")
        browser.wait(f"Number(document.getElementById('frame-number').textContent) > {frame}")
        frame = int(browser.text("frame-number"))
        shown = browser.run(TABLE)
        status, why = served.post("/control", '{"set":"centroid.threshold_noise","value":5}')
        self.assertEqual((status, "set control = true" in why), (403, True))
        self.assertEqual(served.close(), 0)
        lines = (self.folder / "lines.jsonl").read_text().splitlines()
        line = next(l for l in map(json.loads, lines) if l["frame"] == frame)
        self.assertEqual(shown, vortex_rows(line))
        self.assertGreater(len(shown), 0)
        vortex = line["vortices"][0]
        text = self.hovered("circulation", vortex["x"], vortex["y"])
        self.assertIn(f"x {vortex['x']:.3f}, y {vortex['y']:.3f}", text)
        self.assertIn(f"D {signed(vortex['circulation'])} rad", text)
        browser.run("curlew.play(true)")
        browser.wait("document.getElementById('state').textContent === 'no connection'")
        self.assertFalse([u for u in browser.urls if not u.startswith("http://127.0.0.1:")])
        self.assertFalse([p for p in browser.problems if "net::ERR" not in p and " 40" not in p])

    def serve_with_control(self, camera, more=""):
        """Starts a daemon whose page may change it, and opens the page. more: of the configuration."""
        (self.folder / "control.toml").write_text(
            '[page]\nlisten = "127.0.0.1:0"\ncontrol = true\n[camera]\nframe_rate_hz = 200\n' + more)
        served = Served(self.folder, "run", "--camera", camera, "--config", "control.toml",
                        says="state=streaming")
        self.browser.open(served.url)
        self.browser.wait("curlew?.scene.sensor && !document.getElementById('control').hidden")
        return served

    def test_control_changes_settings_and_says_who_asked(self):
        served = self.serve_with_control("sim:dipole")
        browser = self.browser
        browser.run("""(() => {
            const input = curlew.control.inputs.get('centroid.threshold_noise').input;
            input.value = '6.5';
            input.dispatchEvent(new Event('change')); })()""")
        browser.wait("curlew.scene.sensor.configuration.includes('threshold_noise = 6.5')")
        browser.wait("document.getElementById('control-answer').textContent.endsWith('done')")
        browser.run("""(() => {
            const input = curlew.control.inputs.get('detect.method').input;
            if (input.value !== 'auto') throw new Error(input.value);
            input.value = 'circulation';
            input.dispatchEvent(new Event('change')); })()""")
        browser.wait("curlew.scene.sensor.method === 'circulation'")
        for change, why in [({"set": "centroid.threshold_noise", "value": -1}, "must be a number from 0"),
                            ({"set": "daemon.jsonl", "value": "/tmp/x"}, "may not change"),
                            ({"set": "detect.method", "value": "magic"}, "must be one of"),
                            ({"set": "centroid", "value": [1]}, "may not change"),
                            ({"do": "record"}, "nothing is recorded"), ({"do": "stop"}, "are known")]:
            status, answer = served.post("/control", json.dumps(change))
            self.assertEqual((status, why in answer), (400, True), answer)
        self.assertEqual(served.post("/control", "[1", **{"Origin": "http://evil.example"})[0], 403)
        status, answer = served.post("/control", "[1")
        self.assertEqual((status, "no JSON object" in answer), (400, True), answer)
        frame = int(browser.text("frame-number"))
        self.assertEqual(served.post("/control", '{"set":"camera.exposure_us","value":500}')[0], 200)
        browser.wait(f"Number(document.getElementById('frame-number').textContent) > {frame + 50}")
        self.assertIn('page: 127.0.0.1 port', served.text())
        self.assertIn('asked for {"set":"centroid.threshold_noise","value":6.5}', served.text())
        self.assertEqual(served.close(), 0)

    def test_a_reference_is_taken_in_place_and_a_lit_dark_is_refused(self):
        (self.folder / "place").mkdir()
        served = self.serve_with_control("sim:plane", '[recorder]\nfolder = "place"\n')
        browser = self.browser
        browser.wait("document.getElementById('warning').hidden")
        self.assertIn("Set hidden_phase = true", browser.text("whole"))
        self.assertRegex(browser.text("camera-table"), r"beam atcol 7\.\d+, row 7\.\d+beam D4σ18\.\d+ × 18\.\d+ lenslets")
        sensor = browser.run("curlew.scene.sensor.sensor_hash")
        says = "document.getElementById('control-calibration').textContent.includes('{}')".format
        browser.run("document.getElementById('control-frames').value = 20")
        browser.run("document.getElementById('control-take_dark').click()")
        browser.wait(says("the old sensor stays: the stack is not dark"))
        self.assertEqual(os.listdir(self.folder / "place"), [])
        self.assertEqual(browser.run("curlew.scene.sensor.sensor_hash"), sensor)
        browser.run("document.getElementById('control-take_reference').click()")
        browser.wait(says("is in use until curlew ends or reloads"))
        made = os.listdir(self.folder / "place")
        self.assertEqual([(n[:7], n[-5:]) for n in made], [("sensor-", ".fits")])
        browser.wait(f"curlew.scene.sensor.sensor_hash !== '{sensor}'")
        browser.wait("curlew.scene.frame.result.n_valid === 256")
        for change, why in [({"do": "take_dark", "frames": 0}, "from 1 to 10000"),
                            ({"do": "take_dark", "frames": "x"}, "a whole number")]:
            status, answer = served.post("/control", json.dumps(change))
            self.assertEqual((status, why in answer), (400, True), answer)
        self.assertRegex(served.text(), r"page: 127\.0\.0\.1 port \d+ had a reference taken: 20 of the \d+ frames")
        self.assertEqual(served.close(), 0)

    def test_the_air_is_charted(self):
        (self.folder / "air.toml").write_text(
            '[page]\nlisten = "127.0.0.1:0"\n[camera]\nframe_rate_hz = 200\n')
        served = Served(self.folder, "run", "--camera", "sim:plane", "--config", "air.toml", "--air", "0.5",
                        says="state=streaming")
        browser = self.browser
        browser.open(served.url)
        browser.wait("curlew?.air.length >= 3 && !document.getElementById('time-r0').hidden")
        browser.wait("document.getElementById('air-hint').textContent.startsWith('The air in windows of 0.5 s')")
        windows = browser.run("curlew.air.map((air) => air.last_frame)")
        self.assertEqual(windows, sorted(set(windows)))
        drawn = """(() => {
            const canvas = document.getElementById('time-air');
            const {data} = canvas.getContext('2d').getImageData(0, 0, canvas.width, canvas.height);
            return data.some((v, i) => i % 4 === 1 && v === 158 && data[i - 1] === 0); })()"""
        browser.wait(drawn)
        self.assertEqual(served.close(), 0)


class Replay(Page):
    """A recording with vortices, and a sensor with one spot that moves by +1 px in x in frame 1."""

    @classmethod
    def setUpClass(cls):
        super().setUpClass()
        size = ["--rows", str(ROWS), "--cols", str(COLS), "--window", str(WINDOW)]
        run(cls.folder, "simulate", "--preset", "plane", *size, "--frames", "10", "--photons", "20000",
            "--bits", "14", "--out", "ref.fits")
        run(cls.folder, "calibrate", "ref.fits", "--out", "sensor.fits")
        run(cls.folder, "simulate", "--preset", "vortex", *size, "--amplitude", "linear",
            "--core-radius", "1.5", "--vortex", "3.4,2.6,+1", "--vortex", "8.7,6.2,-1", "--velocity",
            "0.02,0.01", "--photons", "1500", "--frames", str(FRAMES), "--out", "beam.fits")

    def serve(self, recording, *more):
        served = Served(self.folder, "replay", recording, "--sensor", "sensor.fits", "--page",
                        "127.0.0.1:0", *more, says="Ctrl-C ends")
        self.browser.open(served.url)
        self.browser.wait("curlew?.scene.frame?.result.frame >= 0 && curlew.status.finished")
        return served

    def go_to(self, frame):
        self.browser.run(f"curlew.goTo({frame})")
        self.browser.wait(f"document.getElementById('frame-number').textContent === '{frame}'")

    def test_numbers_are_those_of_the_files(self):
        served = self.serve("beam.fits", "--track", "--out", "results.fits", "--save",
                            "slopes,flux,phase,whole_phase,circulation", "--jsonl", "lines.jsonl")
        browser = self.browser
        n = 17
        self.go_to(n)
        lines = [json.loads(l) for l in (self.folder / "lines.jsonl").read_text().splitlines()]
        self.assertEqual(browser.run(TABLE), vortex_rows(lines[n]))
        with fits.open(self.folder / "results.fits") as results:
            phase = results["PHASE"].data[n]
            whole = results["WHOLE_PHASE"].data[n]
            slopes = results["SLOPES"].data[n]
            circulation = results["CIRCULATION"].data[n]
            total = np.sort(results["LATENCY"].data["TOTAL"])
        with fits.open(self.folder / "beam.fits") as file:
            pixels = file[0].data[n]
        nm = browser.run("curlew.scene.sensor.optics.wavelength_nm") / 2 / np.pi
        row, col = 4, 7
        self.assertIn(f"row {row}, col {col}: {signed(phase[row, col])} rad = "
                      f"{signed(phase[row, col] * nm, 1)} nm", self.hovered("phase", col, row))
        self.assertIn(signed(whole[row, col]) + " rad", self.hovered("whole", col, row))
        self.assertIn(f"row {row}, col {col}: {signed(circulation[row, col])} rad",
                      self.hovered("circulation", col + 0.5, row + 0.5))
        x, y = 40, 21
        text = self.hovered("spots", x, y)
        self.assertIn(f"x {x}, y {y} px: {pixels[y, x]} counts", text)
        self.assertIn(f"lenslet row {y // WINDOW}, col {x // WINDOW}", text)
        browser.click(*self.place("spots", WINDOW * col + 3.5, WINDOW * row + 3.5))
        facts = browser.text("lenslet-facts")
        self.assertIn(f"row {row}, col {col}", facts)
        self.assertIn(f"({signed(slopes[0, row, col])}, {signed(slopes[1, row, col])}) rad/pitch", facts)
        latency = browser.text("latency-table")
        self.assertIn(f"{total[int(np.ceil(0.5 * len(total))) - 1]:.1f}", latency)
        self.assertRegex(latency, shown_us(total[-1]))
        self.check_fits(pixels, phase)
        self.check_player(n)
        self.picture("page-light.png", 1280, 800, False)
        self.picture("page-phone-light.png", 400, 800, False)
        self.picture("page-phone-dark.png", 400, 800, True)
        self.assertEqual(served.close(), 0)
        self.assertFalse([u for u in browser.urls if not u.startswith((served.url, "blob:"))])
        self.assertEqual(browser.problems, [])

    def check_fits(self, pixels, phase):
        script = """(async () => {
            const {fitsOf} = await import('./files.js');
            const blob = new Blob(fitsOf(curlew.scene.frame, curlew.scene.sensor));
            const bytes = new Uint8Array(await blob.arrayBuffer());
            return btoa(Array.from(bytes, (b) => String.fromCharCode(b)).join('')); })()"""
        with fits.open(io.BytesIO(base64.b64decode(self.browser.run(script)))) as file:
            file.verify("exception")
            np.testing.assert_array_equal(file[0].data, pixels)
            np.testing.assert_array_equal(file["PHASE_RAD"].data, phase)

    def check_player(self, n):
        browser = self.browser
        press = "document.getElementById('{}').click()".format
        shows = "document.getElementById('frame-number').textContent === '{}'".format
        browser.run("document.activeElement.blur()")
        for act, frame in [(press("step"), n + 1), (press("back"), n), (press("first"), 0)]:
            browser.run(act)
            browser.wait(shows(frame))
        browser.key(".")
        browser.wait(shows(1))
        browser.run("document.getElementById('spots-map').focus()")
        browser.run("curlew.scene.select(3 * curlew.scene.sensor.cols + 3)")
        browser.key("ArrowRight", 39)
        browser.key("ArrowDown", 40)
        self.assertIn("row 4, col 4", browser.text("lenslet-facts"))
        browser.run("document.getElementById('pace').value = '30'")
        browser.key(" ")
        browser.wait(shows(FRAMES - 1))
        browser.wait("!curlew.playing")

    def test_the_report_opens_without_a_network_and_tells_the_same(self):
        run(self.folder, "replay", "beam.fits", "--sensor", "sensor.fits", "--track", "--out", "r.fits", "--save",
            "flux,phase,whole_phase,circulation", "--jsonl", "r.jsonl", "--report", "report.html")
        report = self.folder / "report.html"
        self.assertLess(report.stat().st_size, 20e6)
        lines = [json.loads(l) for l in (self.folder / "r.jsonl").read_text().splitlines()]
        with Browser(offline=True) as browser, fits.open(self.folder / "r.fits") as results:
            browser.open(report.as_uri())
            browser.wait("curlew?.scene.frame?.result.frame >= 0 && curlew.status.finished")
            for n in (0, FRAMES - 1):
                browser.run(f"curlew.goTo({n})")
                browser.wait(f"document.getElementById('frame-number').textContent === '{n}'")
                self.assertEqual(browser.run(TABLE), vortex_rows(lines[n]))
            read = """(async () => {
                const frames = [];
                for (let n = 0; n < curlew.frames; ++n) {
                    const {maps, result} = await curlew.source.frame(n);
                    const all = (name) => Array.from(maps[name].values);
                    frames.push([result, all('phase_rad'), all('whole_phase_rad'), all('circulation_rad')]);
                }
                return frames; })()"""
            for n, (result, *maps) in enumerate(browser.run(read)):
                self.assertEqual(result, lines[n])
                for name, values in zip(("PHASE", "WHOLE_PHASE", "CIRCULATION"), maps):
                    np.testing.assert_array_equal(
                        np.nan_to_num(np.array(values, "f4")),
                        np.nan_to_num(results[name].data[n]).ravel(), name)
            points = browser.run("curlew.status.points")
            self.assertEqual([(p["frame"], p["vortices"], p["lost"]) for p in points],
                             [(l["frame"], len(l["vortices"]), l["n_lost"]) for l in lines])
            self.assertEqual([p["tracks"] for p in points],
                             [[[v["track"], v["charge"], v["x"], v["y"]] for v in l["vortices"] if v["track"] >= 0]
                              for l in lines])
            self.assertTrue(points[-1]["tracks"])
            self.assertFalse(browser.run("document.getElementById('time-track-x').hidden"))
            total = np.sort(results["LATENCY"].data["TOTAL"])
            self.assertRegex(browser.text("latency-table"), shown_us(total[-1]))
            self.assertEqual({u.split(":")[0] for u in browser.urls} - {"blob", "data"}, {"file"})
            self.assertEqual(browser.problems, [])

    def test_plus_x_moves_right_and_plus_y_down(self):
        row, col = 4, 5
        with fits.open(self.folder / "ref.fits") as file:
            frames = file[0].data[:3].copy()
            frames[:] = frames[0]
            window = np.s_[row * WINDOW:(row + 1) * WINDOW, col * WINDOW:(col + 1) * WINDOW]
            frames[1][window] = np.roll(frames[0][window], 1, axis=1)
            frames[2][window] = np.roll(frames[0][window], 1, axis=0)
            file[0].data = frames
            file[:1].writeto(self.folder / "moved.fits", overwrite=True)
        served = self.serve("moved.fits")
        middle = """(() => {  // of the light in the window of the lenslet, on the screen
            const panel = curlew.panels[0];
            for (const name in panel.on) panel.on[name] = false;
            curlew.scene.selected = null;
            panel.view.redraw();
            const [x0, y0] = panel.view.toScreen(%d, %d).map(Math.round);
            const size = Math.round(%d * panel.view.scale);
            const {data} = panel.canvas.getContext('2d').getImageData(x0, y0, size, size);
            let sum = 0, sx = 0, sy = 0;
            for (let i = 0; i < size * size; ++i) {
                const light = data[4 * i] ** 2;
                sum += light; sx += light * (i %% size); sy += light * Math.floor(i / size);
            }
            return [sx / sum / panel.view.scale, sy / sum / panel.view.scale]; })()""" % (
                col * WINDOW, row * WINDOW, WINDOW - 1)
        places = []
        for n in range(3):
            self.go_to(n)
            places.append(np.array(self.browser.run(middle)))
        np.testing.assert_allclose(places[1] - places[0], [1, 0], atol=0.15)
        np.testing.assert_allclose(places[2] - places[0], [0, 1], atol=0.15)
        self.go_to(1)
        text = self.hovered("spots", col * WINDOW + 3.5, row * WINDOW + 3.5)
        self.assertIn(f"row {row}, col {col}", text)
        self.assertRegex(text, r"displaced by \(\+(0\.[789]|1\.[012])")
        self.assertEqual(served.close(), 0)


if __name__ == "__main__":
    unittest.main(verbosity=2)
