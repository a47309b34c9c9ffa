// Colours that people with any colour vision tell apart.

// Why a lenslet has a slope or none, in the order of LensletState. Colours are those of Okabe and
// Ito; dashes tell the states apart without colour.
export const kStates = [
  {name: 'valid', colour: '#009e73', dash: []},
  {name: 'unlit', colour: '#808080', dash: [1, 3]},
  {name: 'faint', colour: '#999999', dash: [2, 2]},
  {name: 'saturated', colour: '#e69f00', dash: []},
  {name: 'at its window’s edge', colour: '#f0e442', dash: [4, 2]},
  {name: 'bad pixels', colour: '#cc79a7', dash: [3, 1, 1, 1]},
  {name: 'lost', colour: '#d55e00', dash: [6, 2]},
];

export const kPlus = '#e8632c';
export const kMinus = '#3f8fe0';
export const kPair = '#9a9a9a';

const kViridis = ['#440154', '#482878', '#3e4989', '#31688e', '#26828e', '#1f9e89', '#35b779',
  '#6ece58', '#b5de2b', '#fde725'];
// Blue below zero and brown above it; the middle is light.
const kBlueBrown = ['#0b2f5b', '#1f5c99', '#5b96c7', '#a9cbe0', '#f1efec', '#e3c09f', '#c98852',
  '#97551f', '#552a08'];
const kGrey = ['#000000', '#ffffff'];

function channels(colour) {
  return [1, 3, 5].map((at) => parseInt(colour.slice(at, at + 2), 16));
}

// Returns 256 colours as bytes of red, green and blue.
function ramp(stops) {
  const table = new Uint8Array(256 * 3);
  for (let i = 0; i < 256; ++i) {
    const place = (i / 255) * (stops.length - 1);
    const low = Math.min(Math.floor(place), stops.length - 2);
    const a = channels(stops[low]);
    const b = channels(stops[low + 1]);
    for (let c = 0; c < 3; ++c) table[3 * i + c] = a[c] + (b[c] - a[c]) * (place - low);
  }
  return table;
}

export const kRamps = {light: ramp(kViridis), signed: ramp(kBlueBrown), grey: ramp(kGrey)};

// Returns the colour at a fraction of a ramp, for CSS.
export function colourAt(table, fraction) {
  const i = 3 * Math.round(255 * Math.min(1, Math.max(0, fraction)));
  return `rgb(${table[i]},${table[i + 1]},${table[i + 2]})`;
}

// Returns a colour of the page's theme, by the name of its CSS variable.
export function themeColour(name) {
  return getComputedStyle(document.documentElement).getPropertyValue(name).trim();
}
