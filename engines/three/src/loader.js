// A loader in the manner of three.js.
import { Loader } from "three";
import { Tree } from "./tree.js";

/** Loads trees from GLB files of Leafcloud: `await new LeafcloudLoader(renderer).loadAsync("pine.glb")`. */
export class LeafcloudLoader extends Loader {
  /** `renderer`: draws the trees. Without one, PNG textures are read, and levels suit pictures of 1080 rows. */
  constructor(renderer, manager) {
    super(manager);
    this.renderer = renderer;
    this.transcoder = undefined;
  }

  /** Address of the folder of three.js's transcoder for KTX2: bundlers do not know it. */
  setTranscoderPath(path) {
    this.transcoder = path;
    return this;
  }

  load(url, onLoad, onProgress, onError) {
    const address = this.manager.resolveURL(this.path + url);
    this.manager.itemStart(address);
    const { renderer, transcoder, manager } = this;
    Tree.load(address, { renderer, transcoder, manager, onProgress })
      .then(onLoad)
      .catch((error) => {
        if (!onError) console.error(error);
        onError?.(error);
        this.manager.itemError(address);
      })
      .finally(() => this.manager.itemEnd(address));
  }
}
