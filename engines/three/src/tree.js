// One tree with levels of detail.
import * as THREE from "three";
import { keepAt, staggerAt, transitionAt, viewFactor } from "./laws.js";
import { chainsIn, Level, objectsOf, sourcesOf } from "./levels.js";
import { loadFile } from "./loading.js";
import { placesOf } from "./places.js";
import { fieldOfView, forPicture, SETTINGS, wantedLevel } from "./settings.js";

/** A tree that shows the level for the camera's distance. Copies (`clone`) share geometry and textures. */
export class Tree extends THREE.Group {
  /** The distance by which the file's numbers decide. */
  #seenFrom = 0;
  #source;

  /**
   * Loads a tree from the GLB file at `url`. It is at rest until the first update.
   *
   * renderer: draws the tree; a WebGPURenderer gets node materials. With it the file's KTX2 textures are read, else its PNG
   *   textures.
   * tree: number of the tree, in a file of several.
   * transcoder: address of the folder of three.js's transcoder for KTX2, if an import map does not tell it.
   * manager, onProgress: those of three.js's loaders.
   */
  static async load(url, { renderer, tree = 0, ...more } = {}) {
    const gltf = await loadFile(url, renderer, more);
    const chains = chainsIn(gltf.parser.json);
    const [levels, looks] = [await sourcesOf(gltf, tree), await looksFor(renderer)];
    const places = await placesOf(gltf, chains[tree][0], levels[0].object);
    return new Tree({ scene: gltf.scene, levels, renderer, trees: chains.length, places, looks });
  }

  /** `source`: {scene, levels, renderer, trees, places, looks} of a loaded file. */
  constructor(source) {
    super();
    this.#source = source;
    const places = objectsOf(source.scene);
    const scene = source.scene.clone();
    const copies = objectsOf(scene);
    this.add(scene);
    this.settings = { ...SETTINGS };
    this.levels = source.levels.map((each) => new Level(each, copies[places.indexOf(each.object)], source.looks));
    this.level = 0;
    /** Distance of the camera from the center of the leaves, in the tree's own units. */
    this.distance = 0;
    const [{ centre, radius, object }] = source.levels;
    const sphere = new THREE.Sphere(centre.clone(), radius).applyMatrix4(object.matrixWorld);
    this.centre = sphere.center;
    this.radius = sphere.radius;
    this.levels.forEach((level) => (level.object.visible = level === this.levels[0]));
  }

  /** The parts of the file that the tree was made from; for forests. */
  get source() {
    return this.#source;
  }

  /** Number of trees in the file. */
  get trees() {
    return this.#source.trees;
  }

  /** Places (Matrix4) of the trees of a forest's file; null in a file of one tree. */
  get places() {
    return this.#source.places;
  }

  clone() {
    return new Tree(this.#source).copy(this);
  }

  copy(other) {
    super.copy(other, false);
    Object.assign(this.settings, other.settings);
    this.levels.forEach(({ meshes }, number) => {
      meshes.forEach((mesh, i) => {
        const { castShadow, receiveShadow } = other.levels[number].meshes[i];
        Object.assign(mesh, { castShadow, receiveShadow });
      });
    });
    return this;
  }

  /** Frees the materials of this copy on the graphics card. */
  dispose() {
    this.levels.forEach((level) => level.dispose());
  }

  /** Shows the level for the camera's distance, with the wind at the time `seconds`. */
  update(camera, seconds = 0) {
    const settings = forPicture(this.settings, this.#source.renderer);
    const eye = camera.getWorldPosition(new THREE.Vector3());
    this.distance = this.worldToLocal(eye.clone()).distanceTo(this.centre);
    const place = this.levels[0].object.getWorldPosition(new THREE.Vector3());
    const factor = viewFactor(fieldOfView(camera), settings) * staggerAt(place.toArray(), settings.stagger);
    this.#seenFrom = this.distance / factor;
    this.level = wantedLevel(settings, this.levels.length) ?? this.#levelAt(this.#seenFrom);
    const share = this.#shareOfNext();
    this.levels.forEach((level, number) => {
      const next = number === this.level + 1;
      level.object.visible = number === this.level || (next && share > 0);
      if (!level.object.visible) return;
      level.uniforms.lcFade.value.fromArray(next ? [share, 0] : [1, share]);
      level.move(...this.#laws(level), settings);
      level.blended.forEach((order) => order.update(eye));
      this.#blow(level, seconds);
    });
  }

  /** The drawn level, its a and λ as in the shaders, and the fraction of the pixels that the next level draws. */
  get state() {
    const level = this.levels[this.level];
    const [distance, { start, end }, keep] = this.#laws(level);
    const transition = transitionAt(distance, start, end);
    return { level: this.level, transition, keep: keepAt(distance, ...keep), share: this.#shareOfNext() };
  }

  #levelAt(distance) {
    const { levels, settings } = this;
    let number = this.level;
    while (number + 1 < levels.length && distance >= levels[number].goneAt(settings)) number++;
    while (number > 0 && distance < levels[number - 1].goneAt(settings) * (1 - this.#delay(levels[number - 1]))) number--;
    return number;
  }

  /** Hysteresis of the level's end. A fade needs none: it is the same in both directions. */
  #delay(level) {
    return level.fade(this.settings) > 0 ? 0 : this.settings.hysteresis;
  }

  /** Fraction of the pixels that the next level draws. */
  #shareOfNext() {
    const { settings } = this;
    const level = this.levels[this.level];
    const wanted = wantedLevel(settings, this.levels.length);
    const fades = isFinite(level.handOver) && level.fade(settings) > 0 && wanted === null;
    return fades ? transitionAt(this.#seenFrom, level.handOver, level.goneAt(settings)) : 0;
  }

  /** Distance, start and end of the morph, start and half of the pruning. */
  #laws(level) {
    const { byHand } = this.settings;
    // Distances at which the laws have the numbers by hand: λ(1) with h = ½ is its d₀.
    if (byHand) return [1, { start: 1 - byHand.transition, end: 2 - byHand.transition }, [byHand.keep, 0.5]];
    return [this.#seenFrom, level, level.keepLaw(this.settings)];
  }

  #blow(level, seconds) {
    const { object } = level;
    object.updateWorldMatrix(true, false);
    const place = new THREE.Vector3().setFromMatrixPosition(object.matrixWorld);
    level.blow(this.settings.wind, seconds, object.matrixWorld.clone().invert(), place);
  }
}

/** Returns the module of the materials for a renderer. No page loads that of the other, which is large. */
function looksFor(renderer) {
  return renderer?.isWebGPURenderer ? import("./nodes/materials.js") : import("./materials.js");
}
