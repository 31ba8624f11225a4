// GLB files: the document, changed before Babylon.js reads it.

const JSON_CHUNK = 0x4e4f534a;

const INSTANCING = "EXT_mesh_gpu_instancing";

/** Returns the JSON document of a GLB file, and the chunks behind it. */
export function split(content) {
  const view = new DataView(content);
  if (content.byteLength < 20 || view.getUint32(0, true) !== 0x46546c67 || view.getUint32(16, true) !== JSON_CHUNK) {
    throw new Error("This is no GLB file: load a NAME.glb that Leafcloud wrote.");
  }
  const end = 20 + view.getUint32(12, true);
  const document = JSON.parse(new TextDecoder().decode(new Uint8Array(content, 20, end - 20)));
  return { document, rest: new Uint8Array(content, end) };
}

/** Returns the bytes of a GLB file of a document and the chunks behind it. */
export function joined(document, rest) {
  const text = new TextEncoder().encode(JSON.stringify(document));
  const size = 4 * Math.ceil(text.length / 4);
  const bytes = new Uint8Array(20 + size + rest.length).fill(0x20, 20, 20 + size);
  const view = new DataView(bytes.buffer);
  [0x46546c67, 2, bytes.length, size, JSON_CHUNK].forEach((number, i) => view.setUint32(4 * i, number, true));
  bytes.set(text, 20);
  bytes.set(rest, 20 + size);
  return bytes;
}

/** Number of components of an accessor's element. */
const WIDTHS = { SCALAR: 1, VEC2: 2, VEC3: 3, VEC4: 4 };

/** Returns the floats of an accessor, element by element. `rest`: the chunks behind the document; the first has the data. */
export function floatsOf(document, rest, number) {
  const { bufferView, byteOffset, count, type, componentType, normalized, sparse } = document.accessors[number];
  const width = WIDTHS[type];
  if (componentType !== 5126 || normalized || "EXT_meshopt_compression" in (document.bufferViews[bufferView]?.extensions ?? {})) {
    throw new Error("The meshes of this file are compressed or quantized: bake with --engine babylon, and without --compress.");
  }
  const start = rest.byteOffset + 8; // Behind the header of the chunk.
  const at = (view, offset = 0) => start + (document.bufferViews[view].byteOffset ?? 0) + offset;
  const values = new Float32Array(count * width);
  if (bufferView !== undefined) {
    const stride = (document.bufferViews[bufferView].byteStride ?? 4 * width) / 4;
    const from = new Float32Array(rest.buffer, at(bufferView, byteOffset), (count - 1) * stride + width);
    values.forEach((_, i) => (values[i] = from[Math.floor(i / width) * stride + (i % width)]));
  }
  if (sparse) {
    const { indices, values: own } = sparse;
    const places = new INTEGERS[indices.componentType](rest.buffer, at(indices.bufferView, indices.byteOffset), sparse.count);
    const changed = new Float32Array(rest.buffer, at(own.bufferView, own.byteOffset), sparse.count * width);
    places.forEach((place, i) => values.set(changed.subarray(i * width, (i + 1) * width), place * width));
  }
  return values;
}

const INTEGERS = { 5121: Uint8Array, 5123: Uint16Array, 5125: Uint32Array };

/** Returns the numbers of the nodes of each tree's levels. A file of one level has one for each tree. */
function chainsIn({ nodes }) {
  const hasLevel = (node) => node.extras?.leafcloud?.level !== undefined;
  const behind = nodes.flatMap(({ extensions }) => extensions?.MSFT_lod?.ids ?? []);
  const firsts = nodes.map((_, number) => number).filter((number) => hasLevel(nodes[number]) && !behind.includes(number));
  return firsts.map((number) => [number, ...(nodes[number].extensions?.MSFT_lod?.ids ?? [])]);
}

/**
 * Shows all levels of tree number `tree` in the scene: Babylon.js reads MSFT_lod as steps of loading. Without `ktx2` the PNG
 * textures are read.
 */
export function withLevels(document, { ktx2, tree }) {
  const chains = chainsIn(document);
  const { nodes } = document.scenes[document.scene ?? 0];
  document.scenes[document.scene ?? 0].nodes = [...nodes.filter((node) => !chains.flat().includes(node)), ...chains[tree]];
  for (const { extensions } of document.nodes) {
    delete extensions?.MSFT_lod;
    delete extensions?.[INSTANCING]; // Babylon.js would draw level 0 at all places.
  }
  if (!ktx2) document.textures?.forEach(({ extensions }) => delete extensions?.KHR_texture_basisu);
  document.meshes.forEach(({ primitives }) => primitives.forEach(withoutNumbers));
  return document;
}

/** Babylon.js would read some of the numbers, as texture coordinates and morph targets of its own. */
function withoutNumbers(primitive) {
  delete primitive.targets;
  const isNumber = (name) => name.startsWith("TEXCOORD_") && name !== "TEXCOORD_0";
  Object.keys(primitive.attributes).filter(isNumber).forEach((name) => delete primitive.attributes[name]);
}

/**
 * Returns the levels of tree number `tree`: their nodes' names and extras, the tables of their meshes, the numbers of their
 * leaves, and the images of an octahedral impostor.
 */
export function levelsIn(document, rest, tree) {
  const chains = chainsIn(document);
  if (chains.length === 0) throw new Error("No levels in this file: load a NAME.glb that Leafcloud wrote.");
  if (!chains[tree]) throw new Error(`The file has ${chains.length} trees, and no tree ${tree}: choose a smaller number.`);
  return chains[tree]
    .map((number) => document.nodes[number])
    .map(({ name, mesh, extras }) => {
      const { primitives, extras: own } = document.meshes[mesh];
      const tables = own?.leafcloud ?? {};
      const leaves = primitives.slice(0, tables.first_trunk_primitive ?? primitives.length);
      const numbers = leaves.map((each) => numbersOf(document, rest, tables, each));
      return { name, extras: extras.leafcloud, tables, numbers, images: imagesOf(document, rest, primitives[0].material) };
    })
    .sort((a, b) => a.extras.level - b.extras.level);
}

/** Returns the translations, rotations and scales of the instances of a tree's level 0; null in a file of one tree. */
export function instancesIn(document, rest, tree) {
  const { attributes } = document.nodes[chainsIn(document)[tree][0]].extensions?.[INSTANCING] ?? {};
  if (!attributes) return null;
  const [translations, rotations, scales] = ["TRANSLATION", "ROTATION", "SCALE"].map((name) =>
    name in attributes ? floatsOf(document, rest, attributes[name]) : null,
  );
  const { count } = document.accessors[Object.values(attributes)[0]];
  return Array.from({ length: count }, (_, i) => ({
    translation: translations?.subarray(3 * i, 3 * i + 3) ?? [0, 0, 0],
    rotation: rotations?.subarray(4 * i, 4 * i + 4) ?? [0, 0, 0, 1],
    scale: scales?.subarray(3 * i, 3 * i + 3) ?? [1, 1, 1],
  }));
}

/** Returns the floats of a primitive's sets of texture coordinates with numbers, and of its morph target. */
function numbersOf(document, rest, { first_texcoord: first, prefixes }, { attributes, targets }) {
  if (prefixes && !first) throw new Error("The file has numbers that Babylon.js drops: bake with --engine babylon.");
  const count = document.accessors[attributes.POSITION].count;
  const sets = Array.from({ length: 6 }, (_, i) => attributes[`TEXCOORD_${(first ?? Infinity) + i}`]);
  const read = (number) => (number === undefined ? null : floatsOf(document, rest, number));
  return { count, positions: read(attributes.POSITION), sets: sets.map(read), offsets: read(targets?.[0].POSITION) };
}

/** Returns the bytes {color, normalDepth} of the PNG files of an octahedral impostor, which the extras of a material name; or null. */
function imagesOf(document, rest, material) {
  const { octahedralTexture, octahedralNormalTexture } = document.materials?.[material]?.extras?.leafcloud ?? {};
  const bytes = (reference) => {
    // Tools that drop textures or number them anew do not change extras.
    const view = document.bufferViews[document.images?.[document.textures?.[reference?.index]?.source]?.bufferView];
    if (!view) return null;
    const start = 8 + (view.byteOffset ?? 0); // Behind the header of the chunk.
    return rest.subarray(start, start + view.byteLength);
  };
  const [color, normalDepth] = [octahedralTexture, octahedralNormalTexture].map(bytes);
  return color && normalDepth ? { color, normalDepth } : null;
}
