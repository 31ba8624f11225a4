// The law of shaders/shares.glsl as nodes, for alpha that is the share of a texel that leaves cover.
import {
  clamp,
  cross,
  dFdx,
  dFdy,
  dot,
  exp2,
  float,
  floor,
  fract,
  fwidth,
  int,
  length,
  log2,
  max,
  min,
  mix,
  positionGeometry,
  select,
  textureSize,
  uint,
  uniform,
  uniformArray,
  uv,
  varying,
  vec2,
  vec3,
} from "three/tsl";

/** 1 if the picture that is drawn has several samples a pixel. */
const multisampled = uniform(0).onRenderUpdate(({ renderer }) => Number(renderer.currentSamples > 1));

function mixed(number) {
  const once = number.bitXor(number.shiftRight(uint(16))).mul(uint(2246822519)).toVar();
  const twice = once.bitXor(once.shiftRight(uint(13))).mul(uint(3266489917)).toVar();
  return twice.bitXor(twice.shiftRight(uint(16))).toVar();
}

const cellOf = (number) => uint(int(floor(number)));

function shareCutoff(place, texel, level) {
  const across = cross(dFdx(place), dFdy(place)).toVar();
  const area = max(length(across), 1e-30).toVar();
  const size = exp2(floor(log2(area).mul(0.5).add(0.5)));
  const cell = place.add(0.31371).div(size).toVar();
  const part = texel.mul(exp2(floor(level.add(0.5)).negate())).toVar();
  const facing = floor(across.mul(8).div(area).add(0.5)).toVar();
  const way = uint(int(facing.x.add(facing.y.add(facing.z.mul(17)).mul(17))));
  const ofPlace = mixed(mixed(mixed(cellOf(cell.x)).add(cellOf(cell.y))).add(cellOf(cell.z)));
  const random = mixed(mixed(mixed(ofPlace.add(way)).add(cellOf(part.x))).add(cellOf(part.y)));
  return float(random.shiftRight(uint(16))).add(0.5).div(65536);
}

function levelAt(texel) {
  const [across, down] = [dFdx(texel).toVar(), dFdy(texel).toVar()];
  return max(log2(max(dot(across, across), dot(down, down))).mul(0.5), 0).toVar();
}

function shareOf(alpha, pivot, cutoff) {
  const above = pivot.add(alpha.sub(cutoff).mul(pivot.oneMinus()).div(Math.max(1 - cutoff, 1e-3)));
  return select(alpha.lessThan(cutoff), pivot.mul(alpha).div(cutoff), above);
}

function pivotAt(pivots, level) {
  const last = pivots.length - 1;
  const table = uniformArray(pivots, "float");
  const finer = int(min(level, last)).toVar();
  return mix(table.element(finer), table.element(min(finer.add(1), last)), fract(level));
}

/**
 * Returns the share of a pixel's samples to draw on a leaf, and whether shadow maps draw it. `sampled`: the node of its texture `map`.
 * `cut`: of the material.
 */
export function drawnOfLeaf(sampled, map, { cutoff, pivots }) {
  const place = varying(positionGeometry).toVar();
  const matrix = uniform(map.matrix).onRenderUpdate(() => map.matrix);
  const texel = matrix.mul(vec3(uv(map.channel), 1)).xy.mul(vec2(textureSize(sampled))).toVar();
  const level = levelAt(texel);
  const minified = min(level, 1).toVar();
  const sharp = clamp(sampled.a.sub(cutoff).div(max(fwidth(sampled.a), 1e-4)).add(0.5), 0, 1).toVar();
  const share = mix(sharp, shareOf(sampled.a, pivotAt(pivots, level).toVar(), cutoff), minified);
  const isDrawn = share.greaterThanEqual(mix(0.5, shareCutoff(place, texel, level), minified));
  const whole = select(isDrawn, float(1), float(0)).toVar();
  return [mix(whole, mix(sharp, whole, minified), multisampled), isDrawn];
}

/** Returns the share of a pixel's samples to draw on an impostor of this `alpha`. `level`: the mip level that is read. */
export function drawnOfImpostor(alpha, place, texel, level) {
  const whole = select(alpha.lessThan(shareCutoff(place, texel, max(level, 0))), float(0), float(1));
  return mix(whole, alpha, multisampled);
}
