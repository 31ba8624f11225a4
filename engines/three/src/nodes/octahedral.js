// Octahedral impostors as nodes: the law of octahedral.glsl with the same names, and the nodes of its material.
import * as THREE from "three";
import {
  abs,
  cameraPosition,
  cameraViewMatrix,
  ceil,
  clamp,
  cross,
  dFdx,
  dFdy,
  diffuseColor,
  dot,
  exp2,
  float,
  floor,
  Fn,
  length,
  log2,
  mat3,
  max,
  min,
  mix,
  normalize,
  positionGeometry,
  property,
  select,
  sqrt,
  texture,
  transpose,
  uniform,
  varying,
  vec2,
  vec3,
  vec4,
} from "three/tsl";
import { numberOf, placed, toWorld } from "./level.js";
import { drawnOfImpostor } from "./shares.js";

/** How far the views reach below the horizon, and the corrections of the height by the stored depth. */
const BELOW = 0.5;
const STEPS = 2;
/** Light over the stored openness. */
const OPEN = 1.5;

function viewDirection(tile, grid) {
  const p = tile.mul(float(2).div(grid.sub(1))).sub(1);
  const flat = vec2(p.x.add(p.y), p.x.sub(p.y)).mul(0.5);
  const level = abs(flat.x).add(abs(flat.y));
  return normalize(vec3(flat, max(level.oneMinus(), 0).sub(level.mul(BELOW)))).toVar();
}

/** Returns [right, up] of a picture seen from `direction`. */
function viewAxes(direction) {
  const across = vec2(direction.y.negate(), direction.x);
  const size = length(across);
  const right = select(size.greaterThan(1e-6), vec3(across.div(max(size, 1e-6)), 0), vec3(1, 0, 0)).toVar();
  return [right, cross(direction, right).toVar()];
}

function rayOf(eye) {
  return normalize(vec3(eye.xy, max(eye.z, length(eye.xy).negate()))).toVar();
}

function inPicture(point, eye, ray) {
  const [, upright] = viewAxes(ray);
  const [right, up] = viewAxes(eye);
  // Both pictures have the same axis to the right.
  return right.mul(dot(right, point)).add(upright.mul(dot(up, point))).toVar();
}

function viewNormal(stored, direction) {
  const [right, up] = viewAxes(direction);
  const outward = sqrt(max(dot(stored, stored).oneMinus(), 0));
  return right.mul(stored.x).add(up.mul(stored.y)).add(direction.mul(outward));
}

/** Returns three views [tile, weight] around the direction `eye`. */
function viewsOf(eye, grid) {
  const level = abs(eye.x).add(abs(eye.y));
  const sum = level.add(max(eye.z.add(level.mul(BELOW)), 0));
  const share = vec2(eye.x.add(eye.y), eye.x.sub(eye.y)).div(sum).mul(0.5).add(0.5);
  const place = share.mul(grid.sub(1)).toVar();
  const cell = clamp(floor(place), vec2(0), vec2(grid.sub(2))).toVar();
  const within = clamp(place.sub(cell), 0, 1).toVar();
  const right = select(within.x.greaterThan(within.y), float(1), float(0)).toVar();
  // Squares of barycentric weights: less of the leaves' texture is lost in the blend.
  const own = vec3(max(within.x, within.y).oneMinus(), abs(within.x.sub(within.y)), min(within.x, within.y)).toVar();
  const near = own.mul(own).div(dot(own, own)).toVar();
  return [
    [cell, near.x],
    [cell.add(vec2(right, right.oneMinus())), near.y],
    [cell.add(1), near.z],
  ];
}

/** `view` has the view's tile, direction, right and up. */
function viewPlace(view, point, ray, height, border, { extent, grid }) {
  const there = point.add(ray.mul(height.sub(dot(view.toward, point)).div(dot(view.toward, ray))));
  const across = vec2(dot(view.right, there), dot(view.up, there)).div(extent);
  const share = across.mul(vec2(0.5, -0.5)).add(0.5);
  return view.tile.add(clamp(share, vec2(border), vec2(border.oneMinus()))).div(grid);
}

/** Returns {shown, normal, light} of the ray through `point` toward the direction `eye`. */
function octahedral(pages, point, eye, lod, numbers) {
  const ray = rayOf(eye);
  const seen = inPicture(point, eye, ray);
  const level = clamp(lod, 0, log2(numbers.texels).sub(2)).toVar();
  const border = exp2(ceil(level)).mul(0.5).div(numbers.texels).toVar();
  const sum = vec4(0).toVar();
  const normal = vec3(0).toVar();
  const light = float(0).toVar();
  for (const [tile, weight] of viewsOf(eye, numbers.grid)) {
    const toward = viewDirection(tile, numbers.grid);
    const [right, up] = viewAxes(toward);
    const placeAt = (height) => viewPlace({ tile, toward, right, up }, seen, ray, height, border, numbers).toVar();
    let height = float(0);
    for (let step = 0; step < STEPS; step++) {
      height = texture(pages.normalDepth, placeAt(height)).level(level).a.mul(2).sub(1);
    }
    const place = placeAt(height);
    const texel = texture(pages.color, place).level(level).toVar();
    const share = texel.a.mul(weight).toVar();
    sum.addAssign(vec4(texel.rgb.mul(share), share));
    const shading = texture(pages.normalDepth, place).level(level).toVar();
    normal.addAssign(viewNormal(shading.xy.mul(2).sub(1), toward).mul(share));
    light.addAssign(share.mul(shading.z));
  }
  const some = sum.a.greaterThan(0);
  const whole = max(sum.a, 1e-30);
  return {
    shown: vec4(select(some, sum.rgb.div(whole), vec3(0)), sum.a),
    normal: select(dot(normal, normal).greaterThan(0), normalize(normal), eye),
    light: select(some, min(light.mul(OPEN).div(whole), 1), 1),
  };
}

function octahedralCorner(corner, eye, { extent, halfBox }) {
  const [right, up] = viewAxes(eye);
  const height = min(length(up.xy).mul(extent.x).add(abs(up.z).mul(halfBox.z)), extent.y);
  return right.mul(corner.x.mul(extent.x)).add(up.mul(corner.y.mul(height)));
}

const shadows = numberOf("float", (laws) => laws.lcShadows.value);

/** Returns the nodes of an impostor's material: corners, color and normal. `numbers` are its extras. */
export function impostorNodes({ numbers, ...pages }) {
  const impostor = {
    extent: uniform(new THREE.Vector2(...numbers.extent)),
    halfBox: uniform(new THREE.Vector3(...numbers.half)),
    grid: uniform(numbers.grid),
    texels: uniform(numbers.texels),
  };
  const matrix = new THREE.Matrix4().set(...numbers.to_layout, 0, 0, 0, 1);
  const [toLayout, fromLayout] = [uniform(matrix), uniform(matrix.clone().invert())];
  const eye = normalize(toLayout.mul(toWorld.inverse().mul(vec4(cameraPosition, 1))).xyz);
  const point = octahedralCorner(positionGeometry.xy, eye, impostor);
  const toView = mat3(cameraViewMatrix).mul(mat3(toWorld)).mul(transpose(mat3(toLayout)));
  const [seenEye, seenPoint, corner] = [varying(eye), varying(point), varying(positionGeometry.xy)];
  const axes = mat3(...[0, 1, 2].map((i) => varying(toView.element(i))));
  const normalSeen = property("vec3", "lcNormalSeen");
  const lod = log2(max(length(dFdx(corner)), length(dFdy(corner))).mul(impostor.texels).mul(0.5));
  const colorNode = Fn(() => {
    const { shown, normal, light } = octahedral(pages, seenPoint, normalize(seenEye).toVar(), lod, impostor);
    normalSeen.assign(normal);
    return vec4(shown.rgb.mul(mix(float(1), light, shadows)), shown.a);
  })();
  return {
    positionNode: placed(() => fromLayout.mul(vec4(point, 1)).xyz),
    colorNode,
    normalNode: normalize(axes.mul(normalSeen)),
    coverNode: drawnOfImpostor(diffuseColor.a, seenPoint, corner.mul(impostor.texels).mul(0.5), lod),
  };
}
