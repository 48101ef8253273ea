// How programs write arrays that node_package.py reads.
"use strict";
const fs = require("fs");

// At once: what process.stdout is given may wait for what V8 compiles.
function writeBytes(bytes) {
  for (let at = 0; at < bytes.length;) at += fs.writeSync(1, bytes, at);
}

// Arrays by name, each with its shape and numbers: a line of JSON with the shapes, then the numbers, little-endian
// float64.
function write(arrays) {
  const shapes = Object.entries(arrays).map(([name, { shape }]) => [name, shape]);
  writeBytes(Buffer.from(JSON.stringify(Object.fromEntries(shapes)) + "\n"));
  for (const { numbers } of Object.values(arrays)) writeBytes(Buffer.from(numbers.buffer));
}

// Nested arrays, all those of a depth of one length, as `write` takes them.
function flat(nested) {
  const shape = (values) => Array.isArray(values) ? [values.length, ...shape(values[0] ?? 0)] : [];
  return { shape: shape(nested), numbers: new Float64Array(nested.flat(Infinity)) };
}

module.exports = { flat, write };
