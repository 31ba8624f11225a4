// Reads a GLB file with its KTX2 textures, whose mip levels keep the coverage of the leaves.
import { GLTFLoader } from "three/addons/loaders/GLTFLoader.js";
import { KTX2Loader } from "three/addons/loaders/KTX2Loader.js";

/** Folder of three.js with the transcoder of KTX2 textures. */
const TRANSCODER = "three/addons/libs/basis/";

/** One loader for each renderer: each starts workers of its own. */
const textureLoaders = new WeakMap();

/**
 * Loads the glTF file at `url`. Without a renderer, or if the transcoder cannot be loaded, the file's PNG textures are
 * read: three.js makes their mip levels itself, and thin leaves dissolve in them.
 */
export async function loadFile(url, renderer, transcoder = import.meta.resolve(TRANSCODER)) {
  const loader = new GLTFLoader();
  if (renderer) {
    try {
      loader.setKTX2Loader(await textureLoader(renderer, transcoder));
    } catch (error) {
      console.warn(`PNG textures are drawn in place of KTX2, because ${transcoder} cannot be read: ${error.message}`);
    }
  }
  return loader.loadAsync(url);
}

/** Returns a loader whose transcoder is there: GLTFLoader draws no texture at all where it is missing. */
async function textureLoader(renderer, transcoder) {
  const known = textureLoaders.get(renderer);
  if (known) return known;
  const made = new KTX2Loader().setTranscoderPath(transcoder).detectSupport(renderer);
  await made.init();
  textureLoaders.set(renderer, made);
  return made;
}
