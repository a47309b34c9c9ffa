// Small charts: lines over frames, bars of Zernike coefficients, the histogram of latencies.
import { colourAt, kRamps, themeColour } from './colours.js';
import { niceStep, sharpContext, short } from './canvas.js';

const kLeft = 44;
const kBottom = 16;

function drawFrame(context, width, height, low, high, unit) {
  const at = (v) => 6 + (height - kBottom - 6) * (1 - (v - low) / (high - low));
  context.textAlign = 'right';
  context.textBaseline = 'middle';
  const step = niceStep(high - low, Math.max(2, height / 34));
  for (let v = Math.ceil(low / step) * step; v <= high + 1e-9 * step; v += step) {
    context.fillStyle = themeColour('--muted');
    context.fillText(short(Math.abs(v) < step / 1e6 ? 0 : v), kLeft - 5, at(v));
    context.fillStyle = themeColour('--line');
    context.fillRect(kLeft, Math.round(at(v)), width - kLeft, 1);
  }
  context.fillStyle = themeColour('--muted');
  context.textAlign = 'left';
  context.textBaseline = 'top';
  context.fillText(unit, kLeft + 4, 2);
  return at;
}

// series: [{name, colour, values}] of one length; a value that is no number leaves a gap. x: the
// numbers of the frames. signed: else the axis begins at 0. now: which of them is shown; none: the last.
export function drawLines(canvas, series, unit, x, isSigned = false, now = null) {
  const {context, width, height} = sharpContext(canvas);
  const all = series.flatMap((s) => s.values.filter((v) => Number.isFinite(v)));
  if (all.length === 0) return;
  let low = isSigned ? Math.min(...all) : 0;
  let high = Math.max(...all);
  const room = Math.max(0.1 * (high - low), isSigned ? 0.02 : 1e-3);
  if (isSigned) low -= room;
  high += room;
  const at = drawFrame(context, width, height, low, high, unit);
  series.forEach(({name, colour, values}, which) => {
    const step = (width - kLeft - 6) / Math.max(1, values.length - 1);
    context.beginPath();
    let drawing = false;
    values.forEach((v, i) => {
      if (!Number.isFinite(v)) drawing = false;
      else if (drawing) context.lineTo(kLeft + 2 + i * step, at(v));
      else context.moveTo(kLeft + 2 + i * step, at(v));
      const isAlone = !Number.isFinite(values[i - 1]) && !Number.isFinite(values[i + 1]);
      if (isAlone && Number.isFinite(v)) context.rect(kLeft + 1 + i * step, at(v) - 1, 2, 2);
      drawing = Number.isFinite(v);
    });
    context.lineWidth = 1.5;
    context.strokeStyle = colour;
    context.setLineDash(which === 1 ? [5, 2] : []);
    context.stroke();
    context.setLineDash([]);
    context.fillStyle = colour;
    context.textAlign = 'right';
    context.textBaseline = 'top';
    context.fillText(`${which === 1 ? '╌' : '─'} ${name}`, width - 4 - 90 * which, 2);
  });
  drawFrames(context, width, height, x, now);
}

// Says which frames there are, and marks the one that is shown.
function drawFrames(context, width, height, x, now) {
  context.fillStyle = themeColour('--muted');
  context.textAlign = 'right';
  context.textBaseline = 'bottom';
  context.fillText(`frames ${x[0]} … ${x.at(-1)}`, width - 4, height);
  if (now === null || now < 0) return;
  const at = kLeft + 2 + now * (width - kLeft - 6) / Math.max(1, x.length - 1);
  context.fillRect(at - 0.5, 4, 1, height - kBottom - 4);
}

// points: [{frame, tracks: [[track, charge, x, y] …]}]; which: 2 draws x of the tracks, 3 draws y.
// Negative ones are dashed. A track that pauses leaves a gap.
export function drawTrackLines(canvas, points, which, unit, most, now) {
  const {context, width, height} = sharpContext(canvas);
  const at = drawFrame(context, width, height, -0.5, most - 0.5, unit);
  const step = (width - kLeft - 6) / Math.max(1, points.length - 1);
  const last = new Map();
  for (const charge of [1, -1]) {
    context.beginPath();
    context.setLineDash(charge < 0 ? [4, 2] : []);
    context.strokeStyle = charge > 0 ? '#d55e00' : '#0072b2';
    context.lineWidth = 1.5;
    points.forEach((point, i) => {
      for (const track of point.tracks) {
        if (track[1] !== charge) continue;
        const before = last.get(track[0]);
        const here = [kLeft + 2 + i * step, at(track[which])];
        if (before?.i === i - 1) context.moveTo(...before.here);
        else context.moveTo(here[0] - 1, here[1]);
        context.lineTo(...here);
        last.set(track[0], {i, here});
      }
    });
    context.stroke();
  }
  context.setLineDash([]);
  drawFrames(context, width, height, points.map((p) => p.frame), now);
}

// coefficients: [{j, rad}]. Returns which bar is at which x, for readouts.
export function drawZernike(canvas, coefficients) {
  const {context, width, height} = sharpContext(canvas);
  if (coefficients.length === 0) return null;
  const largest = Math.max(1e-3, ...coefficients.map((c) => Math.abs(c.rad)));
  const at = drawFrame(context, width, height, -1.1 * largest, 1.1 * largest, 'rad rms, by Noll’s j');
  const step = (width - kLeft) / coefficients.length;
  context.textAlign = 'center';
  context.textBaseline = 'bottom';
  coefficients.forEach(({j, rad}, i) => {
    context.fillStyle = colourAt(kRamps.signed, 0.5 + (0.36 * Math.sign(rad)));
    context.fillRect(kLeft + i * step + 1, Math.min(at(0), at(rad)), Math.max(1, step - 2),
      Math.max(1, Math.abs(at(rad) - at(0))));
    context.fillStyle = themeColour('--muted');
    if (step > 14 ? j % 2 === 0 : j % 6 === 4) context.fillText(j, kLeft + (i + 0.5) * step, height);
  });
  return (sx) => coefficients[Math.floor((sx - kLeft) / step)];
}

// histogram: {edges_us, counts}; both axes are logarithmic.
export function drawHistogram(canvas, {edges_us, counts}) {
  const {context, width, height} = sharpContext(canvas);
  const first = counts.findIndex((n) => n > 0);
  if (first < 0) return null;
  const from = Math.max(0, first - 2);
  const to = Math.min(counts.length, counts.findLastIndex((n) => n > 0) + 3);
  const most = Math.max(...counts);
  const high = Math.log10(most) + 0.3;
  const at = (n) => (height - kBottom) * (1 - (Math.log10(n) + 0.5) / (high + 0.5)) + 4;
  const step = (width - kLeft) / (to - from);
  context.textBaseline = 'middle';
  context.textAlign = 'right';
  for (let n = 1; n <= most; n *= 10) {
    context.fillStyle = themeColour('--muted');
    context.fillText(short(n), kLeft - 5, at(n));
    context.fillStyle = themeColour('--line');
    context.fillRect(kLeft, Math.round(at(n)), width - kLeft, 1);
  }
  context.fillStyle = themeColour('--muted');
  context.fillText('µs', width - 2, 8);
  context.textAlign = 'center';
  context.textBaseline = 'bottom';
  const every = Math.ceil((to - from) / 7);
  for (let i = from; i < to; ++i) {
    const x = kLeft + (i - from) * step;
    context.fillStyle = themeColour('--accent');
    if (counts[i] > 0) context.fillRect(x + 0.5, at(counts[i]), step - 1, height - kBottom - at(counts[i]));
    context.fillStyle = themeColour('--muted');
    if ((i - from) % every === 0 && x < width - 16) context.fillText(short(edges_us[i]), x, height);
  }
  return (sx) => {
    const i = from + Math.floor((sx - kLeft) / step);
    return i >= from && i < to ? {low: edges_us[i], high: edges_us[i + 1], count: counts[i]} : null;
  };
}
