import type { Camera, Group, Loader, LoadingManager, Matrix4, Vector3, WebGLRenderer } from "three";
import type { WebGPURenderer } from "three/webgpu";

/** Settings of the drawing of a tree or of a forest. Distances are in the tree's own units. */
export interface Settings {
  /** Level to show at all distances; null: the level for the distance. */
  level: number | null;
  /** Factor on the distances of all levels. At 2 finer levels are drawn twice as far away, which costs time. */
  lodDistance: number;
  /** Height of the picture in pixels; null: that of the loader's renderer, or else the file's distances. */
  pixels: number | null;
  /** Distance where leaves begin to be left out. Infinity: none are; null: as the tree was baked. */
  pruneStart: number | null;
  /** That distance divided by the distance where half of the leaves remain, in (0, 0.5]. */
  pruneHalf: number;
  /** Length of the fade into a level that no level morphs to, as a fraction of the distance. */
  fade: number;
  /** The same after a morph. */
  fadeBehindMorph: number;
  /** Largest change of a tree's switch distances by its place, as a fraction: neighbors do not switch together; 0: none. */
  stagger: number;
  /** Fraction of the distance by which a level stays longer when the camera returns, without a fade. A forest has none. */
  hysteresis: number;
  /** Whether the trees get shadows, also from themselves; null: as the loader's renderer. */
  shadows: boolean | null;
  /** Whether the colors of kept leaves move toward their mean. */
  contrast: boolean;
  /** Strength of the wind; 0: no motion; null: the file's. */
  wind: number | null;
  /** Numbers in place of those for the distance, both in [0, 1]. A forest ignores them. */
  byHand: { transition: number; keep: number } | null;
}

export const SETTINGS: Readonly<Settings>;

/** Source of the laws as GLSL functions, for shaders of your own. */
export const LAWS: string;

export interface LoadOptions {
  /** Draws the tree. Without one, PNG textures are read, levels suit pictures of 1080 rows, and WebGLRenderer draws the tree. */
  renderer?: WebGLRenderer | WebGPURenderer;
  /** Number of the tree, in a file of several; 0 by default. */
  tree?: number;
  /** Address of the folder of three.js's transcoder for KTX2, if an import map does not tell it. */
  transcoder?: string;
  manager?: LoadingManager;
  onProgress?: (event: ProgressEvent) => void;
}

/** A tree that shows the level for the camera's distance. */
export class Tree extends Group {
  static load(url: string, options?: LoadOptions): Promise<Tree>;
  private constructor();
  /** Number of trees in the file. */
  readonly trees: number;
  /** Places of the trees of a forest's file, NAME_forest.glb; null in a file of one tree. */
  readonly places: Matrix4[] | null;
  readonly settings: Settings;
  /** Number of the drawn level; 0 has the leaves. */
  readonly level: number;
  /** Distance of the camera from the center of the leaves, in the tree's own units. */
  readonly distance: number;
  readonly centre: Vector3;
  readonly radius: number;
  readonly state: { level: number; transition: number; keep: number; share: number };
  /** Call it before each picture. `seconds`: time of the wind. */
  update(camera: Camera, seconds?: number): void;
  /** Returns a tree with the same geometry and textures. */
  clone(): this;
  /** Frees the materials and geometries of this copy. */
  dispose(): void;
}

/** Many copies of one tree, each with the level for its own distance. */
export class Forest extends Group {
  /** `places`: of the copies, in the forest's coordinates, scaled by the same factor in all directions. */
  constructor(tree: Tree, places: Matrix4[]);
  readonly settings: Settings;
  readonly centre: Vector3;
  readonly radius: number;
  /** Trees that each level drew in the last picture. */
  readonly counts: number[];
  /** Whether trees outside of the picture are left out. They then cast no shadows into it. */
  culling: boolean;
  /** Moves the trees: at most as many as the constructor got. */
  plant(places: Matrix4[]): void;
  /** Call it before each picture. `seconds`: time of the wind. */
  update(camera: Camera, seconds?: number): void;
  /** Returns a forest of the same trees. */
  clone(): this;
  /** Frees the materials and geometries of this forest. */
  dispose(): void;
}

/** Loads trees in the manner of three.js. */
export class LeafcloudLoader extends Loader<Tree> {
  /** `renderer`: draws the trees. Without one, as in LoadOptions. */
  constructor(renderer?: WebGLRenderer | WebGPURenderer, manager?: LoadingManager);
  /** Address of the folder of three.js's transcoder for KTX2: bundlers do not know it. */
  setTranscoderPath(path: string): this;
}
