// Settings of trees and forests, and the camera's numbers that distances depend on.
import { Camera } from "@babylonjs/core";

/**
 * Settings of the drawing of a tree or of a forest. Distances are in the tree's own units.
 *
 * level: number of the level to show at all distances. null: the level for the distance.
 * lodDistance: factor on the distances of all levels. At 2 finer levels are drawn twice as far away, which costs time.
 * pixels: height of the picture in pixels; null: that of the engine.
 * fade: fade length of a level that no level morphs to, as a fraction of its switch distance.
 * fadeBehindMorph: the same after a morph.
 * stagger: largest change of a tree's switch distances by its place in the world, as a fraction, so that neighbors do not
 *   switch together. 0: none.
 * wind: strength of the wind, like that of Blender's force fields; 0: no motion. null: the file's number. Files without
 *   wind ignore it.
 * seconds: time of the wind; null: the page's clock.
 */
export const SETTINGS = {
  level: null,
  lodDistance: 1,
  pixels: null,
  fade: 0.15,
  fadeBehindMorph: 0.08,
  stagger: 0.1,
  wind: null,
  seconds: null,
};

/** Returns the settings with the engine's height and the page's clock in place of missing ones. */
export function forPicture(settings, engine) {
  const pixels = settings.pixels ?? engine.getRenderHeight();
  const seconds = settings.seconds ?? performance.now() / 1000;
  return { ...settings, pixels, seconds };
}

/** Returns the camera's vertical field of view in radians; null for one without perspective. */
export function fieldOfView(camera) {
  if (camera.mode !== Camera.PERSPECTIVE_CAMERA) return null;
  const upright = camera.fovMode === Camera.FOVMODE_VERTICAL_FIXED;
  const aspect = camera.getEngine().getAspectRatio(camera);
  return upright ? camera.fov : 2 * Math.atan(Math.tan(camera.fov / 2) / aspect);
}

/** Returns the wanted level among `count` levels; null: the level for the distance. */
export function wantedLevel({ level }, count) {
  return Number.isInteger(level) ? Math.min(Math.max(level, 0), count - 1) : null;
}
