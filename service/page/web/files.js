// Saves what is shown: a picture as PNG, a frame with its results as FITS.

function offer(blob, name) {
  const link = document.createElement('a');
  link.href = URL.createObjectURL(blob);
  link.download = name;
  link.click();
  setTimeout(() => URL.revokeObjectURL(link.href), 10000);
}

export function savePng(canvas, name, background) {
  const copy = document.createElement('canvas');
  copy.width = canvas.width;
  copy.height = canvas.height;
  const context = copy.getContext('2d');
  context.fillStyle = background;
  context.fillRect(0, 0, copy.width, copy.height);
  context.drawImage(canvas, 0, 0);
  copy.toBlob((blob) => offer(blob, name));
}

const kBlock = 2880;

function card(key, value, comment = '') {
  let text = value;
  if (typeof value === 'string') text = `'${value.replaceAll("'", "''").padEnd(8)}'`;
  else if (typeof value === 'boolean') text = (value ? 'T' : 'F').padStart(20);
  else text = String(value).padStart(20);
  return `${key.padEnd(8)}= ${text}${comment ? ` / ${comment}` : ''}`.padEnd(80).slice(0, 80);
}

function padded(bytes, filler) {
  const all = new Uint8Array(Math.ceil(bytes.length / kBlock) * kBlock).fill(filler);
  all.set(bytes);
  return all;
}

// Returns one HDU. FITS is big-endian, and has unsigned 16-bit numbers by an offset of 32768.
function imageHdu(map, first, cards) {
  const {values, rows, cols} = map;
  const width = values.BYTES_PER_ELEMENT;
  const isFloat = values instanceof Float32Array;
  const lines = [
    first ? card('SIMPLE', true) : card('XTENSION', 'IMAGE'),
    card('BITPIX', isFloat ? -32 : 8 * width), card('NAXIS', 2), card('NAXIS1', cols),
    card('NAXIS2', rows)];
  if (first) lines.push(card('EXTEND', true));
  else lines.push(card('PCOUNT', 0), card('GCOUNT', 1));
  if (width === 2) lines.push(card('BZERO', 32768), card('BSCALE', 1));
  const header = new TextEncoder().encode([...lines, ...cards, 'END'.padEnd(80)].join(''));
  const data = new DataView(new ArrayBuffer(values.length * width));
  for (let i = 0; i < values.length; ++i) {
    if (isFloat) data.setFloat32(4 * i, values[i]);
    else if (width === 2) data.setInt16(2 * i, values[i] - 32768);
    else data.setUint8(i, values[i]);
  }
  return [padded(header, 32), padded(new Uint8Array(data.buffer), 0)];
}

// Returns the bytes of a FITS file: the frame's pixels as they came, then an image for each map.
export function fitsOf(frame, sensor) {
  const {result} = frame;
  const units = {x_px: 'px', y_px: 'px', flux_adu: 'adu', phase_rad: 'rad', whole_phase_rad: 'rad',
    circulation_rad: 'rad', slope_x: 'rad/pitch', slope_y: 'rad/pitch'};
  const cards = [card('CREATOR', sensor.program), card('FRAME', result.frame, 'from 0'),
    card('SEQUENCE', result.sequence, 'by the camera'), card('NVORTEX', result.vortices.length),
    card('CONFHASH', sensor.configuration_hash), card('SENSHASH', sensor.sensor_hash)];
  const parts = imageHdu(frame.maps.pixels, true, cards);
  for (const [name, map] of Object.entries(frame.maps)) {
    if (name === 'pixels') continue;
    const unit = units[name] ? [card('BUNIT', units[name])] : [];
    parts.push(...imageHdu(map, false, [card('EXTNAME', name.toUpperCase()), ...unit]));
  }
  return parts;
}

export function saveFits(frame, sensor) {
  const blob = new Blob(fitsOf(frame, sensor), {type: 'application/fits'});
  offer(blob, `curlew-frame-${frame.result.frame}.fits`);
}
