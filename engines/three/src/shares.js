// Alpha as the share of a texel that leaves cover, by the law of shares.glsl; for both renderers.
import { CustomBlending, OneFactor, OneMinusSrcAlphaFactor, ZeroFactor } from "three";

/** Length of the shader's table of pivots. */
const MIPS = 16;

/** Properties of a material that draws a share of a pixel's samples. The blending keeps the alpha of an opaque background. */
export const FRACTIONAL = {
  alphaToCoverage: true,
  blending: CustomBlending,
  blendSrc: OneFactor,
  blendDst: ZeroFactor,
  blendSrcAlpha: OneFactor,
  blendDstAlpha: OneMinusSrcAlphaFactor,
};

/** Returns the numbers by which a cut-out material draws shares: its cutoff, and the pivots of the mip levels. */
export function cutOf({ map, alphaTest, userData }) {
  const pivots = (map.isCompressedTexture && userData.leafcloud?.alphaPivots) || [alphaTest];
  return { cutoff: alphaTest, pivots: Array.from({ length: MIPS }, (_, i) => pivots[Math.min(i, pivots.length - 1)]) };
}
