// Settings of trees and forests.

/**
 * Settings of a tree's drawing. Distances are in the tree's own units.
 *
 * level: number of the level to show at all distances. null: the level for the distance.
 * lodDistance: factor on the distances of all levels. At 2 finer levels are drawn twice as far away, which costs time.
 * pixels: height of the picture in pixels. The distances then suit it and the camera's field of view, so that levels
 *   take over at the size in pixels for which they were baked. null: that of the loader's renderer; without a renderer the
 *   file's distances, for 50° over 1080 pixels.
 * pruneStart: d₀ of the law of λ, for all levels. Infinity: no pruning. null: each level as it was baked.
 * pruneHalf: h of that law. Used if pruneStart is a number.
 * fade: fade length of a level that no level morphs to, as a fraction of its switch distance.
 * fadeBehindMorph: the same after a morph, for the remaining changes of lighting and alpha edges.
 * stagger: largest change of a tree's switch distances by its place in the world, as a fraction, so that neighbors do not
 *   switch together. 0: none.
 * hysteresis: without a fade, the fraction of the distance by which a level stays longer when the camera returns, so
 *   that levels do not flicker. A forest has none.
 * wind: strength of the wind, like that of Blender's force fields; 0: no motion. null: the file's number. Files without
 *   wind ignore it.
 * shadows: true if the trees get shadows, also from themselves. The octahedral impostor is then darker where the crown is
 *   dense: no shadow falls into it. null: as the loader's renderer, and false without one.
 * contrast: true to move the colors of kept leaves toward their mean, if the file has the numbers.
 * byHand: {transition, keep} to replace the numbers for the camera's distance. The level still follows the distance. A
 *   forest ignores it.
 */
export const SETTINGS = {
  level: null,
  lodDistance: 1,
  pixels: null,
  pruneStart: null,
  pruneHalf: 0.5,
  fade: 0.15,
  fadeBehindMorph: 0.08,
  stagger: 0.1,
  hysteresis: 0.02,
  shadows: null,
  contrast: true,
  wind: null,
  byHand: null,
};

/** Returns the settings with the renderer's height and shadows in place of missing ones. */
export function forPicture(settings, renderer) {
  const pixels = settings.pixels ?? renderer?.domElement.height ?? null;
  const shadows = settings.shadows ?? renderer?.shadowMap.enabled ?? false;
  return { ...settings, pixels, shadows };
}

/** Returns the camera's vertical field of view in radians; null for one without perspective. */
export function fieldOfView(camera) {
  return camera.isPerspectiveCamera ? (camera.getEffectiveFOV() * Math.PI) / 180 : null;
}

/** Returns the wanted level among `count` levels; null: the level for the distance. */
export function wantedLevel({ level }, count) {
  return Number.isInteger(level) ? Math.min(Math.max(level, 0), count - 1) : null;
}
