// Self-shadowing clouds: multiplies each light at a texel by lc_sun_share of leafcloud.glsl.
//
// A file baked with self-shadowing has bent-normal occlusion in its materials' extras, and occlusion in the red
// channel of the roughness texture. three.js itself applies the occlusion to sky light.
// Not by name: where bundlers replace "three" by "three/webgpu", there is no ShaderChunk, nor a renderer that needs it.
import * as THREE from "three";
import { after, before, replaced } from "./patching.js";

const VERTEX = `
in vec4 lcTangent;
out vec4 lcAcross; // in view coordinates, with glTF's w
`;
const FRAGMENT = `
uniform sampler2D lcBentNormal;
in vec4 lcAcross;
`;
// The normal is not flipped toward the viewer: the texture stores light per place, not per side.
const PLACE = `
    vec3 lcOut = normalize(vNormal);
    vec3 lcRight = normalize(lcAcross.xyz);
    mat3 lcAxes = mat3(lcRight, cross(lcOut, lcRight) * lcAcross.w, lcOut);
    vec3 lcToward = lcAxes * (2.0 * texture(lcBentNormal, vRoughnessMapUv).xyz - 1.0);
`;
const LIGHTS = /get\w+LightInfo\([^;]*;/g;
const REACHED = "directLight.color *= lc_sun_share(texelRoughness.r, lcToward, directLight.direction);";

/** Dims the lights in `shader` by `texture`. The shader must already include the laws. */
export function shadeItself(shader, texture) {
  shader.uniforms.lcBentNormal = { value: texture };
  const across = `
    vec4 lcAlong = vec4(lcTangent.xyz, 0.0);
#ifdef USE_INSTANCING
    lcAlong = instanceMatrix * lcAlong;
#endif
    lcAcross = vec4((modelViewMatrix * lcAlong).xyz, lcTangent.w);
  `;
  shader.vertexShader = before("void main()", VERTEX, after("#include <project_vertex>", across, shader.vertexShader));
  const lights = THREE.ShaderChunk.lights_fragment_begin.replaceAll(LIGHTS, `$& ${REACHED}`);
  const lit = replaced(shader.fragmentShader, "#include <lights_fragment_begin>", PLACE + lights);
  shader.fragmentShader = before("void main()", FRAGMENT, lit);
}
