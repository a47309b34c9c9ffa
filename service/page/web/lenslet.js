// One lenslet in words, its window enlarged, and what it did in the last frames.
import { kRamps, kStates } from './colours.js';
import { sharpContext, short } from './canvas.js';
import { ArrayPicture, quantiles, windowOf } from './maps.js';
import { drawLines } from './charts.js';

export function signed(value, digits = 3) {
  return `${value < 0 ? '−' : '+'}${Math.abs(value).toFixed(digits)}`;
}

// Returns [[name, value]] of lenslet k.
export function lensletFacts(sensor, frame, k) {
  const at = (name) => frame.maps[name].values[k];
  const facts = [
    ['lenslet', `row ${Math.floor(k / sensor.cols)}, col ${k % sensor.cols}`],
    ['state', kStates[at('state')].name],
    ['flux', `${short(at('flux_adu'))} ADU`],
  ];
  if (at('slope_valid')) {
    const dx = at('x_px') - sensor.maps.ref_x_px.values[k];
    const dy = at('y_px') - sensor.maps.ref_y_px.values[k];
    facts.push(
      ['spot at', `(${at('x_px').toFixed(3)}, ${at('y_px').toFixed(3)}) px`],
      ['displaced by', `(${signed(dx)}, ${signed(dy)}) px`],
      ['slope', `(${signed(at('slope_x'))}, ${signed(at('slope_y'))}) rad/pitch`],
      ['phase', `${signed(at('phase_rad'))} rad = ${signed(nmOf(sensor, at('phase_rad')), 1)} nm`]);
  }
  const window = windowOf(sensor, frame, k);
  facts.push(['window', `${window.w} × ${window.h} px from (${window.x}, ${window.y})`]);
  return facts;
}

export function nmOf(sensor, rad) {
  return (rad / (2 * Math.PI)) * sensor.optics.wavelength_nm;
}

const picture = new ArrayPicture();

// Draws the window of lenslet k with one pixel round it, its spot, reference and numbers.
export function drawLensletWindow(canvas, sensor, frame, k) {
  const {context, width, height} = sharpContext(canvas);
  const {pixels} = frame.maps;
  const window = windowOf(sensor, frame, k);
  const x0 = Math.max(0, window.x - 1);
  const y0 = Math.max(0, window.y - 1);
  const cols = Math.min(pixels.cols, window.x + window.w + 1) - x0;
  const rows = Math.min(pixels.rows, window.y + window.h + 1) - y0;
  if (cols <= 0 || rows <= 0) return;
  const values = new Float32Array(rows * cols);
  for (let r = 0; r < rows; ++r)
    for (let c = 0; c < cols; ++c)
      values[r * cols + c] = pixels.values[(y0 + r) * pixels.cols + x0 + c];
  const scale = Math.min(width / cols, height / rows);
  const view = {
    scale,
    toScreen: (x, y) => [
      (width - cols * scale) / 2 + (x - x0 + 0.5) * scale,
      (height - rows * scale) / 2 + (y - y0 + 0.5) * scale],
  };
  const shifted = {...view, toScreen: (x, y) => view.toScreen(x + x0, y + y0)};
  const [low, high] = quantiles(values, 0, 1);
  picture.draw(context, shifted, {rows, cols, values}, kRamps.grey,
    (v) => Math.sqrt((v - low) / Math.max(1, high - low)), () => true);
  drawWindowMarks(context, view, {sensor, frame, k, window});
}

function drawWindowMarks(context, view, {sensor, frame, k, window}) {
  const state = kStates[frame.maps.state.values[k]];
  context.strokeStyle = state.colour;
  context.lineWidth = 2;
  context.setLineDash(state.dash);
  const [left, top] = view.toScreen(window.x - 0.5, window.y - 0.5);
  context.strokeRect(left, top, window.w * view.scale, window.h * view.scale);
  context.setLineDash([]);
  const [rx, ry] = view.toScreen(sensor.maps.ref_x_px.values[k], sensor.maps.ref_y_px.values[k]);
  context.fillStyle = '#f0e442';
  context.beginPath();
  context.arc(rx, ry, 3.5, 0, 2 * Math.PI);
  context.fill();
  if (!frame.maps.slope_valid.values[k]) return;
  const [x, y] = view.toScreen(frame.maps.x_px.values[k], frame.maps.y_px.values[k]);
  context.strokeStyle = '#56b4e9';
  context.beginPath();
  context.moveTo(x - 9, y);
  context.lineTo(x + 9, y);
  context.moveTo(x, y - 9);
  context.lineTo(x, y + 9);
  context.stroke();
}

// Keeps what every lenslet did in the last frames that were shown.
export class LensletHistory {
  constructor(length = 240) {
    this.length = length;
    this.frames = [];
  }
  add(frame) {
    const {x_px, y_px, flux_adu, slope_valid} = frame.maps;
    const number = frame.result.frame;
    const last = this.frames.at(-1)?.number;
    if (last !== undefined && number <= last) this.frames = [];
    this.frames.push({
      number, x: x_px.values.slice(), y: y_px.values.slice(), flux: flux_adu.values.slice(),
      valid: slope_valid.values.slice(),
    });
    if (this.frames.length > this.length) this.frames.shift();
  }
  draw(moves, fluxes, sensor, k) {
    const numbers = this.frames.map((f) => f.number);
    const moved = (name, reference) => this.frames.map(
      (f) => (f.valid[k] ? f[name][k] - sensor.maps[reference].values[k] : NaN));
    drawLines(moves, [
      {name: 'x', colour: '#56b4e9', values: moved('x', 'ref_x_px')},
      {name: 'y', colour: '#e69f00', values: moved('y', 'ref_y_px')}], 'displaced, px', numbers, true);
    drawLines(fluxes, [
      {name: 'flux', colour: '#009e73', values: this.frames.map((f) => f.flux[k])}], 'ADU',
    numbers);
  }
}
