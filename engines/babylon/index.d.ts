import type { Camera, Matrix, Scene, TransformNode, Vector3 } from "@babylonjs/core";

/** Settings of the drawing of a tree or of a forest. Distances are in the tree's own units. */
export interface Settings {
  /** Level to show at all distances; null: the level for the distance. */
  level: number | null;
  /** Factor on the distances of all levels. At 2 finer levels are drawn twice as far away, which costs time. */
  lodDistance: number;
  /** Height of the picture in pixels; null: that of the engine. */
  pixels: number | null;
  /** Length of the fade into a level that no level morphs to, as a fraction of the distance. */
  fade: number;
  /** The same after a morph. */
  fadeBehindMorph: number;
  /** Largest change of a tree's switch distances by its place, as a fraction: neighbors do not switch together; 0: none. */
  stagger: number;
  /** Strength of the wind; 0: no motion; null: the file's. */
  wind: number | null;
  /** Time of the wind; null: the page's clock. */
  seconds: number | null;
}

export const SETTINGS: Readonly<Settings>;

/** Source of the laws as GLSL functions, for shaders of your own. */
export const LAWS: string;

/** A tree that shows the level for the active camera's distance before each picture of its scene. */
export class Tree {
  private constructor();
  /** Node to place the tree by. */
  readonly root: TransformNode;
  settings: Settings;
  /** Number of the drawn level; 0 has the leaves. */
  readonly level: number;
  /** Distance of the camera from the center of the leaves, in the tree's own units. */
  readonly distance: number;
  readonly centre: Vector3;
  readonly radius: number;
  /** Places of the trees of a forest's file, NAME_forest.glb; null in a file of one tree. */
  readonly places: Matrix[] | null;
  /** Shows the level for this camera; null: the leaves. */
  update(camera: Camera | null): void;
  /** Returns a tree with the same geometry and textures. */
  clone(): Tree;
  /** Frees this copy. Geometry and textures of the file stay with the scene. */
  dispose(): void;
}

/** Many copies of one tree, each with the level for its own distance, before each picture of their scene. */
export class Forest {
  /** `places`: of the copies, in the coordinates of `root`, scaled by the same factor in all directions. */
  constructor(tree: Tree, places: Matrix[]);
  /** Node to place the forest by. */
  readonly root: TransformNode;
  settings: Settings;
  readonly centre: Vector3;
  readonly radius: number;
  /** Trees that each level drew in the last picture. */
  readonly counts: number[];
  /** Whether trees outside of the picture are left out. They then cast no shadows into it. */
  culling: boolean;
  /** Moves the trees: at most as many as the constructor got. */
  plant(places: Matrix[]): void;
  /** Shows each tree in the level for this camera. */
  update(camera: Camera | null): void;
  /** Returns a forest of the same trees. */
  clone(): Forest;
  /** Frees this forest. Geometry and textures of the file stay with the scene. */
  dispose(): void;
}

export interface LoadOptions {
  /** Address of a folder with the files of @babylonjs/core/assets/Basis, for KTX2 textures. Without it, PNG textures are drawn. */
  ktx2?: string;
  /** Number of the tree, in a file of several; 0 by default. */
  tree?: number;
}

/** Loads a tree from the GLB file at `url`. Rejects with an error for a file without levels. */
export function loadTree(url: string, scene: Scene, options?: LoadOptions): Promise<Tree>;
