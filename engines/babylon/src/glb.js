// GLB files: the document, changed before Babylon.js reads it.

const JSON_CHUNK = 0x4e4f534a;

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

/**
 * Shows all levels of MSFT_lod in the scene: Babylon.js reads the extension as steps of loading. Without `ktx2` the PNG
 * textures are read: Babylon.js waits for ever for a transcoder that it cannot reach.
 */
export function withLevels(document, { ktx2 }) {
  const ids = document.nodes.flatMap(({ extensions }) => extensions?.MSFT_lod?.ids ?? []);
  document.scenes[document.scene ?? 0].nodes.push(...ids);
  document.nodes.forEach(({ extensions }) => delete extensions?.MSFT_lod);
  if (!ktx2) document.textures?.forEach(({ extensions }) => delete extensions?.KHR_texture_basisu);
  return document;
}

/** Returns the level of each node that has one: its name, extras and the tables of its mesh. */
export function levelsIn(document) {
  const found = document.nodes.filter(({ extras }) => extras?.leafcloud?.level !== undefined);
  if (found.length === 0) throw new Error("No levels in this file: load a NAME.glb that Leafcloud wrote.");
  return found
    .map(({ name, mesh, extras }) => {
      const { primitives, extras: own } = document.meshes[mesh];
      const tables = own?.leafcloud ?? {};
      return { name, extras: extras.leafcloud, tables, primitives: primitives.length };
    })
    .sort((a, b) => a.extras.level - b.extras.level);
}
