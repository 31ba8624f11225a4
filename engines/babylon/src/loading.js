// Reads a GLB file.
import { BaseTexture, LoadAssetContainerAsync } from "@babylonjs/core";
import "@babylonjs/loaders/glTF/index.js";
import { joined, levelsIn, split, withLevels } from "./glb.js";
import { sourcesOf } from "./levels.js";
import { Tree } from "./tree.js";

/**
 * Loads a tree from the GLB file at `url` into `scene`. It switches by itself before each picture. `ktx2`: read KTX2
 * textures, which needs Babylon.js's transcoder. `tree`: its number, in a file of several. The file must be baked with
 * `--engine babylon`.
 */
export async function loadTree(url, scene, { ktx2 = false, tree = 0 } = {}) {
  const response = await fetch(url);
  if (!response.ok) throw new Error(`${url}: ${response.status}`);
  const { document, rest } = split(await response.arrayBuffer());
  const levels = levelsIn(document, rest, tree);
  const content = joined(withLevels(document, { ktx2, tree }), rest);
  const container = await LoadAssetContainerAsync(content, scene, { pluginExtension: ".glb", name: url });
  // A texture that arrives later would get the sampling of its file again.
  await new Promise((done) => BaseTexture.WhenAllReady(container.textures, done));
  return new Tree({ container, levels: sourcesOf(container, levels) }, scene);
}
