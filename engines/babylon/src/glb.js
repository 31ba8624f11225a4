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

/** Returns the numbers of the nodes of each tree's levels. A file of one level has one for each tree. */
function chainsIn({ nodes }) {
  const hasLevel = (node) => node.extras?.leafcloud?.level !== undefined;
  const behind = nodes.flatMap(({ extensions }) => extensions?.MSFT_lod?.ids ?? []);
  const firsts = nodes.map((_, number) => number).filter((number) => hasLevel(nodes[number]) && !behind.includes(number));
  return firsts.map((number) => [number, ...(nodes[number].extensions?.MSFT_lod?.ids ?? [])]);
}

/**
 * Shows all levels of tree number `tree` in the scene: Babylon.js reads MSFT_lod as steps of loading. Without `ktx2` the PNG
 * textures are read: Babylon.js waits for ever for a transcoder that it cannot reach.
 */
export function withLevels(document, { ktx2, tree }) {
  const chains = chainsIn(document);
  const { nodes } = document.scenes[document.scene ?? 0];
  document.scenes[document.scene ?? 0].nodes = [...nodes.filter((node) => !chains.flat().includes(node)), ...chains[tree]];
  document.nodes.forEach(({ extensions }) => delete extensions?.MSFT_lod);
  if (!ktx2) document.textures?.forEach(({ extensions }) => delete extensions?.KHR_texture_basisu);
  return document;
}

/** Returns the levels of tree number `tree`: their nodes' names and extras, and the tables of their meshes. */
export function levelsIn(document, tree) {
  const chains = chainsIn(document);
  if (chains.length === 0) throw new Error("No levels in this file: load a NAME.glb that Leafcloud wrote.");
  if (!chains[tree]) throw new Error(`The file has ${chains.length} trees, and no tree ${tree}: choose a smaller number.`);
  return chains[tree]
    .map((number) => document.nodes[number])
    .map(({ name, mesh, extras }) => {
      const { primitives, extras: own } = document.meshes[mesh];
      const tables = own?.leafcloud ?? {};
      return { name, extras: extras.leafcloud, tables, primitives: primitives.length };
    })
    .sort((a, b) => a.extras.level - b.extras.level);
}
