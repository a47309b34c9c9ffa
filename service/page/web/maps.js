// What is drawn on maps: pictures of arrays, windows, spots, arrows and vortices.
import { kMinus, kPair, kPlus, kStates, themeColour } from './colours.js';

// Returns the values at two quantiles of those that count.
export function quantiles(values, low, high, counts = () => true) {
  const sorted = Float64Array.from(values).filter((v, k) => Number.isFinite(v) && counts(k)).sort();
  if (sorted.length === 0) return [0, 1];
  const at = (q) => sorted[Math.min(sorted.length - 1, Math.floor(q * sorted.length))];
  return [at(low), at(high)];
}

// Draws an array, each value as a square. What does not count shows what lies below.
export class ArrayPicture {
  constructor() {
    this.canvas = document.createElement('canvas');
  }
  // fraction(value) → 0 … 1 on the ramp
  draw(context, view, {rows, cols, values}, table, fraction, counts) {
    if (this.canvas.width !== cols || this.canvas.height !== rows || !this.image) {
      this.canvas.width = cols;
      this.canvas.height = rows;
      this.image = this.canvas.getContext('2d').createImageData(cols, rows);
    }
    const bytes = this.image.data;
    for (let k = 0; k < values.length; ++k) {
      const i = 3 * Math.round(255 * Math.min(1, Math.max(0, fraction(values[k]))));
      bytes[4 * k] = table[i];
      bytes[4 * k + 1] = table[i + 1];
      bytes[4 * k + 2] = table[i + 2];
      bytes[4 * k + 3] = counts(k) ? 255 : 0;
    }
    this.canvas.getContext('2d').putImageData(this.image, 0, 0);
    const [x, y] = view.toScreen(-0.5, -0.5);
    context.imageSmoothingEnabled = false;
    context.drawImage(this.canvas, x, y, cols * view.scale, rows * view.scale);
  }
}

// Returns the window of lenslet k where it is in this frame: {x, y, w, h}, whole pixels.
export function windowOf(sensor, frame, k) {
  const {values} = sensor.maps.windows;
  const n = sensor.rows * sensor.cols;
  return {
    x: values[k] + frame.maps.moved_x_px.values[k],
    y: values[n + k] + frame.maps.moved_y_px.values[k],
    w: values[2 * n + k],
    h: values[3 * n + k],
  };
}

export function drawWindows(context, view, sensor, frame) {
  const {state} = frame.maps;
  context.lineWidth = Math.max(0.6, Math.min(1.5, view.scale / 6));
  kStates.forEach(({name, colour, dash}, which) => {
    if (name === 'unlit') return;
    context.beginPath();
    for (let k = 0; k < state.values.length; ++k) {
      if (state.values[k] !== which || sensor.maps.lit.values[k] === 0) continue;
      const window = windowOf(sensor, frame, k);
      const [x, y] = view.toScreen(window.x - 0.5, window.y - 0.5);
      context.rect(x, y, window.w * view.scale, window.h * view.scale);
    }
    context.strokeStyle = colour;
    context.setLineDash(view.scale > 2 ? dash : []);
    context.stroke();
  });
  context.setLineDash([]);
}

// Crosses where the spots are, and dots where their references are.
export function drawSpots(context, view, sensor, frame) {
  const {x_px, y_px, slope_valid, moved_x_px, moved_y_px} = frame.maps;
  const arm = Math.max(2, 0.12 * sensor.pitch_px * view.scale);
  context.beginPath();
  for (let k = 0; k < x_px.values.length; ++k) {
    if (slope_valid.values[k] === 0) continue;
    const [x, y] = view.toScreen(x_px.values[k], y_px.values[k]);
    context.moveTo(x - arm, y);
    context.lineTo(x + arm, y);
    context.moveTo(x, y - arm);
    context.lineTo(x, y + arm);
  }
  context.lineWidth = 1;
  context.strokeStyle = '#56b4e9';
  context.stroke();
  context.fillStyle = '#f0e442';
  for (let k = 0; k < moved_x_px.values.length && moved_y_px; ++k) {
    if (slope_valid.values[k] === 0) continue;
    const [x, y] = view.toScreen(sensor.maps.ref_x_px.values[k], sensor.maps.ref_y_px.values[k]);
    context.fillRect(x - 1, y - 1, 2, 2);
  }
}

// Arrows (dx, dy) from (x, y). The longest but 5 % has half a pitch; returns what that stands for.
export function drawArrows(context, view, arrows, pitch, colour) {
  const [, longest] = quantiles(arrows.map((a) => Math.hypot(a.dx, a.dy)), 0, 0.95);
  if (!(longest > 0)) return 0;
  const times = (0.5 * pitch) / longest;
  const drawPath = () => {
    context.beginPath();
    for (const {x, y, dx, dy} of arrows) {
      const [x0, y0] = view.toScreen(x, y);
      const [x1, y1] = view.toScreen(x + times * dx, y + times * dy);
      const length = Math.hypot(x1 - x0, y1 - y0);
      const head = Math.min(5, 0.4 * length);
      const angle = Math.atan2(y1 - y0, x1 - x0);
      context.moveTo(x0, y0);
      context.lineTo(x1, y1);
      for (const turn of [2.6, -2.6]) {
        context.moveTo(x1, y1);
        context.lineTo(x1 + head * Math.cos(angle + turn), y1 + head * Math.sin(angle + turn));
      }
    }
    context.stroke();
  };
  context.lineWidth = 2.5;
  context.strokeStyle = 'rgba(0,0,0,0.45)';
  drawPath();
  context.lineWidth = 1.2;
  context.strokeStyle = colour;
  drawPath();
  return longest;
}

// Returns the slopes of a frame as arrows from the centres of lenslets.
export function slopeArrows(frame) {
  const {slope_x, slope_y, slope_valid} = frame.maps;
  const arrows = [];
  for (let k = 0; k < slope_x.values.length; ++k)
    if (slope_valid.values[k])
      arrows.push({
        x: k % slope_x.cols, y: Math.floor(k / slope_x.cols),
        dx: slope_x.values[k], dy: slope_y.values[k],
      });
  return arrows;
}

// Returns where a place in lenslet units is on the detector.
export function pixelFromLenslet(sensor, x, y) {
  const [p11, p12, p21, p22] = sensor.p_px;
  return [sensor.origin_px[0] + p11 * x + p12 * y, sensor.origin_px[1] + p21 * x + p22 * y];
}

// A cross at the beam's centroid and the ellipse of its D4σ, in lenslet units.
export function drawBeam(context, view, beam) {
  if (beam.without) return;
  const [x, y] = view.toScreen(beam.x, beam.y);
  for (const [width, style] of [[4, 'rgba(0,0,0,0.6)'], [2, '#ffffff']]) {
    context.lineWidth = width;
    context.strokeStyle = style;
    context.beginPath();
    context.ellipse(x, y, beam.d4sigma_x / 2 * view.scale, beam.d4sigma_y / 2 * view.scale, 0, 0,
      2 * Math.PI);
    context.moveTo(x - 6, y);
    context.lineTo(x + 6, y);
    context.moveTo(x, y - 6);
    context.lineTo(x, y + 6);
    context.stroke();
  }
}

// Circles with the sign inside. place(x, y) takes lenslet units to the view's; pitch is in those.
export function drawVortices(context, view, vortices, place, pitch) {
  const radius = Math.max(6, 0.45 * pitch * view.scale);
  for (const vortex of vortices) {
    const [x, y] = view.toScreen(...place(vortex.x, vortex.y));
    const sign = 0.5 * radius;
    const colour = vortex.charge > 0 ? kPlus : vortex.charge < 0 ? kMinus : kPair;
    for (const [width, style] of [[5, 'rgba(255,255,255,0.9)'], [2.5, colour]]) {
      context.lineWidth = width;
      context.strokeStyle = style;
      context.beginPath();
      context.arc(x, y, radius, 0, 2 * Math.PI);
      if (vortex.charge !== 0) {
        context.moveTo(x - sign, y);
        context.lineTo(x + sign, y);
      }
      if (vortex.charge > 0) {
        context.moveTo(x, y - sign);
        context.lineTo(x, y + sign);
      }
      context.stroke();
    }
  }
}

// tails: Map from the number of a track to its places in lenslet units, the last one now.
export function drawTracks(context, view, tails, place) {
  context.textAlign = 'left';
  context.textBaseline = 'bottom';
  for (const [track, tail] of tails) {
    context.beginPath();
    tail.places.forEach(([x, y], i) => {
      const [sx, sy] = view.toScreen(...place(x, y));
      if (i === 0) context.moveTo(sx, sy);
      else context.lineTo(sx, sy);
    });
    context.lineWidth = 1.5;
    context.strokeStyle = tail.charge > 0 ? kPlus : kMinus;
    context.stroke();
    const [x, y] = view.toScreen(...place(...tail.places.at(-1)));
    context.lineWidth = 3;
    context.strokeStyle = themeColour('--panel');
    context.strokeText(track, x + 9, y - 7);
    context.fillStyle = themeColour('--text');
    context.fillText(track, x + 9, y - 7);
  }
}
