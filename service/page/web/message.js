// A message from the program: JSON, and the arrays that it lists (service/page/page_message.h).

const kArrayTypes = {f32: Float32Array, i32: Int32Array, u16: Uint16Array, u8: Uint8Array};

// Returns the JSON with `maps`: for each array its rows, cols and values, row by row.
export function readMessage(buffer) {
  const length = new DataView(buffer).getUint32(0, true);
  const message = JSON.parse(new TextDecoder().decode(new Uint8Array(buffer, 4, length)));
  message.maps = {};
  let at = 4 + length;
  for (const {name, type, rows, cols} of message.arrays) {
    const values = new kArrayTypes[type](buffer, at, rows * cols);
    message.maps[name] = {rows, cols, values};
    at += Math.ceil(values.byteLength / 4) * 4;
  }
  return message;
}
