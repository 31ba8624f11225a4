// Octahedral impostors: a quad in place of the cross impostor of the last level, by the law of octahedral.glsl.
import * as THREE from "three";
import { OCTAHEDRAL, SHARES } from "./glsl.js";
import { after, before, replaced } from "./patching.js";
import { LEAST_ALPHA } from "./uniforms.js";

const VERTEX = `
uniform LcOctahedral lcImpostor;
uniform mat4 lcToLayout;
out vec3 lcPoint;
out vec3 lcEye;
out vec2 lcCorner;
out mat3 lcNormalToView;
`;
const CORNER = `
#ifdef USE_INSTANCING
    mat4 lcToWorld = modelMatrix * instanceMatrix;
    mat3 lcToView = mat3(viewMatrix) * mat3(lcToWorld);
#else
    mat4 lcToWorld = modelMatrix;
    mat3 lcToView = normalMatrix;
#endif
    vec3 lcCamera = (lcToLayout * (inverse(lcToWorld) * vec4(cameraPosition, 1.0))).xyz;
    lcEye = normalize(lcCamera);
    lcCorner = position.xy;
    lcPoint = lc_octahedral_corner(lcCorner, lcEye, lcImpostor);
    lcNormalToView = lcToView * transpose(mat3(lcToLayout));
    vec3 transformed = (inverse(lcToLayout) * vec4(lcPoint, 1.0)).xyz;
`;
const FRAGMENT = `
uniform LcOctahedral lcImpostor;
uniform float lcShadows; // 1 if trees get shadows
uniform sampler2D lcColorPage;
uniform sampler2D lcNormalPage;
uniform bool lcMultisampled;
in vec3 lcPoint;
in vec3 lcEye;
in vec2 lcCorner;
in mat3 lcNormalToView;
`;
const COLOR = `
    vec4 lcSeen;
    vec3 lcNormal;
    float lcLight;
    float lcTexels = 0.5 * lcImpostor.texels * max(length(dFdx(lcCorner)), length(dFdy(lcCorner)));
    float lcLod = log2(lcTexels);
    lc_octahedral(lcColorPage, lcNormalPage, lcPoint, normalize(lcEye), lcLod, lcImpostor, lcSeen, lcNormal, lcLight);
    diffuseColor *= vec4(lcSeen.rgb * mix(1.0, lcLight, lcShadows), lcSeen.a);
`;
/** Of an impostor that is not blended. */
const CUT = `
#ifdef ALPHA_TO_COVERAGE
    float lcCutoff = lc_share_cutoff(lcPoint, 0.5 * lcImpostor.texels * lcCorner, max(lcLod, 0.0));
    if (!lcMultisampled) diffuseColor.a = diffuseColor.a < lcCutoff ? 0.0 : 1.0;
    if (diffuseColor.a == 0.0) discard;
#endif
#include <alphatest_fragment>
`;
const NORMAL = "normal = normalize(lcNormalToView * lcNormal);";
/**
 * Returns the material of an octahedral impostor. `numbers`: its extras. `original`: the cross impostor's material. `patch`
 * adds the fade to a shader.
 */
export function octahedralMaterial({ numbers, color, normalDepth }, original, patch) {
  const uniforms = {
    lcImpostor: {
      value: {
        extent: new THREE.Vector2(...numbers.extent),
        half_box: new THREE.Vector3(...numbers.half),
        grid: numbers.grid,
        texels: numbers.texels,
      },
    },
    lcToLayout: { value: new THREE.Matrix4().set(...numbers.to_layout, 0, 0, 0, 1) },
    lcColorPage: { value: color },
    lcNormalPage: { value: normalDepth },
  };
  const { roughness, metalness } = original;
  const material = new THREE.MeshStandardMaterial({ roughness, metalness, transparent: true, alphaTest: LEAST_ALPHA });
  material.customProgramCacheKey = () => "leafcloud octahedral";
  material.onBeforeCompile = (shader) => {
    patch(shader);
    Object.assign(shader.uniforms, uniforms);
    const cornered = replaced(shader.vertexShader, "#include <begin_vertex>", CORNER);
    shader.vertexShader = before("void main()", OCTAHEDRAL + VERTEX, cornered);
    const colored = replaced(shader.fragmentShader, "#include <map_fragment>", COLOR);
    const cut = replaced(colored, "#include <alphatest_fragment>", CUT);
    const shaded = after("#include <normal_fragment_maps>", NORMAL, cut);
    shader.fragmentShader = before("void main()", OCTAHEDRAL + SHARES + FRAGMENT, shaded);
  };
  return material;
}
