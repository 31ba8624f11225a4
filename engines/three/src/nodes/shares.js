// The cutoff of shaders/shares.glsl as nodes, for mip levels with the share of drawn texels as alpha.
import {
  cross,
  dFdx,
  dFdy,
  dot,
  exp2,
  float,
  floor,
  int,
  length,
  log2,
  max,
  min,
  mix,
  positionGeometry,
  textureSize,
  uint,
  uniform,
  uv,
  varying,
  vec2,
  vec3,
} from "three/tsl";

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

/** Returns whether a place on a leaf is drawn. `sampled`: the node of its texture `map`. `cutoff`: of the material. */
export function drawnByShare(sampled, map, cutoff) {
  const place = varying(positionGeometry).toVar();
  const matrix = uniform(map.matrix).onRenderUpdate(() => map.matrix);
  const texel = matrix.mul(vec3(uv(map.channel), 1)).xy.mul(vec2(textureSize(sampled))).toVar();
  const [across, down] = [dFdx(texel).toVar(), dFdy(texel).toVar()];
  const level = max(log2(max(dot(across, across), dot(down, down))).mul(0.5), 0).toVar(); // as textures are read
  return sampled.a.greaterThanEqual(mix(float(cutoff), shareCutoff(place, texel, level), min(level, 1)));
}
