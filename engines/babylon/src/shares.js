// Alpha as the share of a texel that leaves cover, by the law of shares.glsl.
import { Constants, Material } from "@babylonjs/core";
import { hasShares } from "./textures.js";

/** Length of the shader's table of pivots. */
export const MIPS = 16;

/**
 * Returns the alpha pivots of a material's mip levels if its alpha is a share (atlas pages, and textures of leaves with mip levels of shares),
 * otherwise null.
 */
export function pivotsOf({ albedoTexture: texture, transparencyMode, alphaCutOff, metadata }) {
  if (transparencyMode !== Material.MATERIAL_ALPHATEST || !texture || hasShares(texture) === false) return null;
  const bent = texture.mimeType === "image/ktx2" && metadata?.gltf?.extras?.leafcloud?.alphaPivots;
  const pivots = bent || [alphaCutOff];
  return Array.from({ length: MIPS }, (_, i) => pivots[Math.min(i, pivots.length - 1)]);
}

/** Makes a mesh draw as large a share of a pixel's samples as its alpha, if there are several. */
export function drawShares(mesh) {
  const engine = mesh.getScene().getEngine();
  mesh.onBeforeBindObservable.add(() => setShares(engine, engine.currentSampleCount > 1));
  mesh.onAfterRenderObservable.add(() => setShares(engine, false));
}

/** Sets alpha to coverage, and a blending that keeps the alpha of an opaque background. */
function setShares(engine, on) {
  const { alphaState } = engine;
  engine.setAlphaToCoverage(on);
  alphaState.setAlphaBlend(on);
  if (!on) return;
  alphaState.setAlphaBlendFunctionParameters(1, 0, 1, Constants.GL_ALPHA_FUNCTION_ONE_MINUS_SRC_ALPHA);
  alphaState.setAlphaEquationParameters(Constants.GL_ALPHA_EQUATION_ADD, Constants.GL_ALPHA_EQUATION_ADD);
}
