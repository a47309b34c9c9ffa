// The page: takes frames from its source, shows them, and listens to the user.
import { kStates } from './colours.js';
import { short } from './canvas.js';
import { HttpSource, ReportSource } from './sources.js';
import { LensletHistory, drawLensletWindow, lensletFacts, nmOf, signed } from './lenslet.js';
import { drawHistogram, drawLines, drawTrackLines, drawZernike } from './charts.js';
import { ControlPanel } from './control.js';
import { kLensletMaps, LensletPanel, Scene, SpotsPanel } from './panels.js';

const byId = (id) => document.getElementById(id);
const kTail = 40;
const kHistory = 600;

class Page {
  constructor() {
    this.source = byId('report-status') ? new ReportSource() : new HttpSource();
    this.scene = new Scene();
    this.scene.onSelect = () => this.redraw();
    this.camera = {zoom: 1, x: 0, y: 0, views: []};
    this.panels = [new SpotsPanel(this.scene)];
    for (const kind of kLensletMaps)
      this.panels.push(new LensletPanel(this.scene, kind, this.camera));
    this.lenslets = new LensletHistory();
    this.history = [];
    this.air = [];
    this.playing = true;
    this.position = 0;
    this.frames = 0;
    this.readoutOf('zernike', (bar) => `Z${bar.j} (n ${bar.n}, m ${bar.m}): ${signed(bar.rad)} rad`
      + ` = ${signed(nmOf(this.scene.sensor, bar.rad), 1)} nm rms`);
    this.readoutOf('histogram', (bin) =>
      `${bin.count} frames from ${short(bin.low)} to ${short(bin.high)} µs`);
    this.listen();
  }

  readoutOf(id, textOf) {
    const readout = byId(`${id}-readout`);
    byId(id).addEventListener('pointermove', (event) => {
      const bar = this[id]?.(event.offsetX);
      readout.textContent = bar ? textOf(bar) : '';
    });
  }

  async run() {
    // The token need not stay in sight and in the history; the browser has its cookie.
    if (location.search) history.replaceState(null, '', location.pathname);
    this.status = await this.patiently(() => this.source.status());
    document.body.classList.add(this.status.mode);
    this.control = new ControlPanel(this.source, this.status.settings ?? []);
    if (this.status.mode === 'live') await this.live();
    else await this.replay();
  }

  // Tries until it works, and says what is wrong meanwhile.
  async patiently(act) {
    for (;;) {
      try {
        const done = await act();
        byId('trouble').hidden = true;
        return done;
      } catch (error) {
        const gone = error instanceof TypeError;
        byId('trouble').textContent = gone
          ? 'Curlew does not answer; trying again …' : String(error.message);
        byId('trouble').hidden = false;
        this.setState(gone ? 'no connection' : 'error', false);
        await new Promise((resolve) => setTimeout(resolve, 1000));
      }
    }
  }

  // A frame is asked for only when the last one is drawn, so that a page that nobody sees, whose
  // animation frames do not come, costs the program nothing.
  async live() {
    let last = 0;
    for (;;) {
      await new Promise((resolve) => requestAnimationFrame(resolve));
      if (!this.playing && !this.stepping) {
        await new Promise((resolve) => setTimeout(resolve, 50));
        continue;
      }
      const message = await this.patiently(() => this.source.frame(last));
      if (!message) continue;
      this.showStatus(message.status);
      if (message.kind !== 'frame') continue;
      last = message.number;
      this.stepping = false;
      await this.show(message);
    }
  }

  async replay() {
    for (let due = 0; ;) {
      await new Promise((resolve) => requestAnimationFrame(resolve));
      await this.updateReplay();
      const now = performance.now();
      if (this.playing && now >= due && this.position + 1 < this.frames) {
        due = Math.max(due + 1000 / byId('pace').value, now - 100);
        this.position += 1;
      } else if (this.playing && this.status.finished && this.position + 1 >= this.frames) {
        this.play(false);
      }
      if (this.shown === this.position || this.frames === 0) continue;
      const wanted = this.position;
      const message = await this.patiently(() => this.source.frame(wanted));
      if (message) await this.show(message);
      this.shown = wanted;
      byId('slider').value = wanted;
    }
  }
  async updateReplay() {
    const finished = this.frames > 0 && this.status.finished;
    if (!finished && performance.now() - (this.updated ?? -1000) > 300) {
      this.status = await this.patiently(() => this.source.status());
      this.updated = performance.now();
    }
    if (this.frames === this.status.frames) return;
    if (this.frames === 0) this.shown = -1;
    this.frames = this.status.frames;
    byId('slider').max = this.frames - 1;
    const {every, all_frames: all, finished: over} = this.status;
    this.setState(over ? 'replay' : 'replaying', true);
    byId('rate').textContent = every > 1 ? `1 frame of every ${every} of ${all}` : `of ${all}`;
  }

  async show(frame) {
    const {scene} = this;
    if (scene.sensor?.plan !== frame.plan) {
      const sensor = await this.patiently(() => this.source.sensor(frame.plan));
      if (!sensor) return;
      scene.sensor = sensor;
      scene.tails.clear();
      this.lenslets.frames = [];
      for (const panel of this.panels) panel.range = null;
      if (scene.selected >= sensor.rows * sensor.cols) scene.selected = null;
      this.describe(sensor);
    }
    this.remember(frame);
    scene.frame = frame;
    this.latency = frame.latency ?? this.status.latency;
    this.redraw();
  }

  remember(frame) {
    const {result, figures} = frame;
    const {tails} = this.scene;
    if (result.frame <= (this.history.at(-1)?.frame ?? -1)) {
      this.history = [];
      tails.clear();
    }
    this.history.push({frame: result.frame, vortices: result.vortices.length, rms: figures.rms_rad,
      scintillation: figures.scintillation, lost: result.n_lost,
      tracks: result.vortices.filter((v) => v.track >= 0).map((v) => [v.track, v.charge, v.x, v.y])});
    if (this.history.length > kHistory) this.history.shift();
    this.lenslets.add(frame);
    const seen = new Set();
    for (const {track, x, y, charge} of result.vortices) {
      if (track < 0) continue;
      seen.add(track);
      const tail = tails.get(track) ?? {places: []};
      tail.charge = charge;
      tail.places = [...tail.places, [x, y]].slice(-kTail);
      tails.set(track, tail);
    }
    for (const track of tails.keys()) if (!seen.has(track)) tails.delete(track);
  }

  redraw() {
    const {frame} = this.scene;
    if (!frame) return;
    byId('frame-number').textContent = frame.result.frame;
    for (const panel of this.panels) panel.show();
    this.drawLenslet();
    this.drawTables();
    this.zernike = drawZernike(byId('zernike'), frame.zernike);
    if (this.latency?.total) this.histogram = drawHistogram(byId('histogram'), this.latency.total);
    this.drawTime();
    this.drawAir();
  }

  // Over time: all frames of a replay, once they are there; else those that were shown.
  drawTime() {
    const points = this.status.points ?? this.history;
    const {frame, sensor} = this.scene;
    const numbers = points.map((h) => h.frame);
    const now = this.status.points ? numbers.indexOf(frame.result.frame) : null;
    const line = (id, name, colour, unit, key) => drawLines(byId(id),
      [{name, colour, values: points.map((h) => h[key] ?? NaN)}], unit, numbers, false, now);
    line('time-vortices', 'vortices', '#d55e00', '', 'vortices');
    line('time-rms', 'wavefront rms', '#0072b2', 'rad', 'rms');
    line('time-scintillation', 'scintillation', '#009e73', '⟨F²⟩/⟨F⟩² − 1', 'scintillation');
    line('time-lenslets', 'lenslets lost', '#cc79a7', '', 'lost');
    const none = !points.some((point) => point.tracks.length > 0);
    for (const [id, which, unit, most] of [['time-track-x', 2, 'col of tracks', sensor.cols],
      ['time-track-y', 3, 'row of tracks; dashed: −', sensor.rows]]) {
      byId(id).hidden = none;
      if (!none) drawTrackLines(byId(id), points, which, unit, most, now);
    }
  }

  // A window of the air that the daemon has measured, once.
  rememberAir(air) {
    if (air.last_frame === this.air.at(-1)?.last_frame) return;
    this.air.push(air);
    if (this.air.length > kHistory) this.air.shift();
  }
  drawAir() {
    const windows = this.air.map((air) => air.last_frame);
    for (const id of ['time-r0', 'time-air']) byId(id).hidden = windows.length === 0;
    byId('air-hint').hidden = windows.length === 0;
    if (windows.length === 0) return;
    const of = (key, factor = 1) => this.air.map((air) => (air[key]?.value ?? NaN) * factor);
    const inMm = Number.isFinite(this.scene.sensor.optics.pitch_um);
    drawLines(byId('time-r0'), [{name: 'r0', colour: '#0072b2',
      values: inMm ? of('r0_m', 1000) : of('r0_pitches')}], inMm ? 'mm' : 'pitches', windows);
    drawLines(byId('time-air'), [{name: 'scintillation index', colour: '#009e73',
      values: of('scintillation_index')}], '⟨I²⟩/⟨I⟩² − 1 in time', windows);
    const {frames, seconds, without_r0: without, r0_m: r0} = this.air.at(-1);
    byId('air-hint').textContent = `The air in windows of ${seconds.toFixed(1)} s; the last has ${frames} frames`
      + (without ? `. ${without}` : r0?.value ? `, r0 ${short(1000 * r0.value)} ± ${short(1000 * r0.error)} mm` : '');
  }

  drawLenslet() {
    const {sensor, frame, selected} = this.scene;
    const none = selected === null || !sensor.maps.lit.values[selected];
    byId('lenslet-body').hidden = none;
    byId('lenslet-hint').hidden = selected !== null && !none;
    if (none) return;
    fillTable('lenslet-facts', lensletFacts(sensor, frame, selected));
    drawLensletWindow(byId('lenslet-window'), sensor, frame, selected);
    this.lenslets.draw(byId('lenslet-moves'), byId('lenslet-fluxes'), sensor, selected);
  }

  drawTables() {
    const {sensor, frame: {result, figures, zernike}} = this.scene;
    const nm = (rad) => (rad === null ? '–' : `${rad.toFixed(3)} rad = ${short(nmOf(sensor, rad))} nm`);
    fillTable('wavefront-table', [
      ['rms, tilt removed', nm(figures.rms_rad)], ['peak to valley', nm(figures.pv_rad)],
      ['Strehl, exp(−rms²)', figures.strehl === null ? '–' : figures.strehl.toFixed(4)],
      ['Zernike modes', zernike.length || 'not known'], ['islands of phase', result.n_islands]]);
    fillTable('vortex-table', [['±', 'x', 'y', 'D, rad', 'D/σ', 'p', 'track'],
      ...result.vortices.map((v) => [v.charge === 0 ? 'pair' : signed(v.charge, 0), v.x.toFixed(3),
        v.y.toFixed(3), signed(v.circulation), v.significance.toFixed(1),
        v.probability === null ? '–' : v.probability.toFixed(3), v.track < 0 ? '–' : v.track])], true);
    const stages = this.latency?.stages ?? [];
    fillTable('latency-table', [['µs', 'p50', 'p90', 'p99', 'max'], ...stages.map(
      (s) => [s.name, ...[s.p50_us, s.p90_us, s.p99_us, s.max_us].map((v) => v.toFixed(1))]),
    [`of ${this.latency?.frames ?? 0} frames`]], true);
    const frameRows = [['lenslets with a slope', result.n_valid], ['lenslets lost', result.n_lost],
      ['lenslets saturated', figures.n_saturated], ['level', `${short(figures.level_adu)} ADU`],
      ['noise', `${short(figures.noise_adu)} ADU rms`], ...beamRows(figures.beam), ['light', `${short(figures.flux_adu)} ADU`],
      ['sequence', result.sequence], ['frames dropped', result.dropped]];
    fillTable('camera-table', [...this.cameraRows(), ...frameRows]);
  }

  cameraRows() {
    const s = this.daemon;
    if (!s) return [];
    return [['camera', s.state], ['frames a second', s.frames_per_s.toFixed(1)],
      ['results', s.results], ['superseded', s.superseded], ['lost', s.lost],
      ['incomplete', s.incomplete], ['timed out', s.timed_out], ['aborted', s.aborted],
      ['wrong size', s.wrong_size], ['other', s.other], ['packets refused', s.refused_packets],
      ['connections', s.connections], ['recorder', s.recording ? 'recording' : 'off'],
      ['recorded', s.recorded], ['not recorded', s.unrecorded]];
  }

  describe(sensor) {
    byId('title').textContent = sensor.title;
    document.title = `Curlew – ${sensor.title}`;
    byId('configuration').textContent = sensor.configuration;
    this.control.show(sensor.configuration);
    const o = sensor.optics;
    fillTable('sensor-table', [
      ['lenslets', `${sensor.cols} × ${sensor.rows}`],
      ['frame', `${sensor.frame_cols} × ${sensor.frame_rows} px`],
      ['pitch', `${short(o.pitch_um)} µm, ${sensor.pitch_px.toFixed(3)} px`],
      ['focal length', `${short(o.focal_mm)} mm`], ['pixel', `${short(o.pixel_um)} µm`],
      ['wavelength', `${short(o.wavelength_nm)} nm`],
      ['one pixel of displacement', `${short(o.slope_rad_per_px)} rad/pitch`],
      ['e⁻ per ADU', short(o.e_per_adu)], ['read noise', `${short(o.read_noise_e)} e⁻`],
      ['saturation', `${short(o.saturation_adu)} ADU`], ['mirrored', o.mirrored ? 'yes' : 'no'],
      ['vortices by', sensor.method], ['sensor file', sensor.sensor_hash],
      ['configuration', sensor.configuration_hash], ['program', sensor.program]]);
  }

  showStatus(status) {
    if (!status) return;
    this.daemon = status;
    const warning = this.scene.frame ? status.beam?.warning
      : `There is no frame yet: ${status.state}${status.reason ? `, ${status.reason}` : ''}`;
    byId('warning').textContent = warning ?? '';
    byId('warning').hidden = !warning;
    byId('control-calibration').textContent = status.calibration ?? '';
    if (status.air) this.rememberAir(status.air);
    this.setState(status.state, status.state === 'streaming', status.reason);
    byId('rate').textContent = `${status.frames_per_s.toFixed(0)} frames/s`;
    if (this.scene.frame) this.drawTables();
  }
  setState(text, good, why = '') {
    byId('state').textContent = text;
    byId('state').title = why;
    byId('state').className = `badge ${good ? 'good' : 'bad'}`;
  }

  play(on) {
    this.playing = on;
    byId('play').textContent = on ? 'Pause' : 'Play';
  }
  step(by) {
    this.play(false);
    this.stepping = true;
    this.position = Math.min(Math.max(0, this.position + by), Math.max(0, this.frames - 1));
  }
  goTo(position) { this.step(position - this.position); }
  togglePlay() {
    if (!this.playing && this.frames > 0 && this.position + 1 >= this.frames) this.position = -1;
    this.play(!this.playing);
  }

  listen() {
    byId('play').addEventListener('click', () => this.togglePlay());
    byId('step').addEventListener('click', () => this.step(1));
    byId('back').addEventListener('click', () => this.step(-1));
    byId('first').addEventListener('click', () => this.goTo(0));
    byId('slider').addEventListener('input', (event) => this.goTo(Number(event.target.value)));
    byId('hold').addEventListener('change', (event) => this.hold(event.target.checked));
    byId('theme').addEventListener('click', () => this.theme());
    window.matchMedia('(prefers-color-scheme: dark)').addEventListener('change', () => this.theme(true));
    this.theme(true);
    const keys = {
      ' ': () => this.togglePlay(), '.': () => this.step(1), ',': () => this.step(-1),
      Home: () => this.goTo(0), End: () => this.goTo(this.frames - 1),
      h: () => this.hold(!this.scene.hold), t: () => this.theme(),
    };
    document.addEventListener('keydown', (event) => {
      const typing = event.target.closest('input:not([type=checkbox]), select, button, summary');
      if (!keys[event.key] || event.ctrlKey || event.metaKey || typing) return;
      event.preventDefault();
      keys[event.key]();
    });
    byId('legend').append('Windows:', ...kStates.filter((s) => s.name !== 'unlit').flatMap((s) => {
      const key = document.createElement('span');
      key.className = 'key';
      key.style.borderColor = s.colour;
      key.style.borderStyle = s.dash.length ? 'dashed' : 'solid';
      return [key, s.name];
    }));
  }
  hold(on) {
    this.scene.hold = on;
    byId('hold').checked = on;
    this.redraw();
  }
  // asSystem: takes what the system prefers, else the other of light and dark.
  theme(asSystem = false) {
    const root = document.documentElement;
    const dark = asSystem ? window.matchMedia('(prefers-color-scheme: dark)').matches
      : root.dataset.theme !== 'dark';
    root.dataset.theme = dark ? 'dark' : 'light';
    this.redraw();
  }
}

function beamRows(beam) {
  if (beam.without) return [['beam', beam.without]];
  const size = [['beam D4σ', `${beam.d4sigma_x.toFixed(2)} × ${beam.d4sigma_y.toFixed(2)} lenslets`]];
  if (beam.d4sigma_x_mm !== null)
    size.push(['on the array', `${short(beam.d4sigma_x_mm)} × ${short(beam.d4sigma_y_mm)} mm`]);
  return [['beam at', `col ${beam.x.toFixed(2)}, row ${beam.y.toFixed(2)}`], ...size,
    ['light at the rim', `${(100 * beam.rim).toFixed(1)} %`]];
}

// rows: [[name, value …]]; heads: whether the first row is one of headings.
function fillTable(id, rows, heads = false) {
  const body = document.createElement('tbody');
  rows.forEach((row, i) => {
    const line = body.insertRow();
    for (const text of row) {
      const cell = document.createElement(heads && i === 0 ? 'th' : 'td');
      cell.textContent = text;
      line.append(cell);
    }
    if (row.length < rows[0].length) line.lastChild.colSpan = 1 + rows[0].length - row.length;
  });
  byId(id).replaceChildren(body);
}

const page = new Page();
window.curlew = page;  // for tests and for the curious
page.run();
