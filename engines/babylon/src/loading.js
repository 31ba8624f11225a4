// Reads a GLB file.
import { BaseTexture, LoadAssetContainerAsync, Matrix, Quaternion, Vector3 } from "@babylonjs/core";
import "@babylonjs/loaders/glTF/index.js";
import { instancesIn, joined, levelsIn, split, withLevels } from "./glb.js";
import { sourcesOf } from "./levels.js";
import { pagesOf } from "./octahedral.js";
import { useTranscoder } from "./transcoder.js";
import { Tree } from "./tree.js";

/**
 * Loads a tree from the GLB file at `url` into `scene`. It switches by itself before each picture. The file must be baked with
 * `--engine babylon`.
 *
 * ktx2: address of a folder with the files of @babylonjs/core/assets/Basis, to read the file's KTX2 textures. Without it, or if
 *   the folder cannot be read, the PNG textures are drawn.
 * tree: number of the tree, in a file of several.
 */
export async function loadTree(url, scene, { ktx2 = null, tree = 0 } = {}) {
  const response = await fetch(url);
  if (!response.ok) throw new Error(`${url}: ${response.status}`);
  const { document, rest } = split(await response.arrayBuffer());
  const levels = levelsIn(document, rest, tree);
  const instances = instancesIn(document, rest, tree);
  const content = joined(withLevels(document, { ktx2: ktx2 !== null && (await canTranscode(ktx2)), tree }), rest);
  const container = await LoadAssetContainerAsync(content, scene, { pluginExtension: ".glb", name: url });
  for (const level of levels) {
    if (level.images) level.pages = pagesOf(level.images, scene, `${url} ${level.name}`);
  }
  const textures = levels.flatMap(({ pages }) => Object.values(pages ?? {}));
  // A texture that arrives later would get the sampling of its file again.
  await new Promise((done) => BaseTexture.WhenAllReady([...container.textures, ...textures], done));
  const places = instances && placesOf(instances, nodeOf(container, levels[0].name));
  return new Tree({ container, levels: await sourcesOf(container, levels), places }, scene);
}

/**
 * Returns the places of the trees. An instance I lies within the node of level 0, a place P moves it, both in rows:
 * W · P = I · W, where W also turns the axes of glTF to those of the scene.
 */
function placesOf(instances, node) {
  const world = node.computeWorldMatrix(true);
  const back = Matrix.Invert(world);
  return instances.map(({ translation, rotation, scale }) => {
    const own = Matrix.Compose(Vector3.FromArray(scale), Quaternion.FromArray(rotation), Vector3.FromArray(translation));
    return back.multiply(own).multiply(world);
  });
}

function nodeOf(container, name) {
  return [...container.transformNodes, ...container.meshes].find((node) => node.name === name);
}

async function canTranscode(folder) {
  try {
    await useTranscoder(folder);
    return true;
  } catch (error) {
    console.warn(`PNG textures are drawn in place of KTX2, because its transcoder cannot be read: ${error.message}`);
    return false;
  }
}
