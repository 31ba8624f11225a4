// A tree with levels of detail in Babylon.js.
import { TransformNode, Vector3 } from "@babylonjs/core";
import { staggerAt, viewFactor } from "./laws.js";
import { Level, rangesOf, scaleOf } from "./levels.js";
import { fieldOfView, forPicture, SETTINGS, wantedLevel } from "./settings.js";

/** Returns a node of the scene and the levels of a copy of the file below it. */
export function copyOf({ container, levels }, scene, name) {
  const root = new TransformNode(name, scene);
  const made = container.instantiateModelsToScene((own) => own, false, { doNotInstantiate: true });
  made.rootNodes.forEach((node) => (node.parent = root));
  return { root, levels: levels.map((each) => new Level(each, root)) };
}

/** A tree that shows the level for the camera's distance. Copies (`clone`) share geometry and textures. */
export class Tree {
  #source;
  #scene;
  #observer;
  #levels;

  /** `source`: {container, levels, places} of a loaded file. */
  constructor(source, scene) {
    this.#source = source;
    this.#scene = scene;
    this.settings = { ...SETTINGS };
    this.level = 0;
    /** Distance of the camera from the center of the leaves, in the tree's own units. */
    this.distance = 0;
    const { root, levels } = copyOf(source, scene, "tree");
    /** The node to place the tree by. */
    this.root = root;
    this.#levels = levels;
    this.centre = Vector3.FromArray(source.levels[0].extras.centre);
    this.radius = source.levels[0].extras.radius;
    this.update(null);
    this.#observer = scene.onBeforeRenderObservable.add(() => this.update(scene.activeCamera));
  }

  /** The parts of the file that the tree was made from; for forests. */
  get source() {
    return { ...this.#source, scene: this.#scene };
  }

  /** Places (Matrix) of the trees of a forest's file; null in a file of one tree. */
  get places() {
    return this.#source.places;
  }

  /** Returns a tree with the same geometry and textures. */
  clone() {
    return Object.assign(new Tree(this.#source, this.#scene), { settings: { ...this.settings } });
  }

  dispose() {
    this.#scene.onBeforeRenderObservable.remove(this.#observer);
    this.#levels.forEach((level) => level.dispose());
    this.root.dispose(false, false);
  }

  /** Shows the level for the camera's distance. The scene calls it before each picture. `camera`: null for the leaves. */
  update(camera) {
    if (!this.root.isEnabled()) return;
    const settings = forPicture(this.settings, this.#scene.getEngine());
    const place = this.#levels[0].node.computeWorldMatrix(true);
    const middle = Vector3.TransformCoordinates(this.centre, place);
    const eye = camera?.globalPosition ?? middle;
    this.distance = (Vector3.Distance(eye, middle) * this.#levels[0].scale) / scaleOf(place);
    const factor = camera ? viewFactor(fieldOfView(camera), settings) : 1;
    const nearest = this.distance / (factor * staggerAt(place.getTranslation().asArray(), settings.stagger));
    const ranges = rangesOf(this.#levels, wantedLevel(settings, this.#levels.length), settings);
    this.level = ranges.findIndex(([from, , , gone]) => nearest >= from && nearest < gone);
    this.#levels.forEach((level, number) => {
      const range = ranges[number];
      const shown = nearest >= range[0] && nearest < range[3];
      level.node.setEnabled(shown);
      if (shown) level.move({ eye, factor, range, nearest, settings });
    });
  }
}
