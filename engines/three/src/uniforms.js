// The numbers that the shaders of a level read, for both renderers.
import * as THREE from "three";
import { NEVER } from "./laws.js";

/** Alpha below which an octahedral impostor draws nothing. */
export const LEAST_ALPHA = 0.02;

/** Returns the uniforms of a level's shaders, for all of its materials. */
export function newUniforms({ pruning, wind, centre }) {
  return {
    ...(wind && { lcWind: { value: newWind(wind) } }),
    lcTransitionAt: { value: new THREE.Vector3(0, NEVER, NEVER) },
    lcKeepAt: { value: new THREE.Vector2(NEVER, 0.5) },
    lcShares: { value: Array.from({ length: 65 }, (_, i) => (i / 64) ** 2) },
    lcGrowth: { value: new THREE.Vector2(...pruning.growth) },
    lcContrast: { value: new THREE.Vector2() },
    lcMean: { value: new THREE.Vector3(...pruning.mean) },
    lcFade: { value: new THREE.Vector2(1, 0) },
    lcViewer: { value: new THREE.Vector3() },
    lcCentre: { value: centre.clone() },
    lcUnit: { value: 1 },
    lcStagger: { value: 0 },
    lcShadows: { value: 0 },
    lcFadeAt: { value: new THREE.Vector4(-1, 0, NEVER, 2 * NEVER) },
  };
}

/** Returns an LcWind of leafcloud.glsl without force. */
function newWind({ up, foot, height, spread, gusts, sway, branches, flutter }) {
  const [upward, standing] = [up, foot].map((vector) => new THREE.Vector3(...vector));
  const shape = { up: upward, foot: standing, height, spread, gusts, sway, branches, flutter };
  return { direction: new THREE.Vector3(1, 0, 0), ...shape, force: 0, turns: 0 };
}
