// The panels with maps: the detector, and the maps of lenslets and cells.
import { kRamps, themeColour } from './colours.js';
import { MapView, short } from './canvas.js';
import { ArrayPicture, drawArrows, drawBeam, drawSpots, drawTracks, drawVortices, drawWindows,
  pixelFromLenslet, quantiles, slopeArrows } from './maps.js';
import { lensletFacts, nmOf, signed } from './lenslet.js';
import { saveFits, savePng } from './files.js';

// What all panels show: sensor, frame, the selected lenslet, tails of tracks, held scales.
export class Scene {
  constructor() {
    Object.assign(this, {sensor: null, frame: null, selected: null, tails: new Map(), hold: false});
    this.onSelect = () => {};
  }
  select(k) {
    this.selected = k;
    this.onSelect();
  }
  // Moves the selection by lenslets, to where there are any.
  move(dx, dy) {
    if (!this.sensor) return;
    const {rows, cols} = this.sensor;
    const k = this.selected ?? Math.floor(rows / 2) * cols + Math.floor(cols / 2);
    const col = Math.min(cols - 1, Math.max(0, (k % cols) + dx));
    const row = Math.min(rows - 1, Math.max(0, Math.floor(k / cols) + dy));
    this.select(row * cols + col);
  }
}

function element(tag, attributes = {}, ...children) {
  const made = document.createElement(tag);
  for (const [name, value] of Object.entries(attributes)) made.setAttribute(name, value);
  made.append(...children);
  return made;
}

function button(text, label, act) {
  const made = element('button', {type: 'button', title: label, 'aria-label': label}, text);
  made.addEventListener('click', act);
  return made;
}

// Builds head, canvas and readout of a map's panel into its section.
class MapPanel {
  constructor(id, title, scene, choices) {
    this.scene = scene;
    this.section = document.getElementById(id);
    this.canvas = element('canvas', {id: `${id}-map`, tabindex: 0, role: 'img',
      'aria-label': `${title}. Arrow keys move the selection, plus and minus zoom, 0 shows all.`});
    this.readout = element('p', {class: 'readout', id: `${id}-readout`, 'aria-live': 'polite'});
    this.on = {};
    const head = element('header', {}, element('h2', {}, title));
    for (const [name, text, on] of choices) head.append(this.choice(name, text, on));
    head.append(
      button('all', `Show all of ${title}`, () => this.view.reset()),
      button('PNG', `Save ${title} as PNG`,
        () => savePng(this.canvas, `curlew-${id}-${scene.frame?.result.frame ?? 0}.png`,
          themeColour('--panel'))));
    this.section.append(head, this.canvas, this.readout);
    this.picture = new ArrayPicture();
    this.hovered = null;
  }
  choice(name, text, on) {
    this.on[name] = on;
    const box = element('input', {type: 'checkbox'});
    box.checked = on;
    box.addEventListener('change', () => {
      this.on[name] = box.checked;
      this.view.redraw();
    });
    return element('label', {}, box, text);
  }
  show() {
    this.hoverAt(this.hovered);
    this.view.redraw();
  }
  hoverAt(place) {
    this.hovered = place;
    const text = place && this.scene.frame ? this.textAt(...place) : '';
    this.readout.textContent = text;
  }
  // What MapView asks of its content and is the same for all maps.
  content(extent, axes, toLenslet, more) {
    return {
      extent, axes, draw: (context, view) => this.draw(context, view),
      hover: (x, y) => this.hoverAt(x === null ? null : [x, y]),
      pick: (x, y) => {
        const k = lensletAt(this.scene.sensor, ...toLenslet(x, y));
        if (k !== null) this.scene.select(k);
      },
      move: (dx, dy) => this.scene.move(dx, dy), ...more,
    };
  }
}

// Returns the index of the lenslet at a place in lenslet units; null where there is none.
export function lensletAt(sensor, x, y) {
  const col = Math.round(x);
  const row = Math.round(y);
  if (!sensor || col < 0 || row < 0 || col >= sensor.cols || row >= sensor.rows) return null;
  return row * sensor.cols + col;
}

export function lensletFromPixel(sensor, x, y) {
  const [p11, p12, p21, p22] = sensor.p_px;
  const dx = x - sensor.origin_px[0];
  const dy = y - sensor.origin_px[1];
  const area = p11 * p22 - p12 * p21;
  return [(p22 * dx - p12 * dy) / area, (p11 * dy - p21 * dx) / area];
}

export class SpotsPanel extends MapPanel {
  constructor(scene) {
    super('spots', 'Spots', scene, [['windows', 'windows', true], ['spots', 'spots', true],
      ['arrows', 'slopes', true], ['vortices', 'vortices', true]]);
    this.section.querySelector('header').append(button('FITS', 'Save the frame and its maps as FITS',
      () => scene.frame && saveFits(scene.frame, scene.sensor)));
    this.view = new MapView(this.canvas, this.content(
      () => scene.frame && {cols: scene.frame.maps.pixels.cols, rows: scene.frame.maps.pixels.rows},
      ['x, px', 'y, px'], (x, y) => lensletFromPixel(scene.sensor, x, y)));
  }
  draw(context, view) {
    const {frame, sensor, selected} = this.scene;
    const {pixels} = frame.maps;
    if (!this.scene.hold || !this.range) {
      const every = Math.max(1, Math.floor(pixels.values.length / 20000));
      this.range = quantiles(pixels.values.filter((_, i) => i % every === 0), 0.05, 0.998);
    }
    const [low, high] = this.range;
    this.picture.draw(context, view, pixels, kRamps.grey,
      (v) => Math.sqrt(Math.max(0, v - low) / Math.max(1, high - low)), () => true);
    if (this.on.windows) drawWindows(context, view, sensor, frame);
    if (this.on.spots) drawSpots(context, view, sensor, frame);
    if (this.on.arrows) drawArrows(context, view, this.displacements(), sensor.pitch_px, '#f0e442');
    const place = (x, y) => pixelFromLenslet(sensor, x, y);
    if (this.on.vortices) {
      drawVortices(context, view, frame.result.vortices, place, sensor.pitch_px);
      drawTracks(context, view, this.scene.tails, place);
    }
    if (selected !== null) markSelected(context, view, ...place(selected % sensor.cols,
      Math.floor(selected / sensor.cols)), sensor.pitch_px);
  }
  displacements() {
    const {frame: {maps}, sensor} = this.scene;
    const arrows = [];
    for (let k = 0; k < maps.x_px.values.length; ++k) {
      if (!maps.slope_valid.values[k]) continue;
      const x = sensor.maps.ref_x_px.values[k];
      const y = sensor.maps.ref_y_px.values[k];
      arrows.push({x, y, dx: maps.x_px.values[k] - x, dy: maps.y_px.values[k] - y});
    }
    return arrows;
  }
  textAt(x, y) {
    const {frame, sensor} = this.scene;
    const {pixels} = frame.maps;
    const col = Math.round(x);
    const row = Math.round(y);
    if (col < 0 || row < 0 || col >= pixels.cols || row >= pixels.rows) return '';
    const counts = pixels.values[row * pixels.cols + col];
    const k = lensletAt(sensor, ...lensletFromPixel(sensor, x, y));
    const lenslet = k !== null && sensor.maps.lit.values[k]
      ? lensletFacts(sensor, frame, k).slice(0, 6).map((f) => f.join(' ')).join(' · ') : 'no lenslet';
    return `x ${col}, y ${row} px: ${counts} counts · ${lenslet}`;
  }
}

function markSelected(context, view, x, y, pitch) {
  const [left, top] = view.toScreen(x - pitch / 2, y - pitch / 2);
  for (const [width, style] of [[4, 'rgba(0,0,0,0.6)'], [2, '#ffffff']]) {
    context.lineWidth = width;
    context.strokeStyle = style;
    context.strokeRect(left, top, pitch * view.scale, pitch * view.scale);
  }
}

// kind: {id, title, map, counts: a map's name, signed, unit, second: whether in nm too, cells}
export class LensletPanel extends MapPanel {
  constructor(scene, kind, camera) {
    super(kind.id, kind.title, scene, kind.choices);
    this.kind = kind;
    const shift = kind.cells ? 0.5 : 0;
    this.view = new MapView(this.canvas, this.content(
      () => this.map() && {cols: scene.sensor.cols, rows: scene.sensor.rows}, ['col', 'row'],
      (x, y) => [x, y], {bar: () => this.bar()}), camera);
    this.shift = shift;
    this.missing = element('p', {class: 'hint'}, kind.missing ?? '');
    this.missing.hidden = true;
    this.canvas.before(this.missing);
  }
  show() {
    this.missing.hidden = !this.kind.missing || Boolean(this.map());
    super.show();
  }
  map() { return this.scene.frame?.maps[this.kind.map]; }
  counts(k) {
    const {frame, sensor} = this.scene;
    return (frame.maps[this.kind.counts] ?? sensor.maps[this.kind.counts]).values[k] !== 0;
  }
  bar() {
    const map = this.map();
    if (!map) return null;
    if (!this.scene.hold || !this.range) {
      const values = map.values;
      const [low, high] = quantiles(values, 0, 1, (k) => this.counts(k));
      const most = Math.max(Math.abs(low), Math.abs(high), 1e-3);
      this.range = this.kind.signed ? [-most, most] : [0, most];
    }
    const units = [{name: this.kind.unit, factor: 1}];
    if (this.kind.nm && this.scene.sensor.optics.wavelength_nm)
      units.push({name: 'nm', factor: nmOf(this.scene.sensor, 1)});
    return {table: this.kind.signed ? kRamps.signed : kRamps.light, low: this.range[0],
      high: this.range[1], units};
  }
  draw(context, view) {
    const {table, low, high} = this.bar();
    const {frame, sensor, selected, tails} = this.scene;
    const moved = {scale: view.scale,
      toScreen: (x, y) => view.toScreen(x + this.shift, y + this.shift)};
    this.picture.draw(context, moved, this.map(), table, (v) => (v - low) / (high - low),
      (k) => this.counts(k));
    if (this.on.arrows) drawArrows(context, view, slopeArrows(frame), 1, '#f0e442');
    if (this.on.beam) drawBeam(context, view, frame.figures.beam);
    const place = (x, y) => [x, y];
    if (this.on.vortices) {
      drawVortices(context, view, frame.result.vortices, place, 1);
      drawTracks(context, view, tails, place);
    }
    if (selected !== null)
      markSelected(context, view, selected % sensor.cols, Math.floor(selected / sensor.cols), 1);
  }
  textAt(x, y) {
    const map = this.map();
    if (!map) return '';
    const col = Math.round(x - this.shift);
    const row = Math.round(y - this.shift);
    if (col < 0 || row < 0 || col >= map.cols || row >= map.rows) return '';
    const k = row * map.cols + col;
    const what = `${this.kind.cells ? 'cell' : 'lenslet'} row ${row}, col ${col}`;
    if (!this.counts(k)) return `${what}: no value`;
    return `${what}: ${this.valueText(map.values[k])}${this.vortexText(x, y)}`;
  }
  valueText(value) {
    const {kind, scene: {sensor}} = this;
    if (kind.nm && sensor.optics.wavelength_nm)
      return `${signed(value)} rad = ${signed(nmOf(sensor, value), 1)} nm`;
    return kind.signed ? `${signed(value)} ${kind.unit}` : `${short(value)} ${kind.unit}`;
  }
  vortexText(x, y) {
    const near = this.scene.frame.result.vortices.find((v) => Math.hypot(v.x - x, v.y - y) < 0.75);
    if (!near || !this.on.vortices) return '';
    const charge = near.charge === 0 ? 'unresolved pair' : `vortex ${near.charge > 0 ? '+1' : '−1'}`;
    return ` · ${charge} at x ${near.x.toFixed(3)}, y ${near.y.toFixed(3)}: `
      + `D ${signed(near.circulation)} rad, D/σ ${near.significance.toFixed(1)}`
      + (near.probability === null ? '' : `, p ${near.probability.toFixed(3)}`)
      + (near.track < 0 ? '' : `, track ${near.track}`);
  }
}

const kVortices = ['vortices', 'vortices', true];
export const kLensletMaps = [
  {id: 'phase', title: 'Phase', map: 'phase_rad', counts: 'slope_valid', signed: true, unit: 'rad',
    nm: true, choices: [['arrows', 'slopes', false]]},
  {id: 'whole', title: 'Whole phase', map: 'whole_phase_rad', counts: 'slope_valid', signed: true,
    unit: 'rad', nm: true, choices: [kVortices],
    missing: 'Set hidden_phase = true in section [split] to see the phase with what vortices add.'},
  {id: 'circulation', title: 'Circulation', map: 'circulation_rad', counts: 'circulation_valid',
    signed: true, unit: 'rad', cells: true, choices: [kVortices]},
  {id: 'flux', title: 'Flux', map: 'flux_adu', counts: 'lit', signed: false, unit: 'ADU',
    choices: [['beam', 'beam', true], ['vortices', 'vortices', false]]},
];
