// All that the page shows of a file: one tree, the full tree beside it, or a forest.
import * as THREE from "three";
import { Forest, Tree } from "leafcloud-three";
import { GLTFLoader } from "three/addons/loaders/GLTFLoader.js";

/** Numbers of trees to choose from. */
export const COUNTS = [1, 100, 400, 1000];

/** Distance between neighbors of the forest in crown radii. */
const APART = 2.6;

/** Angle between one tree and the next, so that they spread evenly. */
const GOLDEN = Math.PI * (3 - Math.sqrt(5));

/** Loads a file of Leafcloud, or of another tool as it is. */
export async function load(url, renderer) {
  try {
    return new Stand(await Tree.load(url, { renderer }));
  } catch (error) {
    if (!/^No levels/.test(error.message)) throw error;
    return new Stand(new Model((await new GLTFLoader().loadAsync(url)).scene));
  }
}

/** A file without levels, with the members of a `Tree` that the page uses. */
class Model extends THREE.Group {
  constructor(scene) {
    super();
    this.add(scene);
    this.settings = {};
    this.levels = [];
    const { center, radius } = new THREE.Box3().setFromObject(scene).getBoundingSphere(new THREE.Sphere());
    Object.assign(this, { centre: center, radius, distance: 0 });
    if (!(radius > 0)) throw new Error("No meshes in this file.");
  }

  update(camera) {
    this.distance = camera.position.distanceTo(this.centre);
  }

  clone() {
    return new Model(this.children[0].clone());
  }

  dispose() {
    this.traverse(({ geometry, material }) => [geometry, material].forEach((each) => each?.dispose()));
  }
}

export class Stand extends THREE.Group {
  #beside = null;
  #forest = null;

  constructor(tree) {
    super();
    this.tree = tree;
    this.add(tree);
  }

  /** Frees all copies. */
  dispose() {
    [this.tree, this.#beside, this.#forest].forEach((each) => each?.dispose());
  }

  /** Whether the full tree stands beside the tree. */
  get beside() {
    return this.#beside !== null;
  }

  set beside(wanted) {
    this.#beside?.removeFromParent();
    this.#beside?.dispose();
    this.#beside = null;
    if (!wanted) return;
    this.#beside = this.tree.clone();
    Object.assign(this.#beside.settings, { level: 0, pruneStart: Infinity, byHand: { transition: 0, keep: 1 } });
    this.#beside.position.x = 2.2 * this.tree.radius;
    this.add(this.#beside);
  }

  /** Number of trees: 1, or a forest of copies. */
  get count() {
    return this.#forest?.size ?? 1;
  }

  set count(wanted) {
    this.#forest?.removeFromParent();
    this.#forest?.dispose();
    this.#forest = null;
    this.tree.visible = wanted === 1;
    if (wanted === 1) return;
    this.#forest = Object.assign(new Forest(this.tree, placesOf(wanted, APART * this.tree.radius)), { size: wanted });
    this.add(this.#forest);
  }

  /** The middle of the tree, or of both. */
  get middle() {
    const middle = this.tree.centre.clone();
    if (this.beside) middle.x += this.#beside.position.x / 2;
    return middle;
  }

  /** Radius around the middle of all that is shown. */
  get reach() {
    return this.tree.radius * (this.count === 1 ? 1 + 1.1 * this.beside : APART * Math.sqrt(this.count));
  }

  /** Trees that each level drew; null without a forest. */
  get counts() {
    return this.#forest?.counts ?? null;
  }

  update(camera, seconds) {
    if (this.#forest) Object.assign(this.#forest.settings, this.tree.settings);
    if (this.#beside) this.#beside.settings.wind = this.tree.settings.wind;
    [this.tree, this.#beside, this.#forest].forEach((each) => each?.update(camera, seconds));
  }
}

/** Places of `count` trees, turned and scaled by fixed random numbers; the first one stays as it is. */
function placesOf(count, apart) {
  let seed = 1;
  const random = () => (seed = (48271 * seed) % 2147483647) / 2147483647;
  return Array.from({ length: count }, (_, i) => {
    const away = apart * Math.sqrt(i);
    const place = new THREE.Matrix4().makeRotationY(i ? 2 * Math.PI * random() : 0);
    place.scale(new THREE.Vector3().setScalar(i ? 0.75 + 0.5 * random() : 1));
    return place.setPosition(away * Math.cos(i * GOLDEN), 0, away * Math.sin(i * GOLDEN));
  });
}
