// Self-shadowing clouds as nodes: multiplies each light at a texel by sunShare. self_shadowing.js does this for WebGLRenderer.
import { attribute, cameraViewMatrix, cross, mat3, normalize, normalViewGeometry, varying, vec4 } from "three/tsl";
import { sunShare } from "./laws.js";
import { toWorld } from "./level.js";

const tangent = attribute("lcTangent", "vec4");
const across = varying(cameraViewMatrix.mul(toWorld).mul(vec4(tangent.xyz, 0)).xyz);
const handed = varying(tangent.w);

/** Dims the lights of a lighting model. `bentNormal` and `roughness` are nodes of the textures. */
export function shadeItself(model, bentNormal, roughness) {
  const { direct } = model;
  // The normal is not flipped toward the viewer: the texture stores light per place, not per side.
  const outward = normalViewGeometry;
  const right = normalize(across);
  const axes = mat3(right, cross(outward, right).mul(handed), outward);
  const toward = axes.mul(bentNormal.xyz.mul(2).sub(1)).toVar();
  model.direct = (input, builder) => {
    const lightColor = input.lightColor.mul(sunShare(roughness.r, toward, input.lightDirection));
    direct.call(model, { ...input, lightColor }, builder);
  };
  return model;
}
