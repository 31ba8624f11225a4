// Vertex attributes of leaves, under the names that the shaders read. WebGL has room for 16, and instances take four.

/** The place on the billboards; rank and pivot; pivot on the billboard and phase; pivot of the billboard and freedom. */
export const ATTRIBUTES = { lcTarget: 3, lcLeaf: 4, lcOnBillboard: 4, lcBillboard: 4 };

/** Gives the mesh of leaves its attributes. Leaves without numbers are never pruned, and turn about themselves. */
export function addAttributes(mesh, { count, positions, sets, offsets }) {
  const number = (vertex, place) => sets[place >> 1]?.[2 * vertex + (place % 2)];
  const filled = (width, at) => Float32Array.from({ length: width * count }, (_, i) => at(Math.floor(i / width), i % width));
  const pivot = (vertex, axis) => number(vertex, 1 + axis) ?? positions[3 * vertex + axis];
  const row = (vertex, first, last) => (i) => (i < 3 ? (number(vertex, first + i) ?? pivot(vertex, i)) : (number(vertex, last) ?? 0));
  const values = {
    lcTarget: positions.map((value, i) => value + (offsets?.[i] ?? 0)),
    lcLeaf: filled(4, (vertex, i) => (i === 0 ? (number(vertex, 0) ?? -1) : pivot(vertex, i - 1))),
    lcOnBillboard: filled(4, (vertex, i) => row(vertex, 4, 7)(i)),
    lcBillboard: filled(4, (vertex, i) => row(vertex, 8, 11)(i)),
  };
  for (const [name, width] of Object.entries(ATTRIBUTES)) mesh.setVerticesData(name, values[name], false, width);
}
