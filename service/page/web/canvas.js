// A MapView is a canvas that shows a map with axes and a colour bar, to pan and zoom.
import { colourAt, themeColour } from './colours.js';

const kMargin = {left: 40, top: 8, bottom: 20};
const kBarWidth = 12;
const kFarthest = 60;

export function niceStep(span, most) {
  const raw = span / Math.max(1, most);
  const decade = 10 ** Math.floor(Math.log10(raw));
  return [1, 2, 5, 10].map((f) => f * decade).find((step) => step >= raw * 0.999);
}

// Returns a number with three significant digits or so.
export function short(value) {
  if (value === null || !Number.isFinite(value)) return '–';
  if (value === 0) return '0';
  const size = Math.abs(value);
  if (size >= 1e6 || size < 1e-3) return value.toExponential(1);
  return size >= 100 ? value.toFixed(0) : Number(value.toPrecision(3)).toString();
}

// Makes a canvas as fine as the screen. Returns its context, in CSS pixels.
export function sharpContext(canvas) {
  const ratio = window.devicePixelRatio || 1;
  const width = canvas.clientWidth;
  const height = canvas.clientHeight;
  if (canvas.width !== Math.round(width * ratio) || canvas.height !== Math.round(height * ratio)) {
    canvas.width = Math.round(width * ratio);
    canvas.height = Math.round(height * ratio);
  }
  const context = canvas.getContext('2d');
  context.setTransform(ratio, 0, 0, ratio, 0, 0);
  context.clearRect(0, 0, width, height);
  context.font = '11px system-ui, sans-serif';
  return {context, width, height};
}

export class MapView {
  // content: {extent() → {cols, rows} or null, draw(context, view), bar() → {table, low, high,
  // units} or null, axes: [x, y], hover(x, y), pick(x, y), move(dx, dy)}. Places are in pixels or
  // lenslets: the centre of the first is (0, 0), and y grows downwards. Views that share a camera
  // pan and zoom together.
  constructor(canvas, content, camera = {zoom: 1, x: 0, y: 0, views: []}) {
    this.canvas = canvas;
    this.content = content;
    this.camera = camera;
    camera.views.push(this);
    this.pointers = new Map();
    this.listen();
    new ResizeObserver(() => this.redraw()).observe(canvas);
  }

  place() {
    const extent = this.content.extent();
    if (!extent) return false;
    const bar = this.content.bar?.();
    const right = bar ? 40 * bar.units.length + 8 + kBarWidth : 10;
    const width = this.canvas.clientWidth - kMargin.left - right;
    const height = this.canvas.clientHeight - kMargin.top - kMargin.bottom;
    this.scale = this.camera.zoom * Math.min(width / extent.cols, height / extent.rows);
    this.box = {x: kMargin.left, y: kMargin.top, width, height};
    const middle = [(extent.cols - 1) / 2 + this.camera.x, (extent.rows - 1) / 2 + this.camera.y];
    this.x0 = kMargin.left + width / 2 - middle[0] * this.scale;
    this.y0 = kMargin.top + height / 2 - middle[1] * this.scale;
    return true;
  }
  toScreen(x, y) { return [this.x0 + x * this.scale, this.y0 + y * this.scale]; }
  toWorld(sx, sy) { return [(sx - this.x0) / this.scale, (sy - this.y0) / this.scale]; }

  redraw() {
    if (this.canvas.clientWidth === 0) return;
    const {context} = sharpContext(this.canvas);
    if (!this.place()) return;
    const {x, y, width, height} = this.box;
    context.save();
    context.beginPath();
    context.rect(x, y, width, height);
    context.clip();
    context.fillStyle = themeColour('--void');  // where there is no lenslet
    const extent = this.content.extent();
    context.fillRect(...this.toScreen(-0.5, -0.5), extent.cols * this.scale,
      extent.rows * this.scale);
    this.content.draw(context, this);
    context.restore();
    this.drawAxes(context);
    const bar = this.content.bar?.();
    if (bar) this.drawBar(context, bar);
  }

  drawAxes(context) {
    const {x, y, width, height} = this.box;
    const [nameX, nameY] = this.content.axes;
    context.fillStyle = context.strokeStyle = themeColour('--muted');
    context.lineWidth = 1;
    context.textAlign = 'center';
    context.textBaseline = 'top';
    const step = Math.max(1, niceStep(width / this.scale, width / 50));
    const first = this.toWorld(x, y);
    const last = this.toWorld(x + width, y + height);
    const extent = this.content.extent();
    for (let v = Math.max(0, Math.ceil(first[0] / step) * step);
      v <= Math.min(last[0], extent.cols - 1); v += step)
      if (this.toScreen(v, 0)[0] < x + width - 50)
        context.fillText(v, this.toScreen(v, 0)[0], y + height + 4);
    context.textAlign = 'right';
    context.textBaseline = 'middle';
    for (let v = Math.max(0, Math.ceil(first[1] / step) * step);
      v <= Math.min(last[1], extent.rows - 1); v += step)
      context.fillText(v, x - 4, this.toScreen(0, v)[1]);
    context.textBaseline = 'bottom';
    context.fillText(`${nameX} →`, x + width, this.canvas.clientHeight - 2);
    context.save();
    context.translate(11, y);
    context.rotate(-Math.PI / 2);
    context.textAlign = 'right';
    context.fillText(`← ${nameY}`, 0, 0);
    context.restore();
  }

  drawBar(context, {table, low, high, units}) {
    const {y, height} = this.box;
    const x = this.box.x + this.box.width + 8;
    for (let i = 0; i < height; ++i) {
      context.fillStyle = colourAt(table, 1 - i / (height - 1));
      context.fillRect(x, y + i, kBarWidth, 1.5);
    }
    context.textAlign = 'left';
    context.textBaseline = 'middle';
    units.forEach(({name, factor}, column) => {
      const left = x + kBarWidth + 4 + 40 * column;
      const step = niceStep((high - low) * factor, Math.min(6, height / 30));
      context.fillStyle = themeColour('--muted');
      for (let v = Math.ceil((low * factor) / step) * step; v <= high * factor + 1e-9 * step;
        v += step) {
        const at = y + height * (1 - (v / factor - low) / (high - low));
        if (at < y + 4 || at > y + height - 4) continue;
        context.fillText(short(Math.abs(v) < step / 1e6 ? 0 : v), left, at);
      }
      context.fillStyle = themeColour('--text');
      context.fillText(name, left, y + height + 11);
    });
  }

  redrawAll() { for (const view of this.camera.views) view.redraw(); }

  reset() {
    Object.assign(this.camera, {zoom: 1, x: 0, y: 0});
    this.redrawAll();
  }
  // Zooms by a factor; what is at (sx, sy) on the screen stays there.
  zoomAt(factor, sx, sy) {
    if (!this.place()) return;
    const [x, y] = this.toWorld(sx, sy);
    this.camera.zoom = Math.min(kFarthest, Math.max(1, this.camera.zoom * factor));
    if (this.camera.zoom === 1) return this.reset();
    this.place();
    const [nx, ny] = this.toScreen(x, y);
    this.pan(sx - nx, sy - ny);
  }
  pan(dx, dy) {
    this.camera.x -= dx / this.scale;
    this.camera.y -= dy / this.scale;
    this.redrawAll();
  }

  listen() {
    const {canvas} = this;
    const at = (event) => [event.offsetX, event.offsetY];
    canvas.addEventListener('wheel', (event) => {
      event.preventDefault();
      this.zoomAt(Math.exp(-0.0015 * event.deltaY), ...at(event));
    }, {passive: false});
    canvas.addEventListener('dblclick', () => this.reset());
    canvas.addEventListener('pointerdown', (event) => {
      canvas.setPointerCapture(event.pointerId);
      this.pointers.set(event.pointerId, at(event));
      this.moved = this.pointers.size > 1;
    });
    canvas.addEventListener('pointermove', (event) => this.pointerMoved(event, at(event)));
    canvas.addEventListener('pointerup', (event) => {
      this.pointers.delete(event.pointerId);
      if (!this.moved && this.place()) this.content.pick?.(...this.toWorld(...at(event)));
    });
    canvas.addEventListener('pointercancel', (event) => this.pointers.delete(event.pointerId));
    canvas.addEventListener('pointerleave', () => this.content.hover?.(null, null));
    canvas.addEventListener('keydown', (event) => this.keyPressed(event));
  }

  pointerMoved(event, now) {
    canvasTouch(this.canvas, this.camera.zoom);
    const before = this.pointers.get(event.pointerId);
    if (!before) {
      if (this.place()) this.content.hover?.(...this.toWorld(...now));
      return;
    }
    const [dx, dy] = [now[0] - before[0], now[1] - before[1]];
    if (Math.hypot(dx, dy) < 4 && !this.moved) return;
    this.moved = true;
    this.pointers.set(event.pointerId, now);
    if (this.pointers.size === 2) {
      const other = [...this.pointers].find(([id]) => id !== event.pointerId)[1];
      const apart = (a) => Math.max(1, Math.hypot(a[0] - other[0], a[1] - other[1]));
      this.zoomAt(apart(now) / apart(before), (now[0] + other[0]) / 2, (now[1] + other[1]) / 2);
    } else if (this.camera.zoom > 1) {
      this.pan(dx, dy);
    }
  }

  keyPressed(event) {
    const middle = [this.canvas.clientWidth / 2, this.canvas.clientHeight / 2];
    const actions = {
      '+': () => this.zoomAt(1.5, ...middle),
      '=': () => this.zoomAt(1.5, ...middle),
      '-': () => this.zoomAt(1 / 1.5, ...middle),
      0: () => this.reset(),
      ArrowLeft: () => this.content.move?.(-1, 0),
      ArrowRight: () => this.content.move?.(1, 0),
      ArrowUp: () => this.content.move?.(0, -1),
      ArrowDown: () => this.content.move?.(0, 1),
    };
    if (!actions[event.key]) return;
    event.preventDefault();
    event.stopPropagation();
    actions[event.key]();
  }
}

// One finger scrolls the page while the whole map is shown, and the map while it is enlarged.
function canvasTouch(canvas, zoom) {
  canvas.style.touchAction = zoom > 1 ? 'none' : 'pan-y';
}
