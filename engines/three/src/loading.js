// Reads a GLB file. Its KTX2 textures have mip levels that keep the coverage of the leaves.
import { GLTFLoader } from "three/addons/loaders/GLTFLoader.js";
import { MeshoptDecoder } from "three/addons/libs/meshopt_decoder.module.js";
import { KTX2Loader } from "three/addons/loaders/KTX2Loader.js";
import { withoutInstances } from "./places.js";

/** Folder of three.js with the transcoder of KTX2 textures. */
const TRANSCODER = "three/addons/libs/basis/";

/** Promises of one loader for each renderer: each starts workers of its own. */
const textureLoaders = new WeakMap();

/**
 * Loads the glTF file at `url`. Without a renderer, or if the transcoder cannot be loaded, the file's PNG textures are
 * read.
 */
export async function loadFile(url, renderer, { transcoder, manager, onProgress } = {}) {
  const loader = new GLTFLoader(manager).setMeshoptDecoder(MeshoptDecoder).register(withoutInstances);
  if (renderer) {
    if (renderer.isWebGPURenderer) await renderer.init(); // It does not know its texture formats before.
    try {
      loader.setKTX2Loader(await textureLoader(renderer, transcoder ?? import.meta.resolve(TRANSCODER)));
    } catch (error) {
      console.warn(`PNG textures are drawn in place of KTX2, because its transcoder cannot be read (copy three/examples/jsm/libs/basis to your site, and call loader.setTranscoderPath): ${error.message}`);
    }
  }
  return loader.loadAsync(url, onProgress);
}

/** Returns a loader after its transcoder has been read: without one GLTFLoader draws no texture at all. */
function textureLoader(renderer, transcoder) {
  if (!textureLoaders.has(renderer)) {
    const made = new KTX2Loader().setTranscoderPath(transcoder).detectSupport(renderer);
    const ready = made.init().then(
      () => made,
      (error) => {
        textureLoaders.delete(renderer);
        made.dispose();
        throw error;
      },
    );
    textureLoaders.set(renderer, ready);
  }
  return textureLoaders.get(renderer);
}
